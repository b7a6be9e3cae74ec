"""Bags as they come: damaged, empty, with several clocks."""

from contextlib import closing

import numpy as np
import pytest
from sample_bags import write_bag
from viewer.recorded_bags import SECOND, ForceRecorder, rows_of, write_forces

from rpud_sim.viewer import overview as overviews
from rpud_sim.viewer import recording as recordings
from rpud_sim.viewer.overview import Overview
from rpud_sim.viewer.recorded_store import RecordedStore
from rpud_sim.viewer.recording import RecordedBag
from rpud_sim.viewer.session import ClientState

STEP = 10_000_000


def times_of(recording):
    """Return the times since the bag began of all messages, part by part."""
    found = [
        recording.elapsed(topic, each)
        for number in range(len(recording.pieces))
        for topic, each in recording.rows(number).items()
    ]
    return np.sort(np.concatenate(found))


def first_frame(path):
    with RecordedStore(path) as store:
        store.read_all()
        client = ClientState()
        store.open(client)
        return store.frame(client)


def test_a_damaged_chunk_is_skipped_and_reported(tmp_path):
    path = write_forces(tmp_path / "bag", rows_of(200), chunk_size=2000)
    with closing(RecordedBag(path)) as recording:
        whole = len(times_of(recording))
    file = next(path.glob("*.mcap"))
    data = bytearray(file.read_bytes())
    data[len(data) // 3 : len(data) // 3 + 40] = bytes(40)
    file.write_bytes(data)
    with closing(RecordedBag(path)) as recording:
        assert whole // 2 < len(times_of(recording)) < whole
        assert 1 <= len(recording.damages) <= 2
    frame = first_frame(path)
    assert "damaged parts are skipped" in frame["notice"]
    assert frame["read"] == 1.0


def test_an_empty_bag_and_one_without_numbers_are_shown_as_such(tmp_path):
    for path in (write_forces(tmp_path / "empty", []), write_bag(tmp_path / "text")):
        frame = first_frame(path)
        assert "no numbers" in frame["notice"]
        assert frame["read"] == 1.0


@pytest.mark.parametrize("rate", [0.25, 1.0, 7.0])
def test_parts_of_a_range_are_found_also_where_time_passes_at_another_speed(tmp_path, rate):
    slow = [(int(log / rate), stamp, value) for log, stamp, value in rows_of(3000, stamp=SECOND)]
    with closing(RecordedBag(write_forces(tmp_path / "bag", slow, chunk_size=2000))) as recording:
        for start, end in ((0.0, 0.05), (7.0, 7.2), (29.0, 29.99)):
            values = np.concatenate(
                [
                    each.values["force"]
                    for number in recording.pieces_between("/rpud", start, end)
                    for each in recording.rows(number).values()
                ]
            )
            wanted = np.arange(np.ceil(start * 100 - 1e-6), np.floor(end * 100 + 1e-6) + 1)
            assert set(wanted) <= set(values)
            assert len(values) < len(wanted) + 400


def test_the_clock_of_each_drill_is_its_own(tmp_path):
    path = write_forces(
        tmp_path / "one", rows_of(200, stamp=500 * SECOND), topic="/b/reacting_force"
    )
    with closing(RecordedBag(path)) as recording:
        assert times_of(recording).tolist() == [number / 100 for number in range(200)]


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
    with closing(RecordedBag(write_forces(tmp_path / "bag", forces(values)))) as recording:
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
    with closing(
        RecordedBag(write_forces(tmp_path / "bag", forces(np.arange(150.0))))
    ) as recording:
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
    with closing(RecordedBag(write_forces(tmp_path / "bag", rows))) as recording:
        overview = read_all(Overview(recording))
        ((start, end),) = overview.gaps()
        assert abs(start - 3.0) < 0.02
        assert abs(end - 5.0) < 0.02


def test_a_run_after_a_reset_follows_the_one_before(tmp_path, monkeypatch):
    """Twenty seconds, after twelve of which stamps begin again, as the journal tells at its end."""
    monkeypatch.setattr(overviews, "AT_ONCE", 1)
    recorder = ForceRecorder(tmp_path / "bag", 4000)
    recorder.tell(0, 0, "begin", 0, 0)
    recorder.write([(number * STEP, number * STEP, float(number)) for number in range(1200)])
    reset = 1200 * STEP
    for kind, stamp in (("flush", reset), ("begin", 0)):
        recorder.tell(reset, reset, kind, stamp, stamp)
    recorder.write([(reset + n * STEP, n * STEP, 1200.0 + n) for n in range(800)])
    recorder.close()
    with closing(RecordedBag(recorder.path)) as recording:
        shown = whole(read_all(Overview(recording)))
        valid = np.isfinite(shown["mean"])
        assert np.abs(shown["mean"][valid] - 100.0 * shown["t"][valid]).max() < 10.0


def test_a_late_recording_begins_at_zero_and_pauses_take_no_time(tmp_path):
    recorder = ForceRecorder(tmp_path / "bag")
    begin, late = 500 * SECOND, 900 * SECOND  # stamps, which are real times
    recorder.tell(late, begin, "begin", begin, 0)
    recorder.tell(late, begin + 100 * SECOND, "begin", begin + 100 * SECOND, 0)
    recorder.write([(late + n * STEP, late + n * STEP, float(n)) for n in range(100)])
    resumed = late + 61 * SECOND
    recorder.write([(resumed, resumed, 100.0)])  # it is sent before the entry
    recorder.tell(resumed + 1, resumed + 1, "origin", resumed, 301 * SECOND)
    recorder.write([(resumed + STEP, resumed + STEP, 101.0)])
    recorder.close()
    with closing(RecordedBag(recorder.path)) as recording:
        overview = read_all(Overview(recording))
        assert overview.end == pytest.approx(1.01)
        times = np.unique(times_of(recording).round(6))  # of entries before it as well
        assert times[times >= 0.0] == pytest.approx(np.arange(102) * 0.01)
