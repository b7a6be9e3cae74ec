"""What is read ahead comes in order, in bounded memory, with the error that ended it."""

import itertools
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.bag import BagFormatError, Message
from rpud_sim.ros.replay.playback import read_ahead


def message(number, size=0):
    return Message("/a", number, number, bytes(size))


@given(st.integers(0, 2000), st.sampled_from([0, 10_000]), st.booleans())
def test_all_come_in_order_and_the_error_where_they_end(count, size, damaged):
    sent = [message(number, size) for number in range(count)]

    def read():
        yield from sent
        if damaged:
            raise BagFormatError("it is damaged")

    ahead = read_ahead(read())
    assert list(itertools.islice(ahead, count)) == sent
    if damaged:
        with pytest.raises(BagFormatError, match="it is damaged"):
            next(ahead)
    assert next(ahead, None) is None


@pytest.mark.parametrize(("size", "least", "most"), [(0, 4096, 6000), (1 << 20, 16, 20)])
def test_it_reads_as_far_as_there_is_room_before_the_first_one_comes(size, least, most):
    taken = 0

    def endless():
        nonlocal taken
        for number in itertools.count(1):
            taken = number
            yield message(number, size)

    ahead = read_ahead(endless())
    assert next(ahead).log_time == 1
    assert taken >= least
    before = -1
    while taken != before:
        before = taken
        threading.Event().wait(0.2)
    assert taken < most
    ahead.close()
    after = taken
    time.sleep(0.05)
    assert taken == after
