"""Overview of a bag: it contains every value, and never claims to be complete too early."""

import numpy as np
import pytest
from viewer.recorded_bags import SECOND, write_forces

from rpud_sim.viewer import recording as recordings
from rpud_sim.viewer.overview import Overview
from rpud_sim.viewer.recording import Recording

STEP = 10_000_000  # ns


def forces(values):
    return [(number * STEP, number * STEP, value) for number, value in enumerate(values)]


def read_all(overview):
    while not overview.complete:
        overview.read_next()
    return overview


def whole(overview, parts=1000):
    """Return the envelope of the only signal."""
    (signal,) = overview._recording.signals
    return overview.bins.view(signal.name, 0.0, overview.end, parts)


@pytest.mark.parametrize("sampled", [1, 5])
def test_each_value_counts_once_whether_it_was_sampled_or_not(tmp_path, monkeypatch, sampled):
    monkeypatch.setattr(recordings, "SAMPLED", sampled)
    values = np.random.default_rng(1).normal(size=500)
    with Recording(write_forces(tmp_path / "bag", forces(values))) as recording:
        overview = Overview(recording)
        overview.look(recording.sample)
        read_all(overview)
        (envelope,) = [whole(overview, 1)]
        assert (envelope["low"].min(), envelope["high"].max()) == (values.min(), values.max())
        times = np.arange(500) * 0.01
        parts = np.searchsorted(times, envelope["t"])
        assert envelope["mean"][0] == pytest.approx(values[: 2 * parts[0]].mean(), abs=0.05)


def test_a_part_of_the_bag_is_never_called_the_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(recordings, "SAMPLED", 3)
    with Recording(write_forces(tmp_path / "bag", forces(np.arange(150.0)))) as recording:
        overview = Overview(recording)
        overview.look(recording.sample)
        while not overview.complete:
            assert overview.share < 1.0
            assert overview.gaps() == []
            shown = whole(overview)
            assert set(shown["low"][np.isfinite(shown["low"])]) <= set(np.arange(150.0))
            overview.read_next()
        assert overview.share == 1.0


def test_gaps_are_where_messages_are_missing(tmp_path):
    rows = [row for row in forces(np.ones(1000)) if not 3 * SECOND < row[0] < 5 * SECOND]
    with Recording(write_forces(tmp_path / "bag", rows)) as recording:
        overview = read_all(Overview(recording))
        ((start, end),) = overview.gaps()
        assert abs(start - 3.0) < 0.02
        assert abs(end - 5.0) < 0.02


def test_a_reset_between_the_sampled_parts_is_found_when_all_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(recordings, "SAMPLED", 2)
    # Twenty seconds from zero, a reset after twelve of them: stamps never step back in the sample.
    rows = [
        (number * STEP, (number if number < 1200 else number - 1200) * STEP, float(number))
        for number in range(2000)
    ]
    with Recording(write_forces(tmp_path / "bag", rows, chunk_size=4000)) as recording:
        overview = read_all(Overview(recording))
        (clock,) = recording.clocks.values()
        assert [jump.time for jump in clock.jumps] == [1200 * STEP]
        shown = whole(overview)
        valid = np.isfinite(shown["mean"])
        assert np.abs(shown["mean"][valid] - 100.0 * shown["t"][valid]).max() < 10.0
