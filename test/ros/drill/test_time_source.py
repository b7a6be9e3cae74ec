"""The drill's time is this machine's, its own, or the /clock of another node."""

import threading
import time

import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from support import PATIENCE, until

from rpud_sim.ros.drill.timeline import TimeSource

SECOND = 1_000_000_000


@pytest.fixture
def node(nodes):
    def create(use_sim_time):
        overrides = [Parameter("use_sim_time", value=use_sim_time)]
        nodes.append(rclpy.create_node("drill_node", parameter_overrides=overrides))
        return nodes[-1]

    return create


@pytest.fixture
def follower(node):
    """A source that hears a /clock, how to move that, and how often the source woke."""
    drill, woken = node(True), []
    publisher = drill.create_publisher(Clock, "/clock", 10)
    executor = SingleThreadedExecutor()
    executor.add_node(drill)
    source = TimeSource(drill, False, lambda: woken.append(True))

    def tell(seconds):
        """Publish a time until the node's clock shows it."""

        def shown():
            publisher.publish(Clock(clock=Time(sec=seconds)))
            executor.spin_once(timeout_sec=0.1)
            return drill.get_clock().now().nanoseconds == seconds * SECOND

        until(shown)

    yield source, tell, woken
    source.close()
    executor.shutdown()


def test_of_itself_time_is_the_machine_s(node):
    source = TimeSource(node(False), False)
    assert (source.follows, source.schedule, source.went_back) == (False, None, False)
    source.wait(threading.Event(), lambda: None)
    before = time.time_ns()
    assert before <= source.origin(5 * SECOND, own=7) + 5 * SECOND <= time.time_ns()
    source.close()


@pytest.mark.parametrize("use_sim_time", [False, True])
def test_the_source_of_the_clock_begins_at_zero_and_follows_no_other_clock(node, use_sim_time):
    source = TimeSource(node(use_sim_time), True)
    assert (source.follows, source.schedule) == (False, None)
    source.wait(threading.Event(), lambda: None)
    assert source.origin() == source.origin(SECOND) == 0
    assert source.origin(SECOND, own=3 * SECOND) == 3 * SECOND


def test_a_follower_waits_for_the_first_time_serves_meanwhile_and_can_be_stopped(follower):
    source, tell, _ = follower
    stop, served = threading.Event(), threading.Event()
    stop.set()
    source.wait(stop, lambda: None)
    assert source.origin() == 0
    waiter = threading.Thread(target=source.wait, args=(threading.Event(), served.set))
    waiter.start()
    assert served.wait(PATIENCE)
    assert waiter.is_alive()
    tell(7)
    waiter.join(PATIENCE)
    assert not waiter.is_alive()


def test_the_schedule_of_a_follower_is_the_clock_whose_every_jump_wakes_it(follower):
    source, tell, woken = follower
    tell(7)
    assert source.origin() == 7 * SECOND
    before = len(woken)
    tell(9)
    assert len(woken) > before > 0
    assert (source.schedule(), source.went_back) == (9 * SECOND, False)
    assert source.origin(2 * SECOND, own=5) == 7 * SECOND
    tell(2)
    assert source.went_back  # until the next origin
    assert (source.origin(), source.went_back) == (2 * SECOND, False)
    source.close()
    before = len(woken)
    tell(8)
    assert len(woken) == before
