"""Plots over time have the form that their data ask for."""

import numpy as np
import pytest

from rpud_sim.bag.columns import Column, Kind
from rpud_sim.inspection.report.drill_topics import CHANNELS, Waveform
from rpud_sim.inspection.report.running_statistics import Envelope
from rpud_sim.inspection.report.time_plots import TimePlots, closer
from rpud_sim.inspection.report.topic_survey import Series
from rpud_sim.pages.plot import Envelope as EnvelopeLayer
from rpud_sim.pages.plot import Line

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
