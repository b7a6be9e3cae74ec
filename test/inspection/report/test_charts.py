"""Spectra keep their peaks when they are thinned, and histograms all impacts."""

import numpy as np
import pytest

from rpud_sim.inspection.report.charts import distributions, spectra
from rpud_sim.inspection.report.drill_topics import CHANNELS, Impacts
from rpud_sim.inspection.report.running_statistics import Distribution


def test_a_thinned_spectrum_keeps_its_peaks():
    frequencies = np.linspace(0.0, 25_000.0, 8193)
    density = 1e-12 / (1.0 + frequencies)
    density[5243] = 1.0
    for plot in spectra((frequencies, np.tile(density, (len(CHANNELS), 1)))):
        [line] = plot.layers
        assert len(line.x) <= 1500
        assert (np.diff(line.x) > 0.0).all()
        assert line.x[np.argmax(line.y)] == pytest.approx(frequencies[5243])
        assert plot.x.log
        assert plot.y.log
        assert plot.alt.endswith("most power near 16000 Hz.")


def test_a_histogram_has_every_impact():
    class Topic:
        @staticmethod
        def find(column):
            found = Distribution()
            found.add(np.linspace(1.0, 2000.0, 500))
            return found

    impacts = Impacts(1.0)
    impacts.intervals.add(np.append(np.full(499, 0.002), 5.0))
    force, *_, interval = distributions(impacts, Topic())
    assert force.layers[0].y.sum() == 500
    assert (force.x.unit, force.layers[1].name) == ("kN", "mean 1 kN")
    assert interval.x.log
    assert interval.x.unit == "ms"
