"""One thread serves requests, has the priority that it asks for, and survives the network."""

import os
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
import rclpy
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from support import PATIENCE, real_time_permitted, until

from rpud_sim.ros.threads import (
    Requests,
    StoppedError,
    quick_switches,
    schedule_thread,
    serve,
)


class Worker:
    """A thread that serves until it is stopped, as the pacing thread does."""

    def __init__(self):
        self.wake, self.stop = threading.Event(), threading.Event()
        self.requests = Requests(self.wake.set)
        self.thread = threading.Thread(target=self.run)

    def run(self):
        while not self.stop.is_set():
            self.requests.serve()
            self.wake.wait(0.1)
            self.wake.clear()
        self.requests.close()

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.stop.set()
        self.wake.set()
        self.thread.join()


def test_an_action_is_done_in_the_other_thread_and_answered():
    with Worker() as worker:
        assert worker.requests.do(threading.current_thread) is worker.thread
        assert worker.requests.do(lambda: 7) == 7


@pytest.mark.parametrize("kind", [ValueError, TimeoutError, KeyError])
def test_what_an_action_raises_belongs_to_whoever_asked(kind):
    def fail():
        raise kind("of its own")

    with Worker() as worker:
        with pytest.raises(kind, match="of its own"):
            worker.requests.do(fail)
        assert worker.requests.do(lambda: "still there") == "still there"


def test_actions_of_many_threads_are_done_one_by_one_and_each_is_answered():
    done, answers = [], {}

    def ask(number):
        answers[number] = worker.requests.do(lambda: done.append(number) or -number)

    with Worker() as worker:
        askers = [threading.Thread(target=ask, args=(number,)) for number in range(50)]
        for asker in askers:
            asker.start()
        for asker in askers:
            asker.join()
    assert sorted(done) == list(range(50))
    assert answers == {number: -number for number in range(50)}


def test_the_serving_thread_does_its_own_requests_at_once():
    with Worker() as worker:

        def nested():
            inner = worker.requests.do(lambda: worker.requests.do(threading.current_thread))
            assert inner is worker.thread
            with pytest.raises(KeyError):
                worker.requests.do({}.popitem)
            future = worker.requests.do(Future)  # it cannot wait for itself
            return future.done()

        assert worker.requests.do(nested) is False


def test_what_waits_at_the_end_is_refused_and_so_is_all_that_comes():
    waiting = threading.Event()
    requests = Requests(waiting.set)
    refusals = []

    def ask():
        try:
            requests.do(lambda: None)
        except StoppedError as error:
            refusals.append(str(error))

    asker = threading.Thread(target=ask)
    asker.start()
    assert waiting.wait(PATIENCE)
    requests.close()
    asker.join()
    assert refusals == ["the drill has stopped"]
    with pytest.raises(StoppedError, match="the drill has stopped"):
        requests.do(lambda: None)


def test_an_action_that_returns_a_future_is_answered_with_its_result():
    with Worker() as worker:
        future: Future[int] = Future()
        timer = threading.Timer(0.05, future.set_result, [3])
        timer.start()
        assert worker.requests.do(lambda: future) == 3


def test_a_future_that_will_never_be_done_ends_with_the_thread():
    requests = Requests(lambda: requests.serve())
    asker = threading.Thread(target=lambda: refused.append(catch()))
    refused = []

    def catch():
        with pytest.raises(StoppedError) as error:
            requests.do(Future)
        return error

    asker.start()
    requests.close()
    asker.join(PATIENCE)
    assert len(refused) == 1


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


@pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
def test_a_message_for_which_rclpy_raises_an_error_is_reported_in_one_line(kind, nodes):
    simulated = [Parameter("use_sim_time", value=True)]
    node = rclpy.create_node("follower", parameter_overrides=simulated)
    source = rclpy.create_node("source")
    nodes += [node, source]
    publisher = source.create_publisher(Clock, "/clock", 10)
    executor = kind()
    executor.add_node(node)
    failures = []

    def send(seconds):
        message = Clock()
        message.clock.sec = seconds
        publisher.publish(message)
        serve(executor, failures.append)

    try:
        until(lambda: send(-1) or failures)
        assert failures[0].startswith("it raised ValueError: ")
        assert "\n" not in failures[0]
        until(lambda: send(7) or node.get_clock().now().nanoseconds == 7_000_000_000)
    finally:
        executor.shutdown()


def test_switches_are_quick_inside_the_context_alone():
    before = sys.getswitchinterval()
    with quick_switches():
        assert sys.getswitchinterval() < 1e-3 < before
    assert sys.getswitchinterval() == before
