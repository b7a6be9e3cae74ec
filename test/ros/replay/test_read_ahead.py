"""What is read ahead comes in order, in bounded memory, with the error that ended it."""

import itertools
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.bag import BagFormatError, Message
from rpud_sim.ros.replay.playback import ReadAhead


def message(number, size=0):
    return Message("/a", number, number, bytes(size))


@given(st.integers(0, 2000), st.sampled_from([0, 10_000]))
def test_all_come_in_order(count, size):
    sent = [message(number, size) for number in range(count)]
    ahead = ReadAhead(sent)
    assert list(ahead) == sent
    assert next(ahead, None) is None
    ahead.close()


@pytest.mark.parametrize(("size", "most"), [(0, 6000), (1 << 20, 20)])
def test_it_reads_no_further_than_there_is_room(size, most):
    taken = 0
    full = threading.Event()

    def endless():
        nonlocal taken
        for number in itertools.count():
            taken = number
            yield message(number, size)

    ahead = ReadAhead(endless())
    before = -1
    while taken != before:
        before = taken
        full.wait(0.2)
    assert 2 < taken < most
    assert next(ahead).log_time == 0
    ahead.close()
    after = taken
    time.sleep(0.05)
    assert taken == after


def test_the_error_comes_where_the_messages_end():
    def damaged():
        yield from (message(number) for number in range(300))
        raise BagFormatError("it is damaged")

    ahead = ReadAhead(damaged())
    assert [next(ahead).log_time for _ in range(300)] == list(range(300))
    with pytest.raises(BagFormatError, match="it is damaged"):
        next(ahead)
    ahead.close()


@pytest.mark.parametrize("count", [0, 300, 100_000])
def test_it_is_full_or_at_the_end_when_it_is_made(count):
    taken = 0

    def counted():
        nonlocal taken
        for number in range(count):
            taken = number + 1
            yield message(number)

    ahead = ReadAhead(counted())
    assert taken >= min(count, 4096)
    ahead.close()
