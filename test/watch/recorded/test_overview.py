"""Overview of a bag: it contains every value, and never claims to be complete too early."""

import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from watch.recorded.recorded_bags import SECOND, write_forces

from rpud_sim.watch.recorded import recording as recordings
from rpud_sim.watch.recorded.overview import Overview
from rpud_sim.watch.recorded.recording import Recording

STEP = 10_000_000  # ns


def forces(values):
    return [(number * STEP, number * STEP, value) for number, value in enumerate(values)]


def read_all(overview):
    while overview.read_next():
        pass
    return overview


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=120),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.integers(1, 2000),
)
@settings(max_examples=25)
def test_the_envelope_of_any_window_contains_its_least_and_greatest_value(values, one, two, parts):
    end = (len(values) - 1) * STEP / SECOND
    start, stop = sorted((one * end, two * end))
    with tempfile.TemporaryDirectory() as folder:
        path = write_forces(Path(folder) / "bag", forces(values))
        with Recording(path) as recording:
            overview = read_all(Overview(recording))
            assert overview.progress.complete
            (signal,) = recording.signals
            trace = overview.view(signal, start, stop, parts)
            times = np.arange(len(values)) * STEP / SECOND
            wanted = np.array(values)[(times >= start) & (times <= stop)]
            shown = trace.y[np.isfinite(trace.y)]
            if len(wanted):
                assert shown.min() <= wanted.min()
                assert shown.max() >= wanted.max()
            least, greatest = overview.extremes(signal, 0.0, end)
            assert (least, greatest) == (min(values), max(values))


@given(st.integers(2, 150), st.integers(1, 9), st.integers(0, 12))
@settings(max_examples=25)
def test_a_part_of_the_bag_is_never_called_the_whole(count, sampled, read):
    with tempfile.TemporaryDirectory() as folder:
        path = write_forces(Path(folder) / "bag", forces(np.arange(float(count))))
        most, recordings.SAMPLED = recordings.SAMPLED, sampled
        try:
            with Recording(path) as recording:
                overview = Overview(recording)
                overview.sample()
                (signal,) = recording.signals
                for _ in range(read):
                    overview.read_next()
                progress = overview.progress
                assert progress.complete == (read >= len(recording.pieces))
                assert (progress.share == 1.0) == progress.complete
                if not progress.complete:
                    assert overview.gaps() == []
                    # Whatever it shows is in the bag.
                    trace = overview.view(signal, 0.0, overview.end, 10_000)
                    shown = trace.y[np.isfinite(trace.y)]
                    assert set(shown) <= set(np.arange(float(count)))
                while overview.read_next():
                    assert not overview.progress.complete
                assert overview.progress.complete
        finally:
            recordings.SAMPLED = most


def test_what_was_not_sampled_is_not_joined_by_a_line(tmp_path, monkeypatch):
    monkeypatch.setattr(recordings, "SAMPLED", 3)
    with Recording(write_forces(tmp_path / "bag", forces(np.arange(500.0)))) as recording:
        overview = Overview(recording)
        overview.sample()
        (signal,) = recording.signals
        assert np.isnan(overview.view(signal, 0.0, overview.end, 1000).y).any()
        read_all(overview)
        assert np.isfinite(overview.view(signal, 0.0, overview.end, 1000).y).all()


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
        assert [jump.log_time for jump in clock.jumps] == [1200 * STEP]
        assert overview.progress.complete
        (signal,) = recording.signals
        width = 2 * overview.width
        for time in (3.0, 12.5, 19.0):
            least, greatest = overview.extremes(signal, time - width, time + width)
            assert least <= time * 100 <= greatest
            assert greatest - least < 20
