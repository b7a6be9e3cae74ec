"""Plots over time have the form that their data ask for."""

import numpy as np
import pytest

from rpud_sim.bag.columns import Column, Kind
from rpud_sim.inspection.report.changes import Change
from rpud_sim.inspection.report.drill_topics import CHANNELS, Waveform
from rpud_sim.inspection.report.running_statistics import Envelope
from rpud_sim.inspection.report.time_plots import TimePlots, closer
from rpud_sim.inspection.report.topic_survey import Series
from rpud_sim.pages.plot import FAULT, Line, Mark
from rpud_sim.pages.plot import Envelope as EnvelopeLayer

TIMES = np.arange(0.0, 10.0, 0.001)


def plot(values, unit="N"):
    series = Series(Column("some_force", Kind.NUMBER, unit=unit), Envelope(10.0))
    series.values.add(values)
    series.envelope.add(TIMES, values)
    series.changing.add(TIMES, values)
    return TimePlots(10.0, []).series(series)


def test_what_changes_seldom_is_steps_and_other_values_are_an_envelope():
    [steps] = plot(np.where(TIMES < 2.5, 1.0, 3.0)).layers
    assert isinstance(steps, Line)
    assert steps.steps
    assert (list(steps.x), list(steps.y)) == ([0.0, 2.5, TIMES[-1]], [1.0, 3.0, 3.0])
    drawn = plot(2000.0 + np.sin(TIMES))
    [envelope] = drawn.layers
    assert isinstance(envelope, EnvelopeLayer)
    assert drawn.heading == "some force [kN]"
    assert np.nanmax(envelope.y) == pytest.approx(2.001, abs=1e-4)
    assert envelope.low.dtype == np.float32  # an hour's page stays small


def test_an_axis_is_logarithmic_where_the_means_span_decades():
    assert plot(np.exp(TIMES)).y.log
    assert not plot(np.exp(TIMES) - 2.0).y.log
    assert not plot(1.0 + TIMES).y.log
    rare = np.where(np.arange(len(TIMES)) % 10 == 0, 1e-9, 1.0 + 1e-3 * np.sin(TIMES))
    assert not plot(rare).y.log


def test_the_weight_on_bit_is_known_from_the_journal_alone():
    plots = TimePlots(10.0, [])
    assert list(plots.weight_on_bit([Change(1.0, "a", "")])) == []
    changes = [Change(-5.0, "a", "", 10.0), Change(4.0, "b", "", 20.0), Change(5.0, "c", "", None)]
    [found] = plots.weight_on_bit(changes)
    [line] = found.layers
    np.testing.assert_array_equal(line.x, [0.0, 4.0, 5.0, 10.0])
    np.testing.assert_array_equal(line.y, [10.0, 20.0, np.nan, np.nan])


def test_faults_that_last_end_with_the_run():
    marks = [Mark(FAULT, 1.0, "a", 2.0), Mark(FAULT, 3.0, "b" * 80)]
    found = TimePlots(10.0, marks).faults()
    [spans] = found.layers
    assert (list(spans.begin), list(spans.end)) == ([1.0, 3.0], [2.0, 10.0])
    assert found.y.categories == ("a", "b" * 24)


def test_no_line_of_the_closer_look_crosses_a_gap():
    waveform = Waveform(1.0)
    times = 0.6 + 1e-4 * np.append(np.arange(100), np.arange(150, 200))
    waveform.closer = {name: np.ones(len(times)) for name in CHANNELS} | {"times": times}
    found = closer(waveform, "closer-1")
    assert (found.unit, found.begin) == ("ms", 0.0)
    assert found.end == pytest.approx(19.9)
    for plot in found.plots:
        for line in plot.layers:
            [gap] = np.flatnonzero(np.isnan(line.y))
            assert line.x[gap - 1] == pytest.approx(9.9)
            assert line.x[gap + 1] == pytest.approx(15.0)
