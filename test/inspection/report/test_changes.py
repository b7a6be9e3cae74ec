"""Entries of a journal are changes with what they ask for, and what is in force from then on."""

import json

import pytest

from rpud_sim.inspection.report.changes import CommandsInForce

BEGIN = {"parameters": {"weight_on_bit": 10.0, "free_mass": 0.005}}


def taken(*entries):
    commands = CommandsInForce()
    return [
        commands.take(
            float(time), kind, content if isinstance(content, str) else json.dumps(content)
        )
        for time, (kind, content) in enumerate(entries)
    ]


def test_commands_stay_in_force_until_the_next_one():
    begin, press, drive, off, again = taken(
        ("begin", BEGIN),
        ("weight_on_bit", {"force": 20.0}),
        ("drive", {"enabled": True, "voltage": 80.0, "frequency": 16000.0}),
        ("drive", {"enabled": False, "voltage": 0.0, "frequency": 0.0}),
        ("begin", BEGIN),
    )
    assert (begin.text, begin.in_force) == ("a simulation begins", "weight on bit 10 N")
    assert (press.text, press.weight_on_bit) == ("weight on bit 20 N", 20.0)
    assert drive.in_force == "weight on bit 20 N, drive 80 V at 16000 Hz"
    assert off.in_force == "weight on bit 20 N, drive off"
    assert again.in_force == "weight on bit 10 N"


def test_changed_parameters_are_named():
    _, change, same = taken(
        ("begin", BEGIN),
        ("configure", {"parameters": {"weight_on_bit": 10.0, "free_mass": 0.006}}),
        ("configure", {"parameters": {"free_mass": 0.006}}),
    )
    assert change.text == "parameters: free_mass 0.006"
    assert same.text == "parameters"
    [many] = taken(("configure", {"parameters": {f"p{n}": n for n in range(9)}}))
    assert many.text.endswith("p5 5 and 3 more")


def test_what_a_checkpoint_holds_is_not_known():
    _, change = taken(("begin", BEGIN), ("restore", {"name": "a"}))
    assert (change.text, change.in_force, change.weight_on_bit) == ("restore of a", "", None)


def test_what_changes_nothing_is_no_change():
    assert (
        taken(("origin", {}), ("stop", {}), ("flush", {}), ("inject", {}), ("end", {}))
        == [None] * 5
    )


@pytest.mark.parametrize("content", ["", "[]", "null", '{"force": "a"}', "[" * 100_000, "{}"])
def test_content_of_another_program_is_no_failure(content):
    [change] = taken(("weight_on_bit", content))
    assert change.text == "weight_on_bit"
