"""What is kept of values that pass by once is what all of them together give."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from rpud_sim.inspection.report.running_statistics import (
    Distribution,
    Envelope,
    Intervals,
    Spectrum,
)

finite = st.floats(-1e149, 1e149)


def in_pieces(values, cuts):
    return np.split(np.asarray(values), sorted(cut % (len(values) + 1) for cut in cuts))


@given(st.lists(finite, min_size=1), st.lists(st.integers(0, 1000)))
def test_a_distribution_has_the_moments_and_quantiles_of_all_values(values, cuts):
    found = Distribution()
    for piece in in_pieces(values, cuts):
        found.add(piece)
    size = max(abs(min(values)), abs(max(values)), 1e-290)
    assert (found.count, found.least, found.greatest) == (len(values), min(values), max(values))
    assert found.mean == pytest.approx(np.mean(np.array(values) / size) * size, abs=1e-9 * size)
    counts, edges = found.classes(80)
    assert counts.sum() == len(values)
    assert len(counts) <= 80
    assert edges[0] <= min(values) + 1e-9 * size
    assert max(values) <= edges[-1] + 1e-9 * size
    near = 0.01 * (max(values) - min(values)) + 1e-9 * size
    assert found.quantile(0.0) == pytest.approx(found.least, abs=near)
    assert found.quantile(1.0) == pytest.approx(found.greatest, abs=near)


def test_quantiles_are_as_exact_as_the_classes():
    values = np.random.default_rng(1).gamma(2.0, 3.0, 100_000)
    found = Distribution()
    for piece in np.split(values, 100):
        found.add(piece)
    for part in (0.01, 0.05, 0.5, 0.95, 0.99):
        exact = np.quantile(values, part)
        assert found.quantile(part) == pytest.approx(exact, abs=0.005 * np.ptp(values))
    assert found.deviation == pytest.approx(np.std(values, ddof=1), rel=1e-9)
    assert found.total == pytest.approx(values.sum())


def test_values_that_are_not_usable_are_counted_apart():
    found = Distribution()
    found.add(np.array([np.nan, 1.0, np.inf, 3.0, -1e200]))
    assert (found.count, found.others, found.mean) == (2, 3, 2.0)
    assert Distribution().quantile(0.5) != Distribution().quantile(0.5)


@given(st.lists(st.tuples(st.floats(0.0, 1e4), finite), min_size=1), st.floats(0.0, 10.0))
def test_an_envelope_loses_no_extreme_however_long_it_lasts(points, expected):
    envelope = Envelope(expected)
    for time, value in points:
        envelope.add(np.array([time]), np.array([value]))
    times, values = np.array(points).T
    parts = (times / envelope.width).astype(int)
    assert envelope.count.sum() == len(points)
    for part in set(parts):
        assert envelope.least[part] == values[parts == part].min()
        assert envelope.greatest[part] == values[parts == part].max()


def test_an_envelope_is_as_fine_as_a_thousandth_of_the_time():
    envelope = Envelope(10.0)
    envelope.add(np.linspace(0.0, 10.0, 5000), np.ones(5000))
    assert envelope.width == pytest.approx(0.01, rel=0.01)
    assert envelope.total[:900] / envelope.width == pytest.approx(500.0, rel=0.21)


def test_a_spectrum_is_that_of_welch_however_the_samples_come():
    numbers = np.random.default_rng(2)
    samples = numbers.normal(size=(2, 10_000)).cumsum(axis=1)
    spectrum = Spectrum(2, 512)
    for piece in np.split(samples, [3, 700, 1400, 1401, 9000], axis=1):
        spectrum.add(piece)
    frequencies, density = spectrum.density(50.0)
    expected = signal.welch(samples, 50.0, "hann", 512, 256)
    assert frequencies == pytest.approx(expected[0])
    assert density == pytest.approx(expected[1], rel=1e-9)


def test_a_spectrum_does_not_reach_across_a_gap():
    tone = np.sin(2 * np.pi * 0.1 * np.arange(2000))[None]
    spectrum = Spectrum(1, 256)
    spectrum.add(tone[:, :300])
    spectrum.gap()
    spectrum.add(tone[:, 1000:1300])
    assert spectrum.segments == 2
    expected = [
        signal.welch(part, 1.0, "hann", 256)[1] for part in (tone[0, :256], tone[0, 1000:1256])
    ]
    assert spectrum.density(1.0)[1][0] == pytest.approx(np.mean(expected, axis=0), rel=1e-9)


def test_a_short_waveform_has_a_coarser_spectrum_and_a_very_short_one_none():
    spectrum = Spectrum(1, 2**14)
    spectrum.add(np.ones((1, 200)))
    assert spectrum.density(1.0) is None
    spectrum.add(np.ones((1, 900)))
    frequencies, _ = spectrum.density(1.0)
    assert len(frequencies) == 513


def drawn_at(envelope, time):
    times, values = envelope.steps()
    return values[:, np.searchsorted(times, time, "right") - 1].tolist()


def test_nothing_is_drawn_where_no_message_was():
    envelope = Envelope(10.0)
    times = np.append(np.arange(0.0, 3.0, 0.01), np.arange(7.0, 10.0, 0.01))
    envelope.add(times, np.where(times < 5.0, 1.0, 3.0))
    assert drawn_at(envelope, 2.9) == [1.0] * 3
    for time in (3.1, 5.0, 6.9):
        assert np.isnan(drawn_at(envelope, time)).all()
    assert drawn_at(envelope, 7.1) == [3.0] * 3
    assert np.isnan(Envelope(1.0).steps()[1]).all()


def test_a_value_holds_until_the_next_and_is_no_ramp():
    envelope = Envelope(10.0)
    envelope.add(np.array([0.0, 1.0, 2.0, 2.02, 3.0]), np.array([5.0, 5.0, 9.0, 9.0, 9.0]))
    assert drawn_at(envelope, 1.9) == [5.0] * 3
    assert drawn_at(envelope, 2.5) == [9.0] * 3


def test_one_gap_leaves_all_other_intervals_as_exact_as_they_were():
    intervals = Intervals()
    numbers = np.random.default_rng(3)
    values = numbers.gamma(20.0, 1e-4, 10_000)
    intervals.add(values)
    intervals.add(np.array([9.0]))
    for part in (0.01, 0.5, 0.99):
        assert intervals.quantile(part) == pytest.approx(np.quantile(values, part), rel=0.03)
    counts, _ = intervals.classes(80)
    assert np.count_nonzero(counts) > 10
    assert (intervals.count, intervals.greatest) == (10_001, 9.0)
    assert intervals.total == pytest.approx(values.sum() + 9.0)
