"""Bags as they come: torn, still growing, deleted, damaged, empty, with several clocks."""

import shutil

import numpy as np
import pytest
from sample_bags import write_bag
from viewer.recorded_bags import SECOND, rows_of, write_forces

from rpud_sim.viewer.recorded_store import RecordedStore
from rpud_sim.viewer.recording import Recording
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
    with Recording(path) as recording:
        assert 0 < len(times_of(recording)) < 50


def test_a_bag_that_is_deleted_is_shown_on(tmp_path):
    path = write_forces(tmp_path / "bag", rows_of(50))
    with Recording(path) as recording:
        assert recording.grow()
        assert recording.lost == ""
        shutil.rmtree(path)
        assert recording.grow()
        assert "was deleted" in recording.lost
        assert len(times_of(recording)) == 50


def test_a_damaged_chunk_is_skipped_and_reported(tmp_path):
    path = write_forces(tmp_path / "bag", rows_of(200), chunk_size=2000)
    with Recording(path) as recording:
        whole = len(times_of(recording))
    file = next(path.glob("*.mcap"))
    data = bytearray(file.read_bytes())
    data[len(data) // 3 : len(data) // 3 + 40] = bytes(40)
    file.write_bytes(data)
    with Recording(path) as recording:
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
    with Recording(write_forces(tmp_path / "bag", slow, chunk_size=2000)) as recording:
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
    with Recording(path) as recording:
        assert recording.clocks["/b"].zero == 500 * SECOND
        assert times_of(recording).tolist() == [number / 100 for number in range(200)]
