"""Entries of a journal are changes with what they ask for, and what is in force from then on."""

import json

import numpy as np
import pytest

from rpud_sim.inspection.report.changes import CommandsInForce
from rpud_sim.inspection.report.drill_topics import Journal

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


def test_a_feed_is_in_force_and_only_clear_changes_are_changes():
    arm = {"parameters": {"feed_model": "arm", "weight_on_bit": 10.0}}
    begin, start, like, stop, back = taken(
        ("begin", arm),
        ("feed", {"mode": "rate", "value": 2e-4}),
        ("feed", {"mode": "rate", "value": 2.2e-4}),
        ("feed", {"mode": "rate", "value": 0.0}),
        ("feed", {"mode": "position", "value": -0.01}),
    )
    assert begin.in_force == "weight on bit by the feed"
    assert start.text == "feed at 0.2 mm/s"
    assert start.in_force == "weight on bit by the feed, feed at 0.2 mm/s"
    assert like is None
    assert (stop.text, back.text) == ("feed holds", "feed to -10 mm")


def test_a_feed_that_comes_back_at_once_is_taken_back():
    commands = CommandsInForce()
    commands.take(0.0, "begin", json.dumps({"parameters": {"feed_model": "arm"}}))
    feeds = ((1.0, 1e-3), (1.2, 0.0), (3.0, -1e-3))
    for time, value in feeds:
        commands.take(time, "feed", json.dumps({"mode": "rate", "value": value}))
    assert [(each.time, each.text) for each in commands.changes] == [
        (0.0, "a simulation begins"),
        (3.0, "feed at -1 mm/s"),
    ]
    assert commands.take(9.0, "feed", "{}").text == "feed"


def test_thousands_of_feeds_leave_room_for_other_commands():
    journal = Journal()
    count = 3000
    content = [json.dumps({"mode": "rate", "value": 1e-4 + 1e-8 * n}) for n in range(count)]
    off = json.dumps({"enabled": False, "voltage": 0.0, "frequency": 0.0})
    columns = {
        "kind": np.array(["feed"] * count + ["drive"]),
        "content": np.array([*content, off]),
    }
    journal.add(columns, np.arange(count + 1) / 100.0)
    assert [(kind, time) for time, kind, _ in journal.entries] == [("feed", 0.0), ("drive", 30.0)]
    assert [change.text for change in journal.changes] == ["feed at 0.1 mm/s", "drive off"]
    assert journal.unlisted == count - 1
