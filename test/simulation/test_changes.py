"""Changes of a run, as the command line and a command file give them."""

import pytest
from support import refusal

from rpud_sim.simulation.changes import (
    Changes,
    Planned,
    parameter_changes,
    parse_injections,
    read_commands,
)
from rpud_sim.simulation.commands import Feed


@pytest.mark.parametrize(
    ("make", "given", "reason"),
    [
        (parameter_changes, {"free_mas": 1}, "did you mean free_mass"),
        (parameter_changes, {"free_mass": 1}, "free_mass cannot change during a run"),
        (parse_injections, ["nois,channel=wrench"], "did you mean noise"),
        (parse_injections, ["noise,chanel=wrench"], "'chanel' is not one of kind, channel"),
        (parse_injections, ["noise,channel=wrench,magnitude=x"], "= 'x' N is outside its range"),
    ],
)
def test_a_change_that_cannot_be_is_named(make, given, reason):
    assert reason in refusal(make, given)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[]", "is not a scenario"),
        ("comands: []", "'comands' is not one of seed, faults"),
        ("commands: 3", "commands = 3 is not a list"),
        ("commands: [{time: 1}]", "command 1: it needs a time, and weight_on_bit, drive or feed"),
        ("commands: [{time: -1, weight_on_bit: 2}]", "command 1: time = -1 s is outside"),
        ("commands: [{time: 1, weight_on_bit: -2}]", "weight_on_bit = -2 N is outside"),
        ("commands: [{time: 1, weigth: 2}]", "'weigth' is not one of"),
        ("commands: [{time: 1, drive: {enabled: maybe}}]", "'maybe' is not true or false"),
        ("commands: [{time: 1, drive: {frequency: .nan}}]", "drive frequency = nan"),
        ("commands: [{time: 1, feed: 0.1}]", "command 1: feed"),
        ("commands: [{time: 1, feed: {rate: 1, position: 2}}]", "command 1: feed"),
        ("commands: [{time: 1, feed: {rate: fast}}]", "command 1: feed"),
    ],
)
def test_a_command_file_that_cannot_be_is_named(tmp_path, text, reason):
    path = tmp_path / "commands.yaml"
    path.write_text(text)
    found = refusal(read_commands, path)
    assert found.startswith(str(path))
    assert reason in found


def test_a_command_file_holds_feeds(tmp_path):
    file = tmp_path / "commands.yaml"
    file.write_text(
        "commands:\n- {time: 0.5, feed: {position: 0.002}}\n- {time: 0, feed: {rate: 1.0e-3}}\n"
    )
    planned = (Planned(0, Feed("rate", 1e-3)), Planned(500_000_000, Feed("position", 2e-3)))
    assert read_commands(file) == Changes(planned=planned, replaces_commands=True)


def test_nothing_differs_without_changes():
    assert Changes().empty
    assert not Changes(replaces_commands=True).empty
    assert (Changes() + Changes()).empty
