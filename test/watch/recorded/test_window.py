"""Answers to a zoom: every message, and the exact waveform that `rpud export --rate` writes."""

import itertools

import numpy as np
import pytest
from altered_bags import altered
from hypothesis import example, given, settings
from hypothesis import strategies as st
from watch.recorded.recorded_bags import DURATION

import rpud_sim.bag
from rpud_sim.inspection.rebuild import rebuild
from rpud_sim.watch.recorded.contents import contents, drills
from rpud_sim.watch.recorded.marks import Marks
from rpud_sim.watch.recorded.overview import Overview
from rpud_sim.watch.recorded.recording import Recording
from rpud_sim.watch.recorded.window import (
    MESSAGES,
    OVERVIEW,
    WAVEFORM,
    WAVEFORM_RANGE,
    Request,
    Windows,
)

RATE = 1_000_000
DRILL = "/rpud"


@pytest.fixture(scope="module")
def recording(drill_bag):
    with Recording(drill_bag) as opened:
        yield opened


@pytest.fixture(scope="module")
def windows(recording):
    overview = Overview(recording)
    overview.sample()
    return Windows(recording, overview)


@pytest.fixture(scope="module")
def rebuilt(drill_bag, tmp_path_factory):
    """Return all samples that `rpud export --rate` writes, and the number of the first."""
    folder = tmp_path_factory.mktemp("rebuilt") / "out"
    first = rebuild(drill_bag, folder, RATE, "numpy").first
    names = ("contact_force", "free_mass_position", "reacting_force", "actuator_velocity")
    return first, {name: np.load(folder / "rpud.trajectory" / f"{name}.npy") for name in names}


@pytest.fixture(scope="module")
def impacts(drill_bag):
    with rpud_sim.bag.open(drill_bag) as reader:
        return reader.arrays("/rpud/contact_force")


def asked(recording, start, end, width=800):
    layers = {
        (number, place): layer
        for number, content in enumerate(contents(recording, DRILL))
        for place, layer in enumerate(content.layers)
    }
    return Request(DRILL, start, end, width, layers)


def named(answer, name):
    """Return the trace of a layer."""
    return next(
        answer.traces[key] for key, layer in answer.request.layers.items() if layer.name == name
    )


@given(st.floats(0.0, DURATION - 0.1), st.floats(2e-6, 0.03))
@settings(max_examples=25)
def test_samples_of_any_range_are_those_of_rebuild_bit_for_bit(windows, rebuilt, start, length):
    first, channels = rebuilt
    waveform = windows.waveform(DRILL, start, start + length, RATE)
    assert waveform.numbers.tolist() == [
        *range(int(np.ceil(start * RATE)), int(np.floor((start + length) * RATE)) + 1)
    ]
    for name, values in channels.items():
        expected = values[waveform.numbers[0] - first : waveform.numbers[-1] + 1 - first]
        assert waveform.channels[name].tobytes() == expected.tobytes(), name


@given(st.integers(0, 200))
@example(36)  # begins under force
@settings(max_examples=15)
def test_a_contact_shows_its_peak(recording, windows, impacts, number):
    number %= len(impacts["peak_force"])
    time = impacts["header.stamp"][number] / 1e9
    duration = impacts["contact_duration"][number]
    request = asked(recording, time - 0.2 * duration, time + 1.2 * duration)
    answer = windows.answer(request)
    assert (answer.detail, answer.complete) == (WAVEFORM, True)
    assert answer.rate == 1_000_000_000
    force = named(answer, "rebuilt force")
    # Another contact may begin within the range.
    inside = (force.x >= time) & (force.x <= time + duration)
    assert inside.sum() > 200
    times, values = force.x[inside], force.y[inside]
    peak = np.nanmax(values)
    # One that begins under force has its peak at once, in a pixel that shows the contact before it.
    pixel = 1.4 * duration / request.width
    fall = (values[0] - values[9]) / (times[9] - times[0]) if peak == values[0] else 0.0
    assert peak == pytest.approx(impacts["peak_force"][number], rel=1e-5, abs=pixel * fall)


def test_the_impact_after_and_before_a_time_are_found(windows, impacts):
    times = impacts["header.stamp"] / 1e9
    for number in (1, 17, len(times) - 1):
        before = windows.impact(DRILL, times[number] - 1e-9, back=True)
        found = windows.impact(DRILL, times[number] - 1e-9)
        assert before.time == times[number - 1]
        assert found.time == times[number]
        assert found.peak_force == impacts["peak_force"][number]
        assert found.duration == impacts["contact_duration"][number]
    assert windows.impact(DRILL, times[-1]) is None
    assert windows.impact(DRILL, times[0], back=True) is None


def test_between_waveform_and_overview_every_message_is_drawn(recording, windows, impacts):
    start, end = 0.5, 0.5 + 2 * WAVEFORM_RANGE
    answer = windows.answer(asked(recording, start, end))
    assert answer.detail == MESSAGES
    times = impacts["header.stamp"] / 1e9
    inside = (times >= start) & (times <= end)
    peaks = named(answer, "peak of an impact")
    assert peaks.x.tolist() == times[inside].tolist()
    assert peaks.y.tolist() == impacts["peak_force"][inside].tolist()


def test_a_long_range_is_drawn_from_the_overview(recording, windows, monkeypatch):
    monkeypatch.setattr("rpud_sim.watch.recorded.window.MESSAGES_RANGE", 1.0)
    answer = windows.answer(asked(recording, 0.0, DURATION))
    assert answer.detail == OVERVIEW
    assert not answer.complete  # only a sample was read
    assert not len(named(answer, "rebuilt force").x)
    assert len(named(answer, "least and greatest peak").x)


def test_a_lost_block_is_a_gap_in_the_waveform(drill_bag, tmp_path):
    numbers = itertools.count()
    path = altered(
        drill_bag,
        tmp_path / "bag",
        lambda m: [] if m.topic == "/rpud/trajectory" and next(numbers) == 4 else [m.data],
    )
    with Recording(path) as recording:
        windows = Windows(recording, Overview(recording))
        waveform = windows.waveform(DRILL, 0.1, 0.4, 100_000)
        assert len(waveform.cuts) == 1
        assert np.diff(waveform.numbers).max() > 4000  # a block has 50 ms
        answer = windows.answer(asked(recording, 0.19, 0.24))
        assert np.isnan(named(answer, "rebuilt force").y).sum() <= 1


def test_without_a_trajectory_messages_are_drawn(drill_bag, tmp_path):
    path = altered(
        drill_bag, tmp_path / "bag", lambda m: [m.data], {"/rpud/contact_force", "/rpud/status"}
    )
    with Recording(path) as recording:
        assert drills(recording) == [DRILL]
        windows = Windows(recording, Overview(recording))
        answer = windows.answer(asked(recording, 0.5, 0.51))
        assert answer.detail == MESSAGES
        assert len(named(answer, "peak of an impact").x)


def test_commands_and_faults_are_marked(recording):
    marks = Marks(recording)
    marks.read_first()
    found = [(mark.kind, mark.time, mark.end, mark.text) for mark in marks.of(DRILL)]
    assert found == [
        ("command", 0.0, None, "a run begins"),
        ("fault", 0.4, pytest.approx(0.7), "bias of reacting_force 5"),
        ("fault", 1.0, None, "restitution_loss 0.5"),
        ("command", DURATION, None, "the drill stopped"),
    ]
    marks.set_gaps([(1.1, 1.2)])
    assert ("gap", 1.1, 1.2) in [(each.kind, each.time, each.end) for each in marks.of(DRILL)]
