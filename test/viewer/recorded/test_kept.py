"""Results that are kept: the latest ones, within a limit."""

from rpud_sim.viewer.recorded.kept import Kept


def test_those_are_kept_that_were_used_last():
    kept = Kept(3, len)
    made = []

    def get(key, length=1):
        return kept.get(key, lambda: made.append(key) or [key] * length)

    for key in (0, 1, 2, 0, 3):
        assert get(key)[0] == key
    assert made == [0, 1, 2, 3]
    get(0)
    get(1)
    assert made == [0, 1, 2, 3, 1]


def test_the_latest_is_kept_however_large_it_is():
    kept = Kept(3, len)
    first = kept.get(0, lambda: [0])
    large = kept.get(1, lambda: [1] * 10)
    assert kept.get(1, list) is large
    assert kept.get(0, lambda: [2]) != first
