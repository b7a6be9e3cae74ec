"""Commands are checked when they are made or read, and act unless lost or while inactive."""

import math

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_values import contents
from support import examples, refusal

from rpud_sim.simulation import Parameters
from rpud_sim.simulation.changes import (
    parameter_changes,
)
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import Configuration, Settings
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.scenario_file import parse_injections, read_commands

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
NOMINAL = Drive(True, 100.0, 16000.0)
OFF = Drive(False, 0.0, 0.0)


def made(timeout=0.0, ramp=0.5, active=True, **options):
    drill = Configuration(Parameters(weight_on_bit=10.0), **options)
    settings = Settings(drill, command_timeout=timeout, command_loss_ramp=ramp)
    run = Run(Plan(Beginning(settings)), wanted=None, active=active)
    run.begin()
    run.take_over()
    run.activate(active)
    return run


def acting(run):
    applied = run.simulation.applied
    return applied.weight_on_bit.force, applied.drive.voltage if applied.drive.enabled else 0.0


def acts_at(run, time):
    """Advance, and let what is due act; give whether commands are lost, and what acts."""
    run.finish(time)
    run.watch()
    return run.commands_lost, acting(run)


def test_lost_commands_ramp_down_are_reported_once_and_come_back_whole():
    run = made(timeout=0.1, ramp=0.2)
    found = [acts_at(run, ms * MILLISECOND) for ms in (100, 150, 200, 300)]
    assert found == [
        (False, (10.0, 100.0)),
        (True, (7.5, 75.0)),
        (True, (5.0, 50.0)),
        (True, (0.0, 0.0)),
    ]
    # A weight on bit alone shows that there is a commander, and so the drive comes back as well.
    run.apply(WeightOnBit(20.0))
    assert run.watch()
    assert not run.commands_lost
    assert acting(run) == (20.0, 100.0)
    assert run.simulation.applied.drive == NOMINAL


def test_the_watchdog_does_not_wait_while_inactive():
    run = made(timeout=0.1, ramp=0.1, active=False)
    assert acts_at(run, SECOND) == (False, (0.0, 0.0))
    run.activate(True)
    assert not run.watch()
    assert acting(run) == (10.0, 100.0)
    assert acts_at(run, SECOND + 150 * MILLISECOND) == (True, (5.0, 50.0))


commands = st.one_of(
    st.builds(WeightOnBit, st.floats(0.0, 60.0)),
    st.builds(Drive, st.just(True), st.floats(0.0, 200.0), st.floats(8e3, 40e3)),
    st.just(OFF),
)


@settings(max_examples=examples(50))
@given(st.lists(st.one_of(commands, st.booleans(), st.integers(1, 400)), min_size=1, max_size=20))
def test_it_never_acts_more_than_commanded_and_not_at_all_while_inactive(events):
    run = made(timeout=0.05, ramp=0.1)
    weight_on_bit, drive = run.simulation.applied.weight_on_bit, run.simulation.applied.drive
    for event in events:
        if isinstance(event, bool):
            if event and not run.active:
                weight_on_bit, drive = WeightOnBit(10.0), NOMINAL
            run.activate(event)
        elif isinstance(event, int):
            run.finish(run.time + event * MILLISECOND)
        else:
            run.apply(event)
            if run.active and isinstance(event, WeightOnBit):
                weight_on_bit = event
            elif run.active:
                drive = event.after(drive)
        run.watch()
        found, given_now = acting(run), (weight_on_bit.force, drive.voltage * drive.enabled)
        if not run.active:
            assert found == (0.0, 0.0)
        elif run.commands_lost:
            assert found[0] <= given_now[0]
            assert found[1] <= given_now[1]
        else:
            assert found == given_now
            assert run.simulation.applied.drive.enabled == drive.enabled


@pytest.mark.parametrize("enabled", [True, False])
@pytest.mark.parametrize(
    "value", [math.nan, math.inf, True, "30", None, [30.0], 10**400, -1.0, 1e9]
)
def test_a_value_outside_its_range_is_refused_even_when_off(enabled, value):
    wrong = refusal(WeightOnBit, value)
    assert "N is outside its range [0, 1000] N" in wrong or "is not a number" in wrong
    voltage = refusal(Drive, enabled, value, 16000.0)
    frequency = refusal(Drive, enabled, 100.0, value)
    for found, name in ((voltage, "drive voltage"), (frequency, "drive frequency")):
        assert found.startswith(f"{name} = ")
        assert "is outside its range" in found or "is not a number" in found


def test_a_drive_that_is_on_needs_a_frequency_and_one_that_is_off_does_not():
    assert refusal(Drive, True, 100.0, 0.0).startswith(
        "drive frequency = 0 Hz is outside its range"
    )
    assert repr(Drive(False, 0, 0)) == repr(Drive(False, 0.0, -0.0)) == repr(OFF)
    assert refusal(Drive, 1, 100.0, 16000.0) == "drive enabled = 1 is not true or false"


@pytest.mark.parametrize(
    ("make", "given", "reason"),
    [
        (parameter_changes, {"free_mass": 1}, "free_mass cannot change during a run"),
        (parse_injections, ["noise,kind=bias"], "'noise,kind=bias' gives a key twice"),
        (parse_injections, ["noise,channel=wrench,magnitude=x"], "= 'x' is not a number"),
    ],
)
def test_a_change_that_cannot_be_is_named(make, given, reason):
    assert reason in refusal(make, given)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[]", ":1: the file is not a mapping"),
        ("comands: []", "'comands' is not a key here; did you mean commands?"),
        (
            "commands: [{time: 1}]",
            ":1: a command has a weight_on_bit, drive, feed or mount",
        ),
        ("commands: [{time: 1, drive: {frequency: .nan}}]", "drive frequency = nan"),
        ("commands: [{time: 1, feed: {rate: 1, position: 2}}]", ":1: feed"),
        ("commands: [{time: 1, mount: {velocity: 1}}]", ":1: position is missing"),
        ("commands: [{time: 1, mount: {position: 2}}]", "mount position = 2 m is outside"),
    ],
)
def test_a_command_file_that_cannot_be_is_named(tmp_path, text, reason):
    path = tmp_path / "commands.yaml"
    path.write_text(text)
    found = refusal(read_commands, path)
    assert found.startswith(str(path))
    assert reason in found


_, VALUES = contents(("time", "weight_on_bit", "drive", "feed", "rate", "voltage"), ("off", "1 s"))


@given(st.lists(VALUES, max_size=3) | VALUES)
def test_any_command_file_is_used_or_refused_in_one_line(tmp_path_factory, commands):
    path = tmp_path_factory.getbasetemp() / "commands.yaml"
    path.write_text(yaml.safe_dump({"commands": commands}))
    found = refusal(read_commands, path)
    assert not found or found.startswith(str(path))
