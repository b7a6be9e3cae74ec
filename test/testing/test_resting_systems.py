"""Processes that are kept rest between tests, and nothing of a test reaches the next one."""

import pytest
from support import extended

from rpud_sim.testing import SystemUnderTestError, systems

NODE = "../helpers/resting.py"
TOPICS = ("contact_force", "reacting_force")


def start(drill, how="leaves", keep="resting/leave"):
    drill.with_answers("resting/answer")
    command = ("python", NODE, how)
    return drill.start(*command, subscribes_to=TOPICS, ready="it is there", keep=keep)


def begin_next_test(drill):
    drill.begin(0)
    assert drill.systems == ()


def test_a_node_that_was_kept_begins_as_one_that_was_started(drill):
    found = []
    for _ in range(3):
        process = start(drill)
        drill.listen("resting/state")  # latched: one that was kept publishes it again
        drill.step(0.3)
        found.append(
            (
                process.pid,
                process.output.count("it is there"),
                [each.data for each in drill.messages("resting/state")],
                [each.frame_id for each in drill.messages("resting/answer")],
                [each.header.stamp for each in drill.messages("command/weight_on_bit")],
                drill.status.commands_accepted,
            )
        )
        drill.with_answers()
        drill.step(1.0)  # further than the node has time for: impacts wait when the test ends
        begin_next_test(drill)
    assert found[0] == found[1] == found[2]
    assert found[0][1:4] == (1, ["begun"], ["0", "0", "0"])
    assert found[0][5] == 3


def test_other_arguments_start_another_process(drill):
    first = start(drill)
    begin_next_test(drill)
    second = start(drill, keep="")
    begin_next_test(drill)
    third = start(drill)
    assert first.pid == third.pid != second.pid
    assert not second.running


@pytest.mark.parametrize("end", [extended("ends"), "kill", extended("pause")])
def test_a_process_that_does_not_rest_is_started_again(drill, end):
    first = start(drill, "ends" if end == "ends" else "leaves")
    if end != "ends":
        getattr(first, end)()
    begin_next_test(drill)
    second = start(drill, "ends" if end == "ends" else "leaves")
    drill.step(0.1)
    assert first.pid != second.pid
    assert not first.running


def test_a_process_that_dies_while_it_rests_is_started_again(drill):
    first = start(drill)
    begin_next_test(drill)
    assert first.running
    first.kill()
    second = start(drill)
    drill.step(0.1)
    assert first.pid != second.pid


def test_a_node_that_does_not_leave_is_ended_with_a_warning(drill, monkeypatch):
    monkeypatch.setattr(systems, "_REST", 1.0)  # it stays for ever
    first = start(drill, "stays")
    with pytest.warns(UserWarning, match=r"resting.py is still in the graph 1 s after a call of /"):
        begin_next_test(drill)
    assert not first.running
    drill.step(0.1)


@pytest.mark.extended
def test_a_service_that_the_node_does_not_have_is_named(drill):
    expected = "has no service /rpud/resting/part of std_srvs/srv/Empty or std_srvs/srv/Trigger"
    with pytest.raises(SystemUnderTestError, match=expected):
        drill.start("python", NODE, "leaves", subscribes_to=TOPICS, keep="resting/part", timeout=5)


@pytest.mark.extended
def test_those_that_rest_longest_end(drill):
    started = []
    for number in range(4):
        started.append(start(drill, f"leaves{number}"))
        begin_next_test(drill)
    assert [each.running for each in started] == [False, True, True, True]
