"""The commands of a shell with the wheels alone, against a drill in another process."""

import json
import re

import pytest
import yaml
from support import PATIENCE

from rpud_sim.cli.main import main
from rpud_sim.simulation.topics import CHANNELS

PAUSED = {"start_paused": True, "publish_clock": True}
HERE = ("--namespace", "/shell", "--patience", str(PATIENCE))


@pytest.fixture(scope="module")
def drill(start_module_drill):
    return start_module_drill("/shell", **PAUSED)


@pytest.fixture
def rpud(drill, capsys):
    """Call `rpud` in this process; give exit code, standard output and standard error."""

    def call(*words, where=HERE):
        with pytest.raises(SystemExit) as end:
            main([*map(str, words), *where])
        return (end.value.code or 0, *capsys.readouterr())

    return call


@pytest.fixture
def fresh(rpud):
    """Put the drill back to its start, paused."""
    rpud("pause")
    rpud("reset")


def test_a_session_of_commands_acts_on_the_drill(rpud, fresh):
    assert rpud("press", 30) == (0, "weight on bit: 30 N\n", "")
    assert rpud("drive", "--off") == (0, "drive: off, 100 V, 16000 Hz\n", "")
    assert rpud("drive", "--voltage", 80) == (0, "drive: on, 80 V, 16000 Hz\n", "")
    assert rpud("engage", "--off") == (0, "regime: free\n", "")
    assert rpud("engage") == (0, "regime: drilling\n", "")
    assert rpud("set", "real_time_factor=0.5") == (0, "real_time_factor: 0.5\n", "")
    assert rpud("step", 0.25) == (0, "time: 0.250000000 s\n", "")
    _, shown, _ = rpud("echo", "status", "--once")
    [status, nothing] = yaml.safe_load_all(shown)
    assert nothing is None
    assert (status["weight_on_bit"], status["drive_voltage"]) == (30.0, 80.0)
    assert status["header"]["stamp"] == {"sec": 0, "nanosec": 250_000_000}
    assert rpud("reset", "--seed", 7) == (0, "state: paused, time: 0.000000000 s\n", "")
    assert rpud("play") == (0, "state: running\n", "")
    assert rpud("pause") == (0, "state: paused\n", "")


def test_faults_are_injected_listed_and_cleared(rpud, fresh):
    assert rpud("inject", "free_mass_jammed", "--for", 5)[1] == "fault 1: free_mass_jammed\n"
    noise = rpud("inject", "noise", "--channel", "reacting_force", "--magnitude", 0.5)
    assert noise == (0, "fault 2: noise on reacting_force\n", "")
    listed = json.loads(rpud("inject", "--list", "--json")[1])
    assert [fault["kind"] for fault in listed["active"]] == ["free_mass_jammed", "noise"]
    assert listed["active"][1]["magnitude"] == 0.5
    assert set(listed["channels"]) == set(CHANNELS) - {"mount", "rotation"}  # not published
    assert {"free_mass_jammed", "noise", "off"} <= set(listed["kinds"])
    text = rpud("inject", "--list")[1].splitlines()
    assert re.match(r"noise +reacting_force +2 +0.5 +0.000$", text[2])
    assert text[3].startswith("possible kinds: free_mass_jammed, ")
    assert rpud("clear", "noise") == (0, "cleared: 2\n", "")
    assert rpud("clear", 1) == (0, "cleared: 1\n", "")
    rpud("inject", "bias", "--channel", "wrench", "--magnitude", 1)
    assert rpud("clear", "--all") == (0, "cleared: 3\n", "")
    assert rpud("inject", "--list")[1].startswith("no fault is active\n")


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (
            ["press", "-5"],
            "rpud press: the drill rejects it: weight_on_bit = -5 N is outside its ra",
        ),
        (
            ["inject", "noise"],
            "rpud inject: the drill rejects it: noise needs --channel; this drill has nodal_plane, "
            "drill_tool, reacting_force, wrench, contact_force\n",
        ),
        (["clear", "7"], "rpud clear: the drill rejects it: there is no fault 7 to clear"),
        (["clear", "noise"], "rpud clear: the drill rejects it: no fault is active"),
        (["step", "0"], "rpud step: the drill rejects it: step = 0 s is outside its range (0, "),
        (
            ["set", "gravty=1"],
            "rpud set: the drill rejects it: parameter 'gravty' is unknown; did ",
        ),
        (
            ["echo", "reacting_force", "--count", "2", "--duration", "0.1"],
            "rpud echo: 0 of 2 messages on /shell/reacting_force within 0.1 s",
        ),
    ],
)
def test_what_the_drill_refuses_is_one_line_and_exit_code_1(rpud, words, complaint):
    code, output, errors = rpud(*words)
    assert (code, output) == (1, "")
    assert errors.startswith(complaint)
    assert errors.count("\n") == 1


def test_a_field_that_is_not_there_is_a_wrong_call(rpud):
    code, _, errors = rpud("echo", "status", "--once", "--field", "weight_on_bot")
    assert code == 2
    assert errors.endswith("there is no 'weight_on_bot'; did you mean weight_on_bit?\n")


def test_echo_prints_fields_json_lines_and_latched_messages(rpud, fresh):
    rpud("press", 15)
    rpud("step", 0.1)
    code, lines, _ = rpud("echo", "journal", "--count", 2, "--json")
    assert code == 0
    first, second = map(json.loads, lines.splitlines())
    assert second["sequence"] == first["sequence"] + 1
    assert rpud("echo", "status", "--once", "--field", "weight_on_bit")[1] == "15.0\n---\n"
    assert rpud("echo", "/clock", "--once", "--field", "clock.nanosec")[1] == "100000000\n---\n"
