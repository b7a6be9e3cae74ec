"""A bag that is still recorded: the screen follows it, and misses and doubles nothing."""

import numpy as np
import pytest
from support import until
from viewer.recorded.recorded_bags import FORCE, rows_of

from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.viewer.recorded import store as stores
from rpud_sim.viewer.recorded.recording import Recording
from rpud_sim.viewer.recorded.store import RecordedStore
from rpud_sim.viewer.store import ClientState, View

FIRST, SECOND = "/rpud/reacting_force", "/rpud/other"


class Recorder:
    """Recorder of a force, which writes when it is told to."""

    def __init__(self, path):
        self.path = path
        self._codec = Codec(FORCE, find_definition(FORCE))
        self._bag = BagWriter(path, chunk_size=400)
        self._declared = set()
        self._count = 0

    def write(self, count, topic=FIRST):
        if topic not in self._declared:
            self._declared.add(topic)
            self._bag.add_topic(Topic(topic, FORCE, find_type_hash(FORCE)), find_definition(FORCE))
        for log_time, stamp, value in rows_of(count, first=self._count):
            header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "f"}
            data = self._codec.encode({"header": header, "force": value})
            self._bag.write(topic, data, log_time, log_time)
        self._count += count
        self._bag.flush()

    def close(self):
        self._bag.close()


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
    with Recording(recorder.path) as recording:
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
    with Recording(recorder.path) as recording:
        recorder.write(10, SECOND)
        assert not recording.grow()


def test_pages_follow_the_end_and_see_that_the_recording_ended(recorder, monkeypatch):
    monkeypatch.setattr(stores, "_REFRESH", 0.02)
    seen = {}
    with RecordedStore(recorder.path) as store:
        client = ClientState(view=View(follow=0.5), choices={})
        store.open(client)

        def shown(name, value):
            seen.update(store.frame(client) or {})
            return seen[name] == pytest.approx(value)

        store.start()
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
        assert seen["notice"] == ""
        assert np.isfinite(seen["read"])
