"""Bags as they come: torn, still growing, deleted, damaged, empty, with several clocks."""

import shutil
from contextlib import closing

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_bags import write_bag
from viewer.recorded_bags import SECOND, rows_of, write_forces

from rpud_sim.inspection.recorded_drill import Clock, Jump
from rpud_sim.viewer import recording as recordings
from rpud_sim.viewer.overview import Overview
from rpud_sim.viewer.recorded_store import RecordedStore
from rpud_sim.viewer.recording import RecordedBag, find_jumps
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


def test_a_torn_bag_shows_what_is_whole(tmp_path):
    path = write_forces(tmp_path / "bag", rows_of(50))
    file = next(path.glob("*.mcap"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with closing(RecordedBag(path)) as recording:
        assert 0 < len(times_of(recording)) < 50


def test_a_bag_that_is_deleted_is_shown_on(tmp_path):
    path = write_forces(tmp_path / "bag", rows_of(50))
    with closing(RecordedBag(path)) as recording:
        assert recording.grow()
        assert recording.lost == ""
        shutil.rmtree(path)
        assert recording.grow()
        assert "was deleted" in recording.lost
        assert len(times_of(recording)) == 50


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
        assert recording.clocks["/b"].zero == 500 * SECOND
        assert times_of(recording).tolist() == [number / 100 for number in range(200)]


STEPS = st.lists(
    st.tuples(st.integers(0, 5 * SECOND), st.integers(-200 * SECOND, 200 * SECOND)), max_size=30
)


@given(STEPS, st.integers(0, 10**18))
def test_time_passes_as_the_stamps_do_except_at_jumps(steps, first):
    logs = first + np.cumsum([0, *(1 + passed for passed, _ in steps)])
    stamps = first + np.cumsum([0, *(step for _, step in steps)])
    jumps = find_jumps(stamps, logs)
    elapsed = Clock(int(stamps[0]), int(logs[0]), tuple(jumps)).elapsed(stamps, logs)
    at = {jump.time for jump in jumps}
    for place, (passed, step) in enumerate(steps, 1):
        expected = 1 + passed if int(logs[place]) in at else step
        assert elapsed[place] - elapsed[place - 1] == pytest.approx(expected / SECOND, abs=1e-6)


@pytest.mark.parametrize("clock", [Clock(2**63), Clock(None, 2**64)])
def test_a_time_that_no_clock_has_is_no_error(clock):
    assert clock.elapsed(np.array([0]), np.array([0]))[0] < -9e9


def test_a_topic_without_stamps_goes_by_the_log_times():
    clock = Clock(None, 5 * SECOND)
    assert clock.elapsed(np.array([0]), np.array([7 * SECOND])).tolist() == [2.0]


@pytest.mark.parametrize("far", [2**63, -(2**63) - 1])
def test_times_beyond_int64_are_no_error(far):
    stamps = np.array([3 * SECOND])
    for clock in (Clock(None, far), Clock(far, 0), Clock(far, 0, (Jump(1, 1),))):
        assert clock.elapsed(stamps, stamps) == pytest.approx([-far / SECOND])


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


def test_a_reset_between_the_sampled_parts_is_found_when_all_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(recordings, "SAMPLED", 2)
    # Twenty seconds from zero, a reset after twelve of them: stamps never step back in the sample.
    rows = [
        (number * STEP, (number if number < 1200 else number - 1200) * STEP, float(number))
        for number in range(2000)
    ]
    with closing(RecordedBag(write_forces(tmp_path / "bag", rows, chunk_size=4000))) as recording:
        overview = read_all(Overview(recording))
        (clock,) = recording.clocks.values()
        assert [jump.time for jump in clock.jumps] == [1200 * STEP]
        shown = whole(overview)
        valid = np.isfinite(shown["mean"])
        assert np.abs(shown["mean"][valid] - 100.0 * shown["t"][valid]).max() < 10.0
