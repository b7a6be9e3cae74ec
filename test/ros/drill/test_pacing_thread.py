"""One thread moves the drill: it serves requests between blocks, and ends with an answer to all."""

import threading

import pytest
import rclpy
from support import until

from rpud_sim.ros.drill.drilling import Drilling
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.namesakes import DuplicateNodes
from rpud_sim.ros.drill.pacing_thread import PacingThread
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.status_reporter import StatusReporter
from rpud_sim.ros.drill.time_control import InterruptedStepError
from rpud_sim.ros.requests import StoppedError
from rpud_sim.simulation.configuration import Settings

SECOND = 1_000_000_000
PERIOD = SECOND // 100


@pytest.fixture
def start():
    """Start the thread of a drill; it is stopped at the end of the test."""
    rclpy.init()
    node = rclpy.create_node("drill_node", namespace="/rpud")
    threads, drillings = [], []

    def create(restored=lambda settings: None, end=10**18, begin=True, **values):
        settings = Settings().replace(values)
        inbox = Inbox(node.get_logger())
        publishers = DrillPublishers(node, settings.publish_clock)
        reporter = StatusReporter(
            node, settings.telemetry_rate, publishers, inbox, DuplicateNodes(node)
        )
        drillings.append(Drilling(node, settings, publishers, reporter, inbox, restored, end))
        threads.append(PacingThread(drillings[-1]))
        if begin:
            threads[-1].start(settings)
        return threads[-1], drillings[-1]

    yield create
    for thread, drilling in zip(threads, drillings, strict=True):
        thread.stop()
        drilling.close()
    node.destroy_node()
    rclpy.try_shutdown()


def test_before_the_start_a_request_is_refused(start):
    thread, _ = start(begin=False)
    assert not thread.started
    with pytest.raises(StoppedError, match="the node has not been activated"):
        thread.request(lambda drilling: None)


@pytest.mark.parametrize("factor", [0.0, 1.0, 100.0])
def test_it_ends_where_the_simulation_ends_and_refuses_what_comes_later(start, factor):
    thread, drilling = start(end=5 * PERIOD, real_time_factor=factor)
    until(lambda: thread.finished)
    assert thread.failure is None
    assert drilling.run.time == 5 * PERIOD
    thread.stop()
    assert drilling.run.time == 5 * PERIOD
    with pytest.raises(StoppedError, match="the drill has stopped"):
        thread.request(lambda drilling: None)


@pytest.mark.parametrize("factor", [0.01, 1.0])
def test_requests_act_at_block_boundaries_in_the_order_in_which_they_came(start, factor):
    thread, _ = start(real_time_factor=factor)
    times = [thread.request(lambda drilling: drilling.run.time) for _ in range(20)]
    assert times == sorted(times)
    assert all(time % PERIOD == 0 for time in times)


def test_what_a_request_asks_for_itself_is_done_at_once(start):
    asked = []

    def restored(settings):  # the node sets its parameters, which asks the drill to configure
        asked.append(thread.request(lambda drilling: (threading.current_thread().name, settings)))

    thread, _ = start(restored, start_paused=True, command_timeout=2.0)
    thread.request(lambda drilling: drilling.configure(Settings(start_paused=True)))
    thread.request(lambda drilling: drilling.reset(time=True, state=True))
    assert asked == [("pacing", Settings(start_paused=True, command_timeout=2.0))]


def test_a_stop_ends_a_step_with_an_error_and_a_standstill_at_once(start):
    thread, drilling = start(start_paused=True)
    reached = thread.request(lambda drilling: drilling.step(PERIOD))
    assert reached.stamp == drilling.run.origin + PERIOD
    failures = []

    def step():
        try:
            thread.request(lambda drilling: drilling.step(10**6 * SECOND))
        except InterruptedStepError as error:
            failures.append(str(error))

    stepper = threading.Thread(target=step)
    stepper.start()
    until(lambda: drilling.time_control.stepping)
    thread.stop()
    stepper.join(10.0)
    assert failures == ["the drill has stopped"]
    assert thread.failure is None


def test_an_error_ends_it_and_every_request(start, tmp_path):
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("faults: []\n")
    thread, drilling = start(scenario=str(scenario))
    scenario.unlink()
    with pytest.raises(Exception, match=r"scenario\.yaml: No such file"):
        thread.request(lambda drilling: drilling.reset(time=True, state=True))
    assert not thread.finished  # the error is the client's

    def fail():
        raise OSError("the disk is gone")

    drilling.advance = fail
    until(lambda: thread.finished)
    assert str(thread.failure) == "the disk is gone"
    with pytest.raises(StoppedError):
        thread.request(lambda drilling: None)
