"""Nodes under test of a drill: how they are started, connected, paused, and told of."""

import math
from unittest.mock import MagicMock

import pytest
from sensor_msgs.msg import JointState

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.testing import SystemUnderTestError
from rpud_sim.testing.nodes import Answers
from rpud_sim.verdicts import always
from rpud_sim.verdicts import signal as field

HEARTBEAT = "supervisor/heartbeat"


def supervise(drill, how="works", node="supervisor", answers=HEARTBEAT):
    remap = f"--ros-args -r __ns:={drill.namespace} -r __node:={node} -r {HEARTBEAT}:={answers}"
    return drill.start(
        f"python ../helpers/supervisor.py {how} {remap}", subscribes_to=("reacting_force",)
    )


def test_a_reset_begins_again_beside_the_same_node(drill):
    drill.with_answers(HEARTBEAT)
    supervise(drill)
    drill.step(0.3)
    drill.reset(seed=3)
    assert (drill.time, drill.seed) == (0.0, 3)
    assert drill.step(0.2) == pytest.approx(0.2)
    assert drill.status.header.stamp.nanosec == 200_000_000
    assert drill.status.commands_accepted == len(drill.messages("command/weight_on_bit")) == 2
    assert len(drill.messages("reacting_force")) == 20
    assert drill.expect(always(field("reacting_force.force") < "450 N"))
    assert [text for _, text in drill.log][-3:] == [
        "step to 0.3 s",
        "reset seed=3",
        "step to 0.2 s",
    ]


@pytest.mark.parametrize(
    "action",
    [
        lambda client: client.step(0.1),
        lambda client: client.run_to(1.0),
        lambda client: client.play(),
        lambda client: client.reset("all"),
    ],
)
def test_what_would_go_past_the_lockstep_is_refused(drill, action):
    with pytest.raises(ParameterError, match=r"would go past .* call drill\.(step|reset)"):
        action(drill.client)


def test_two_publishers_of_one_answer_are_named(drill):
    drill.with_answers(HEARTBEAT)
    supervise(drill)
    supervise(drill, node="second")
    expected = "has 2 publishers, /rpud/second and /rpud/supervisor, and count=1"
    with pytest.raises(ParameterError, match=expected):
        drill.step(10.0)
    assert "second" in drill.systems[1].name


@pytest.mark.extended
def test_a_node_in_the_place_of_a_killed_one_is_introduced_anew(drill):
    drill.with_answers(HEARTBEAT)
    for number in (1, 2):
        supervisor = supervise(drill)
        drill.step(0.2)
        assert drill.status.commands_accepted == 2 * number
        supervisor.kill()


def test_a_killed_node_is_forgotten_with_all_that_it_published(drill):
    drill.with_answers(HEARTBEAT, "alive")
    supervisor = supervise(drill)
    supervise(drill, node="watchdog", answers="alive")
    drill.step(0.2)
    supervisor.kill()
    drill.with_answers("alive")
    drill.step(0.2)  # a warning says where it waits for the parameters of a node that is gone
    drill.begin(0)
    drill.with_answers(HEARTBEAT)
    supervise(drill)
    drill.step(0.2)
    assert drill.status.commands_accepted == 2


@pytest.mark.extended
def test_a_node_that_cannot_be_asked_has_some_time_and_a_warning(drill):
    drill.with_answers("command/weight_on_bit")
    with pytest.warns(UserWarning, match=r"^/rpud/commander does not answer get_parameters"):
        drill.start("python ../helpers/commander.py mute", subscribes_to=("reacting_force",))
    drill.step(0.2)
    assert drill.status.commands_accepted == 2


@pytest.mark.extended
def test_a_node_that_never_answers_is_waited_for_once(drill):
    supervise(drill, node="caller").kill()  # of the same name, and calls nothing
    for limit in ("within 2 s", "within 1 s, as in a test before"):
        drill.begin(0)
        drill.with_answers(HEARTBEAT, timeout=2.0)
        supervise(drill, "calls", node="caller")
        with pytest.raises(SystemUnderTestError, match=limit) as error:
            drill.step(0.1)
        assert "/rpud/caller calls /rpud/nowhere, which no node serves" in str(error.value)


def test_a_start_that_fails_says_in_one_line_why(drill):
    for command, options, text in (
        ("nosuch --fast", {}, "^nosuch cannot be started: No such file or directory$"),
        ("python nowhere.py", {}, r"exit code 2, at 0\.000 s of simulation time"),
        ("python -c 1/0", {}, "^python -c ended with exit code 1"),
        ("sleep 100", {"timeout": 0.5}, r"is not connected to the drill within 0\.5 s"),
        (
            "sleep 100",
            {"subscribes_to": ("wrench",), "timeout": 0.1},
            r"not subscribe to wrench within 0",
        ),
        (
            "sleep 100",
            {"subscribes_to": ("reacting_forc",), "timeout": 0.1},
            "did you mean reacting_forc",
        ),
    ):
        with pytest.raises(SystemUnderTestError, match=text):
            drill.start(command, **options)


def test_a_paused_node_is_silent_until_it_goes_on(drill):
    drill.with_answers(HEARTBEAT)
    supervisor = supervise(drill)
    drill.step(0.2)
    supervisor.pause()
    drill.with_answers()
    drill.step(0.2)
    assert len(drill.messages("command/weight_on_bit")) == 2
    supervisor.resume()
    drill.with_answers(HEARTBEAT)
    drill.step(0.2)
    assert len(drill.messages(HEARTBEAT)) == 6
    supervisor.kill()
    drill.step(0.2)  # without waiting for it
    texts = [text for _, text in drill.log]
    assert [text for text in texts if text.startswith("SIG")] == [
        "SIGSTOP to supervisor.py",
        "SIGCONT to supervisor.py",
        "SIGKILL to supervisor.py",
    ]


@pytest.mark.rpud(feed_model="arm")
def test_commands_to_joints_are_commands_and_what_commands_no_feed_is_none(drill):
    publisher = drill.client.node.create_publisher(JointState, "joint_commands", 10)
    drill.client.until(lambda: publisher.get_subscription_count() == 2)
    drill.await_connections()
    for rate in (0.001, math.nan, -0.001):
        publisher.publish(JointState(name=["rpud_feed"], position=[math.nan], velocity=[rate]))
    drill.step(0.01)
    assert len(drill.messages("joint_commands")) == 3
    assert drill.status.commands_accepted == 2
    drill.client.node.destroy_publisher(publisher)


def test_an_answer_of_before_a_reset_is_none():
    """It has a later stamp, and may arrive after the reset."""
    heard = [300_000_000]
    topic = MagicMock(stamped=True, stamps=heard)
    answers = Answers(MagicMock(subscribe=lambda *_: topic), MagicMock())
    answers.declare(("heartbeat",))
    answers.connect()
    assert answers.missing(200_000_000)
    heard.append(200_000_000)
    assert not answers.missing(200_000_000)
