"""A thread has the priority that it asks for, where the system permits it."""

import os
from concurrent.futures import ThreadPoolExecutor

import pytest
from support import real_time_permitted

from rpud_sim.ros.threads import schedule_thread


@pytest.fixture
def thread():
    with ThreadPoolExecutor(1) as pool:
        yield lambda function, *arguments: pool.submit(function, *arguments).result()


def scheduled():
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, os.sched_getparam(0).sched_priority


def test_a_thread_has_the_priority_that_it_is_said_to_have(thread):
    before = scheduled()
    said = thread(schedule_thread, 3)
    if real_time_permitted():
        assert said == "real-time priority 3"
        assert thread(scheduled) == (os.SCHED_FIFO, 3)
    else:
        assert said == "time-sharing: real-time priority 3: Operation not permitted"
        assert thread(scheduled) == (os.SCHED_OTHER, 0)
    assert thread(schedule_thread, 0) == "time-sharing"
    assert thread(scheduled) == (os.SCHED_OTHER, 0)
    assert scheduled() == before


def test_what_a_thread_starts_is_not_scheduled_so(thread):
    thread(schedule_thread, 3)

    def start():
        with ThreadPoolExecutor(1) as pool:
            return pool.submit(scheduled).result()

    assert thread(start) == (os.SCHED_OTHER, 0)


def test_where_it_is_not_permitted_the_reason_is_reported(thread, monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert thread(schedule_thread, 9) == (
        "time-sharing: real-time priority 9: Operation not permitted"
    )
    assert thread(scheduled) == (os.SCHED_OTHER, 0)
