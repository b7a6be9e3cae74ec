"""Frames of a page: what has changed, and nothing that JSON has not."""

import base64
import dataclasses
import json
import math

import numpy as np
import pytest

from rpud_sim.ros.client.plain_message import to_json_value
from rpud_sim.watch.frames import Frames
from rpud_sim.watch.picture import COLUMNS, CONNECTED, Connection, Picture, Section, Series

POWERS = {
    "actuator_power": 40.0,
    "weight_power": -2.0,
    "change_power": 0.0,
    "load_damper_power": 1.0,
    "collision_power": 0.0,
    "absorbed_power": 36.0,
    "stored_power": 1.0,
}


def series(first, count):
    rows = np.arange(first, first + count, dtype=float)[:, None] * np.ones(len(COLUMNS))
    return Series(first, 0.05, COLUMNS, rows)


def picture(version, **fields):
    connection = Connection(CONNECTED, 0.0)
    return Picture("/rpud", connection, run=fields.pop("run", 1), version=version, **fields)


def first_column(part):
    values = np.frombuffer(base64.b64decode(part["rows"]))
    return values[:: part["columns"]].tolist()


def test_a_browser_gets_the_past_at_once_and_then_what_may_have_changed():
    frames = Frames("/rpud")
    whole = frames.next(picture(1, series=series(100, 300)))
    assert first_column(whole["series"]) == list(range(100, 400))
    later = frames.next(picture(2, series=series(110, 300)))
    assert later["series"]["first"] == 360
    assert later["series"]["kept"] == 110
    assert first_column(later["series"])[-1] == 409


def test_a_new_run_begins_with_empty_plots():
    frames = Frames("/rpud")
    frames.next(picture(1, series=series(100, 300)))
    again = frames.next(picture(2, run=2, series=series(0, 3)))
    assert again["began"]
    assert first_column(again["series"]) == [0.0, 1.0, 2.0]


def test_nothing_new_is_no_frame():
    frames = Frames("/rpud")
    same = picture(1)
    assert frames.next(same) is not None
    assert frames.next(same) is None
    frames.refuse("no such action")
    assert frames.next(same)["refusal"] == [1, "no such action"]


def test_frames_that_are_due_and_left_out_are_counted():
    frames = Frames("/rpud")
    frames.next(picture(1))
    frames.drop(picture(1))  # nothing new: nothing is left out
    frames.drop(picture(2))
    frames.drop(picture(3))
    assert frames.next(picture(4))["dropped"] == 2


def test_a_block_of_the_waveform_is_sent_when_it_is_wanted():
    frames = Frames("/rpud")
    arrays = [np.zeros(3) for _ in range(6)]
    first = picture(1, section=Section(0.0, 1e-3, *arrays))
    assert frames.next(first)["section"]["time"] == 0.0
    second = picture(2, section=Section(1.0, 1e-3, *arrays))
    assert "section" not in frames.next(second)
    frames.want_section()
    assert frames.next(second)["section"]["time"] == 1.0


@pytest.mark.parametrize("power", [40.0, -40.0, 0.0, math.nan])
def test_powers_are_a_picture_whatever_their_sign(power):
    status = {**POWERS, "actuator_power": power, "depth": math.nan, "state": "running"}
    frame = Frames("/rpud").next(picture(1, status=status))
    text = json.dumps(to_json_value(frame), allow_nan=False)
    assert json.loads(text)["status"]["depth"] is None
    assert frame["flow"].startswith("<div")


def test_texts_of_strangers_have_no_characters_that_steer():
    connection = Connection(CONNECTED, 0.0, "a\x1b[31m\u202eb")
    frame = Frames("/rpud").next(dataclasses.replace(picture(1), connection=connection))
    assert frame["connection"]["reason"] == r"a\x1b[31m\u202eb"
