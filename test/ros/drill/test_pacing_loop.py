"""One thread moves the drill, and serves requests between two blocks until it ends."""

import re
import signal
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest
from rpud_msgs.msg import Status
from support import PATIENCE, until

from rpud_sim.ros.drill import publishers
from rpud_sim.ros.drill.commands import Inbox
from rpud_sim.ros.drill.pacing_loop import PacingLoop
from rpud_sim.ros.drill.session import Session
from rpud_sim.ros.threads import RequestError
from rpud_sim.simulation.configuration import Settings

NO_OTHERS = SimpleNamespace(count=lambda: 0)  # of the same name
SECOND = 1_000_000_000
PERIOD = SECOND // 100
LISTENER = """
import rclpy
from rpud_msgs.msg import Status
rclpy.init()
node = rclpy.create_node("listener", namespace="/rpud")
node.create_subscription(Status, "status", lambda m: print("state", m.state, flush=True), 10)
rclpy.spin(node)
"""


@pytest.fixture
def start(drill_node):
    """Start the thread of a drill; it is stopped at the end of the test."""
    loops = []

    def create(restored=lambda settings: None, end=10**18, begin=True, **values):
        settings = Settings().replace(values)
        loops.append(PacingLoop())
        inbox = Inbox(drill_node.get_logger(), loops[-1].wake)
        session = Session(drill_node, settings, inbox, NO_OTHERS, restored, end)
        loops[-1].configure(session)
        if begin:
            loops[-1].start(settings)
        return loops[-1], session

    yield create
    for loop in loops:
        loop.clean_up()


def test_before_the_start_a_request_is_refused(start):
    loop, _ = start(begin=False)
    assert loop.started is None
    with pytest.raises(RequestError, match="the node has not been activated"):
        loop.request(lambda session: None)


@pytest.mark.parametrize("factor", [0.0, 1.0, 100.0])
def test_it_ends_where_the_simulation_ends_and_refuses_what_comes_later(start, factor):
    loop, session = start(end=5 * PERIOD, real_time_factor=factor)
    until(lambda: loop.finished)
    loop.stop()
    assert (loop.failure, session.run.time) == (None, 5 * PERIOD)
    with pytest.raises(RequestError, match="the drill has stopped"):
        loop.request(lambda session: None)


@pytest.mark.parametrize(("longest", "lacking"), [(60.0, []), (0.2, ["status"])])
def test_its_end_awaits_a_subscriber_that_the_machine_holds_up_or_names_what_it_may_lack(
    start, process, capfd, monkeypatch, longest, lacking
):
    monkeypatch.setattr(publishers, "LAST_WAIT", longest)
    loop, session = start()
    listener = process(sys.executable, "-c", LISTENER)
    listener.wait_for_line(f"state {Status.STATE_RUNNING}")
    session.publishers.own.lost = lambda name: False  # it counts as running all the same
    listener.send(signal.SIGSTOP)
    with ThreadPoolExecutor(1) as pool:
        ending = pool.submit(loop.stop)
        if not lacking:
            until(lambda: session.reporter.last.status["state"] == Status.STATE_STOPPED)
            listener.send(signal.SIGCONT)
        ending.result()
    log = capfd.readouterr().err
    named = re.findall(r"the last messages of (\w+) may be lost: a subscriber did not", log)
    assert named == lacking
    listener.send(signal.SIGCONT)
    listener.wait_for_line(f"state {Status.STATE_STOPPED}")


@pytest.mark.parametrize("factor", [0.01, 1.0])
def test_requests_act_at_block_boundaries_in_the_order_in_which_they_came(start, factor):
    loop, _ = start(real_time_factor=factor)
    times = [loop.request(lambda session: session.run.time) for _ in range(20)]
    assert times == sorted(times)
    assert all(time % PERIOD == 0 for time in times)


def test_what_a_request_asks_for_itself_is_done_at_once(start):
    asked = []

    def restored(settings):  # the node sets its parameters, which asks the drill to configure
        asked.append(loop.request(lambda session: (threading.current_thread().name, settings)))

    loop, _ = start(restored, start_paused=True, command_timeout=2.0)
    loop.request(lambda session: session.configure(Settings(start_paused=True)))
    loop.request(lambda session: session.reset(time=True, state=True))
    assert asked == [("pacing", Settings(start_paused=True, command_timeout=2.0))]


def test_a_stop_ends_a_step_with_an_error_and_a_standstill_at_once(start):
    loop, session = start(start_paused=True)
    reached = loop.request(lambda session: session.step(PERIOD))
    assert reached.stamp == session.run.origin + PERIOD
    failures = []

    def step():
        try:
            loop.request(lambda session: session.step(10**6 * SECOND))
        except RequestError as error:
            failures.append(str(error))

    stepper = threading.Thread(target=step)
    stepper.start()
    until(lambda: session.timeline.goal is not None)
    loop.stop()
    stepper.join(PATIENCE)
    assert failures == ["interrupted: the drill has stopped"]
    assert loop.failure is None


def test_an_error_ends_it_and_every_request(start, tmp_path):
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("faults: []\n")
    loop, session = start(scenario=str(scenario))
    scenario.unlink()
    with pytest.raises(Exception, match=r"scenario\.yaml: No such file"):
        loop.request(lambda session: session.reset(time=True, state=True))
    assert not loop.finished  # the error is the client's

    def fail():
        raise OSError("the disk is gone")

    session.act = fail
    until(lambda: loop.finished)
    assert str(loop.failure) == "the disk is gone"
    with pytest.raises(RequestError):
        loop.request(lambda session: None)
