"""The drill's time is this machine's, its own, or the /clock of another node."""

import threading
import time

import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from support import PATIENCE

from rpud_sim.ros.drill.pacer import TimeSource

SECOND = 1_000_000_000


@pytest.fixture
def node(nodes):
    def create(use_sim_time):
        overrides = [Parameter("use_sim_time", value=use_sim_time)]
        nodes.append(rclpy.create_node("drill_node", parameter_overrides=overrides))
        return nodes[-1]

    return create


class Clocked:
    """A node that hears a /clock, and whoever moves it."""

    def __init__(self, node):
        self.node = node
        self.publisher = node.create_publisher(Clock, "/clock", 10)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(node)

    def tell(self, nanoseconds):
        """Publish a time until the node's clock shows it."""
        sec, nanosec = divmod(nanoseconds, SECOND)
        deadline = time.monotonic() + PATIENCE
        while self.node.get_clock().now().nanoseconds != nanoseconds:
            assert time.monotonic() < deadline, "the clock did not come"
            self.publisher.publish(Clock(clock=Time(sec=sec, nanosec=nanosec)))
            self.executor.spin_once(timeout_sec=0.1)


@pytest.fixture
def clocked(node):
    made = Clocked(node(True))
    yield made
    made.executor.shutdown()


def test_of_itself_time_is_the_machine_s(node):
    source = TimeSource(node(False), False)
    assert not source.follows
    assert source.schedule is None
    source.wait(threading.Event(), lambda: None)
    before = time.time_ns()
    zero = source.origin(5 * SECOND, own=7)
    assert before <= zero + 5 * SECOND <= time.time_ns()
    assert not source.went_back
    source.close()


@pytest.mark.parametrize("use_sim_time", [False, True])
def test_the_source_of_the_clock_begins_at_zero_and_follows_no_other_clock(node, use_sim_time):
    source = TimeSource(node(use_sim_time), True)
    assert not source.follows
    assert source.schedule is None
    source.wait(threading.Event(), lambda: None)
    assert source.origin() == source.origin(SECOND) == 0
    assert source.origin(SECOND, own=3 * SECOND) == 3 * SECOND


def test_a_follower_waits_for_the_first_time_and_serves_meanwhile(clocked):
    source = TimeSource(clocked.node, False)
    assert source.follows
    served = threading.Event()
    waiter = threading.Thread(target=source.wait, args=(threading.Event(), served.set))
    waiter.start()
    assert served.wait(PATIENCE)
    assert waiter.is_alive()
    clocked.tell(7 * SECOND)
    waiter.join(PATIENCE)
    assert not waiter.is_alive()
    source.close()


def test_a_follower_that_is_stopped_waits_no_more(clocked):
    source = TimeSource(clocked.node, False)
    stop = threading.Event()
    stop.set()
    source.wait(stop, lambda: None)
    assert source.origin() == 0
    source.close()


def test_the_schedule_of_a_follower_is_the_clock_which_gives_its_present_time_a_stamp(clocked):
    source = TimeSource(clocked.node, False)
    clocked.tell(7 * SECOND)
    assert source.origin() == 7 * SECOND
    clocked.tell(9 * SECOND)
    assert source.schedule() == 9 * SECOND
    assert source.origin(2 * SECOND, own=5) == 7 * SECOND
    source.close()


def test_every_jump_wakes_and_one_back_is_remembered_until_the_next_origin(clocked):
    woken = []
    source = TimeSource(clocked.node, False, lambda: woken.append(True))
    clocked.tell(7 * SECOND)
    source.origin()
    before = len(woken)
    assert before > 0
    clocked.tell(8 * SECOND)
    assert len(woken) > before
    assert not source.went_back
    clocked.tell(2 * SECOND)
    assert source.went_back
    assert source.origin() == 2 * SECOND
    assert not source.went_back
    source.close()


def test_who_has_stopped_listening_is_woken_no_more(clocked):
    woken = []
    source = TimeSource(clocked.node, False, lambda: woken.append(True))
    source.close()
    clocked.tell(7 * SECOND)
    assert woken == []
    source.close()  # again does no harm
