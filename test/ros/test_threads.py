"""One thread serves requests, has the priority that it asks for, and survives the network."""

import os
import threading
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import pytest
import rclpy
from hypothesis import given
from hypothesis import strategies as st
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from support import real_time_permitted, until

from rpud_sim.ros.threads import (
    DelayHistogram,
    RequestError,
    Requests,
    schedule_thread,
    serve,
)


@pytest.fixture
def requests():
    """Requests that a thread serves, as the pacing thread does."""
    waking = threading.Event()
    requests = Requests(waking.set)
    stop = threading.Event()

    def run():
        while not stop.is_set():
            requests.serve()
            waking.wait(0.1)
        requests.close()

    with ThreadPoolExecutor(1) as pool:
        pool.submit(run)
        yield requests
        stop.set()


def test_an_action_is_done_in_the_other_thread_and_answered(requests):
    server = requests.do(threading.current_thread)
    assert server is not threading.current_thread()
    # The server does its own requests at once, and waits for no Future: it would wait for itself.
    assert requests.do(lambda: requests.do(threading.current_thread)) is server
    assert requests.do(lambda: requests.do(Future).done()) is False
    done = []
    with ThreadPoolExecutor(50) as askers:
        ask = [
            askers.submit(requests.do, lambda number=number: done.append(number) or -number)
            for number in range(50)
        ]
    assert [each.result() for each in ask] == [-number for number in range(50)]
    assert sorted(done) == list(range(50))


@pytest.mark.parametrize("kind", [ValueError, TimeoutError, KeyError])
def test_what_an_action_raises_belongs_to_whoever_asked(requests, kind):
    def fail():
        raise kind("of its own")

    with pytest.raises(kind, match="of its own"):
        requests.do(fail)
    assert requests.do(lambda: "still there") == "still there"


@pytest.mark.parametrize("served", [False, True])
def test_what_waits_at_the_end_is_refused_and_so_is_all_that_comes(served):
    requests = Requests(lambda: served and requests.serve())
    with ThreadPoolExecutor(1) as pool:
        asker = pool.submit(requests.do, Future)  # a Future that will never be done
        requests.close()
        with pytest.raises(RequestError, match="the drill has stopped"):
            asker.result()
        with pytest.raises(RequestError, match="the drill has stopped"):
            requests.do(Future)


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


def test_what_a_transition_destroys_in_the_midst_of_its_use_is_no_failure(nodes):
    node = rclpy.create_node("cleaned_up")
    nodes.append(node)
    publisher = node.create_publisher(Clock, "late", 1)
    uses = []

    def use():
        uses.append(publisher)
        publisher.publish(Clock())

    node.create_timer(0.001, use)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    node.destroy_publisher(publisher)
    failures = []
    while not uses:
        serve(executor, failures.append)
    assert failures == []


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


@given(st.lists(st.floats(0.0, 1e13), min_size=1), st.floats(0.0, 1.0, exclude_min=True))
def test_quantiles_are_little_too_large_and_never_too_small(delays, share):
    lateness = DelayHistogram()
    for delay in delays:
        lateness.add(delay)
    exact = np.quantile(delays, share, method="inverted_cdf") / 1e9
    assert exact * (1 - 1e-12) <= lateness.quantile(share) <= 1.045 * exact + 1e-6
    assert lateness.greatest == pytest.approx(max(delays) / 1e9)
