"""Messages that wait for those of another run: bounded by their size."""

from rpud_sim.bag.cdr import Codec
from rpud_sim.inspection.compare.same_bits import _Pair, _Timed

CODEC = Codec("std_msgs/msg/Empty", "")


def test_many_small_messages_may_wait_and_few_large_ones_not():
    small = _Pair("status", CODEC)
    for time in range(25_000):
        small.add(0, _Timed(b"", time, 0))
    assert not small.done
    large = _Pair("waveform", CODEC)
    data = bytes(2**20)
    for time in range(65):
        large.add(0, _Timed(data, time, 0))
    assert large.done
