"""Bags as they come: torn, still growing, deleted, damaged, empty, with several clocks."""

import shutil

import numpy as np
import pytest
from sample_bags import write_bag
from watch.recorded.recorded_bags import SECOND, write_forces

from rpud_sim.watch.recorded.bag_view import BagView
from rpud_sim.watch.recorded.recording import Recording

STEP = 10_000_000


def rows(count, stamp=0):
    return [(number * STEP, stamp + number * STEP, float(number)) for number in range(count)]


def times_of(recording):
    """Return the times since the bag began of all messages, part by part."""
    found = [
        recording.elapsed(topic, each)
        for number in range(len(recording.pieces))
        for topic, each in recording.rows(number).items()
    ]
    return np.sort(np.concatenate(found))


def test_a_bag_that_is_still_recorded_shows_what_is_there(tmp_path):
    path = write_forces(tmp_path / "bag", rows(50), close=False)
    with BagView(path) as view:
        assert view.recording.unclosed
        assert "still being recorded" in view.banner
        assert len(times_of(view.recording)) == 50
        with next(path.glob("*.mcap")).open("ab") as stream:
            stream.write(bytes(1000))
        assert "has grown by" in view.banner


def test_a_torn_bag_shows_what_is_whole(tmp_path):
    path = write_forces(tmp_path / "bag", rows(50))
    file = next(path.glob("*.mcap"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with BagView(path) as view:
        assert 0 < len(times_of(view.recording)) < 50
        assert "lost its end" in view.banner


def test_a_bag_that_is_deleted_is_shown_on(tmp_path):
    path = write_forces(tmp_path / "bag", rows(50))
    with BagView(path) as view:
        assert view.banner == ""
        shutil.rmtree(path)
        assert "was deleted" in view.banner
        while view.overview.read_next():
            pass
        assert view.overview.progress.complete
        assert len(times_of(view.recording)) == 50


def test_a_damaged_chunk_is_skipped_and_reported(tmp_path):
    path = write_forces(tmp_path / "bag", rows(200), chunk_size=2000)
    with Recording(path) as recording:
        whole, parts = len(times_of(recording)), len(recording.pieces)
    file = next(path.glob("*.mcap"))
    data = bytearray(file.read_bytes())
    data[len(data) // 3 : len(data) // 3 + 40] = bytes(40)
    file.write_bytes(data)
    with BagView(path) as view:
        while view.overview.read_next():
            pass
        assert view.overview.progress.complete
        assert 1 <= len(view.recording.damages) <= 2
        assert whole // 2 < len(times_of(view.recording)) < whole
        assert f"{len(view.recording.damages)} damaged parts are skipped" in view.banner
        assert parts == len(view.recording.pieces)


def test_an_empty_bag_and_one_without_numbers_are_shown_as_such(tmp_path):
    for path in (write_forces(tmp_path / "empty", []), write_bag(tmp_path / "text")):
        with BagView(path) as view:
            while view.overview.read_next():
                pass
            assert view.overview.progress.complete
            assert "no numbers" in view.banner


@pytest.mark.parametrize("rate", [0.25, 1.0, 7.0])
def test_parts_of_a_range_are_found_also_where_time_passes_at_another_speed(tmp_path, rate):
    slow = [(int(log / rate), stamp, value) for log, stamp, value in rows(3000, stamp=SECOND)]
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
    path = write_forces(tmp_path / "one", rows(200, stamp=500 * SECOND), topic="/b/reacting_force")
    with Recording(path) as recording:
        assert recording.clocks["/b"].zero == 500 * SECOND
        assert times_of(recording).tolist() == [number / 100 for number in range(200)]
