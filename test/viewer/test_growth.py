"""A bag that is still recorded: the screen follows it, and misses and doubles nothing."""

import shutil
from contextlib import closing

import numpy as np
import pytest
from support import until
from viewer.recorded_bags import ForceRecorder, rows_of

from rpud_sim.viewer import recorded_store as stores
from rpud_sim.viewer.recorded_store import RecordedStore
from rpud_sim.viewer.recording import RecordedBag
from rpud_sim.viewer.session import ClientState

FIRST, SECOND = "/rpud/reacting_force", "/rpud/other"


class Recorder(ForceRecorder):
    """Recorder of a force that is the number of the message."""

    count = 0

    def write(self, count, topic=FIRST):
        super().write(rows_of(count, first=self.count), topic)
        self.count += count


@pytest.fixture
def recorder(tmp_path):
    found = Recorder(tmp_path / "bag")
    found.write(50)
    yield found
    found.close()


def values_of(recording):
    return [
        value
        for number in range(len(recording.pieces))
        for rows in recording.rows(number).values()
        for value in rows.values["force"]
    ]


def test_what_is_added_is_read_once_and_the_rest_stays(recorder):
    with closing(RecordedBag(recorder.path)) as recording:
        assert recording.growing
        before = values_of(recording)
        for _ in range(3):
            recorder.write(30)
            assert recording.grow()
        assert values_of(recording) == [float(number) for number in range(140)]
        assert before == [float(number) for number in range(50)]
        recorder.close()
        assert recording.grow()
        assert not recording.growing
        assert values_of(recording) == [float(number) for number in range(140)]


def test_a_new_topic_means_that_the_bag_is_opened_again(recorder):
    with closing(RecordedBag(recorder.path)) as recording:
        recorder.write(10, SECOND)
        assert not recording.grow()


def test_files_beside_those_of_the_bag_may_come_and_go(recorder):
    other = recorder.path / "reserve.tmp"
    other.write_bytes(bytes(1000))
    with closing(RecordedBag(recorder.path)) as recording:
        recorder.write(10)
        other.unlink()
        assert recording.grow()
        assert recording.lost == ""
        assert len(values_of(recording)) == 60


def test_a_recorder_that_deletes_its_oldest_file_is_followed(recorder, tmp_path):
    (source,) = recorder.path.glob("*.mcap")
    folder = tmp_path / "copy"
    folder.mkdir()
    shutil.copy(source, folder / "bag_0.mcap")
    with closing(RecordedBag(folder)) as recording:
        recorder.write(70)
        shutil.copy(source, folder / "bag_1.mcap")
        (folder / "bag_0.mcap").unlink()
        assert not recording.grow()


def test_pages_see_that_nobody_records_any_more(recorder, monkeypatch):
    with RecordedStore(recorder.path) as store:
        client = ClientState()
        store.open(client)
        store.read_all()
        assert store.frame(client)["growing"]
        monkeypatch.setattr("rpud_sim.viewer.recording._STILL", 0.0)
        shown = store.frame(client)
        assert not shown["growing"]
        assert "lost its end" in shown["notice"]


def test_pages_follow_the_end_and_see_that_the_recording_ended(recorder, monkeypatch):
    monkeypatch.setattr(stores, "_REFRESH", 0.02)
    seen = {}
    with RecordedStore(recorder.path) as store:
        client = ClientState()
        store.open(client)

        def shown(name, value):
            seen.update(store.frame(client) or {})
            return seen[name] == pytest.approx(value)

        until(lambda: shown("now", 0.49))
        assert seen["growing"]
        recorder.write(100)
        until(lambda: shown("now", 1.49))
        assert seen["view"]["end"] == pytest.approx(1.49)
        assert seen["extent"] == [0.0, pytest.approx(1.49)]
        (layer,) = seen["view"]["layers"].values()
        assert layer["mean"][-1] == 149.0
        run = seen["run"]
        recorder.write(20, SECOND)
        until(lambda: shown("now", 1.69))
        assert seen["run"] > run
        recorder.close()
        until(lambda: shown("growing", False))
        assert "lost its end" not in seen["notice"]
        assert np.isfinite(seen["read"])
