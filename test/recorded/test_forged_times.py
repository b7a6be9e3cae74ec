"""Times of a journal that no other message shows are not run again: they might never end."""

import json

import pytest
from altered_bags import altered, unchanged
from inspection.forked_runs import JOURNAL, SECOND, entries_of
from rpud_sim.recorded.recorded_journal import UnverifiableError, installed_codec
from rpud_sim.recorded.verify.verification import verify

from rpud_sim.bag.columns import to_plain
from rpud_sim.recorded import RecordingError, recorded_journal
from rpud_sim.recorded.offline_bag import write_fork
from rpud_sim.simulation.topics import TOPICS

AHEAD = 600  # s; long enough to see that it is not simulated
CODEC = installed_codec(TOPICS["journal"].type)


def forged(path, out, kind, stamped, topics=None):
    """Put entries of a kind, and what follows, ahead; ``stamped`` alters their stamps as well."""
    ahead = 0

    def change(message):
        nonlocal ahead
        if message.topic != JOURNAL:
            return [message.data]
        fields = to_plain(CODEC.decode(message.data))
        content = json.loads(fields["content"])
        if fields["kind"] == kind:
            ahead = AHEAD
        content["time"] += ahead * SECOND
        fields["header"]["stamp"]["sec"] += ahead * stamped
        return [CODEC.encode({**fields, "content": json.dumps(content)})]

    return altered(path, out, change, topics)


@pytest.mark.parametrize("stamped", [False, True])
@pytest.mark.parametrize("kind", ["begin", "origin", "end"])
def test_a_forged_time_is_not_run_again(plain, tmp_path, kind, stamped):
    path = forged(plain, tmp_path / "bag", kind, stamped)
    entries = entries_of(path)
    number = next(n for n, entry in enumerate(entries) if entry.kind == kind)
    with pytest.raises(
        UnverifiableError, match=rf"entry {number} of the journal \({kind}\) is of "
    ):
        verify(path)
    with pytest.raises(RecordingError, match="no other message shows that time"):
        write_fork(path, tmp_path / "fork", 0.1)
    assert not (tmp_path / "fork").exists()


def test_a_time_of_a_run_before_is_not_run_again(used, tmp_path):
    path = forged(used.path, tmp_path / "bag", "flush", stamped=True)
    with pytest.raises(UnverifiableError, match="no other message shows that time"):
        verify(path)
    with pytest.raises(RecordingError, match="no other message shows that time"):
        write_fork(path, tmp_path / "fork", 0.1, run=2)


def test_a_bag_is_searched_once_for_stamps_however_many_entries_need_them(used, tmp_path):
    bare = altered(used.path, tmp_path / "bare", unchanged, {JOURNAL})
    searched = []

    def search(*words):
        searched.append(words)
        return iter(())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded_journal, "recorded_progress", search)
        write_fork(bare, tmp_path / "fork", 0.05)
    assert len(entries_of(bare)) > len(searched) == 2  # its end, and the whole


def test_log_times_bound_a_journal_without_other_messages(used, tmp_path):
    bare = altered(used.path, tmp_path / "bare", unchanged, {JOURNAL})
    write_fork(bare, tmp_path / "fork", 0.05)
    path = forged(bare, tmp_path / "forged", "weight_on_bit", stamped=True)
    with pytest.raises(RecordingError, match="no other message shows that time"):
        write_fork(path, tmp_path / "again", 0.05)


def test_an_origin_that_contradicts_its_stamp_is_not_run_again(plain, tmp_path):
    """A bag that ends early goes on to its last stamp, from the origin on."""

    def change(message):
        if message.topic != JOURNAL:
            return [message.data]
        fields = to_plain(CODEC.decode(message.data))
        content = json.loads(fields["content"])
        if fields["kind"] == "origin":
            content["origin"] -= AHEAD * SECOND
        kept = fields["kind"] != "end"
        return [CODEC.encode({**fields, "content": json.dumps(content)})] * kept

    path = altered(plain, tmp_path / "bag", change)
    found = verify(path)
    assert (found.first_difference.field, found.simulated) == ("header.stamp", 0)
    with pytest.raises(RecordingError, match=r"header\.stamp of entry 0 is 0, not -600"):
        write_fork(path, tmp_path / "fork", 0.1)
