"""Bags for the tests of a recorded drill: forces with chosen stamps, and a drill in many chunks."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from sample_bags import write_offline_bag

import rpud_sim.bag
from rpud_sim.bag import BagWriter, QosProfile, Topic
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.definitions import find_definition, find_type_hash
from rpud_sim.simulation import preset
from rpud_sim.simulation.scenario_file import read_scenario
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.viewer.frames import ClientState
from rpud_sim.viewer.recorded import RecordedStore

SECOND = 1_000_000_000
FORCE = "rpud_msgs/msg/ReactingForce"
JOURNAL = "rpud_msgs/msg/JournalEntry"
DURATION = 1.5
FAULTS = """
faults:
  - {kind: bias, channel: reacting_force, magnitude: 5, onset: 0.4, duration: 0.3}
  - {kind: restitution_loss, onset: 1.0}
"""


class ForceRecorder:
    """Recorder of forces, which writes when it is told to."""

    def __init__(self, path: Path, chunk_size: int = 400) -> None:
        self.path = path
        self._codec = Codec(FORCE, find_definition(FORCE))
        self._bag = BagWriter(path, chunk_size=chunk_size)
        self._topics: set[str] = set()
        self._entries = 0

    def write(self, rows, topic="/rpud/reacting_force") -> None:
        """Write messages: rows are log time [ns], stamp [ns] and value [N]."""
        self._declare(topic, FORCE)
        for log_time, stamp, value in rows:
            data = self._codec.encode({"header": header(stamp), "force": value, "impacts": 0})
            self._bag.write(topic, data, log_time, log_time)
        self._bag.flush()

    def tell(self, published, kind, stamp, time, **content) -> None:
        """Write the next entry of the journal, received later; times are in nanoseconds."""
        self._declare("/rpud/journal", JOURNAL)
        number = self._entries = self._entries + 1
        text, log_time = json.dumps({"time": time, **content}), published + 1
        top = header(stamp, TOPICS["journal"].frame)
        fields = {"header": top, "sequence": number - 1, "kind": kind, "content": text}
        data = Codec(JOURNAL, find_definition(JOURNAL)).encode(fields)
        self._bag.write("/rpud/journal", data, log_time, published)

    def _declare(self, topic, kind) -> None:
        if topic not in self._topics:
            self._topics.add(topic)
            offer = QosProfile(durability="transient_local" if kind == JOURNAL else "volatile")
            described = Topic(topic, kind, find_type_hash(kind), (offer,))
            self._bag.add_topic(described, find_definition(kind))

    def close(self) -> None:
        self._bag.close()


def header(stamp, frame="f"):
    return {"stamp": {"sec": stamp // SECOND, "nanosec": stamp % SECOND}, "frame_id": frame}


def write_forces(path: Path, rows, *, topic="/rpud/reacting_force", chunk_size=400) -> Path:
    recorder = ForceRecorder(path, chunk_size)
    recorder.write(rows, topic)
    recorder.close()
    return path


def rewritten(source: Path, out: Path, chunk_size=1 << 20, topics=None, copies=(), records=()):
    """Copy a bag, of some topics, with further topics of copies and with records."""
    with rpud_sim.bag.open(source) as reader, BagWriter(out, chunk_size=chunk_size) as writer:
        for name, record in dict(records).items():
            writer.add_record(name, record)
        kept = [each for each in reader.topics if topics is None or each.topic.name in topics]
        for summary in kept:
            writer.add_topic(summary.topic, summary.definition)
            if copy := dict(copies).get(summary.topic.name):
                writer.add_topic(replace(summary.topic, name=copy), summary.definition)
        for message in reader.messages({each.topic.name for each in kept}):
            for name in filter(None, (message.topic, dict(copies).get(message.topic))):
                writer.write(name, message.data, message.log_time, message.publish_time)
    return out


def without_waveform(bag: Path) -> set[str]:
    with rpud_sim.bag.open(bag) as reader:
        return {each.topic.name for each in reader.topics} - {"/rpud/waveform"}


def write_drill(folder: Path) -> Path:
    """Write a drill in the rock for ``DURATION``, with two faults, in some forty chunks."""
    (folder / "faults.yaml").write_text(FAULTS, encoding="utf-8")
    scenario = read_scenario(folder / "faults.yaml")
    write_offline_bag(folder / "whole", preset("drilling"), DURATION, scenario=scenario)
    topics = without_waveform(folder / "whole")
    return rewritten(folder / "whole", folder / "bag", 20_000, topics)


def rows_of(count, stamp=0, first=0):
    """Return rows of a force that is the number of the message, a hundred a second."""
    step = SECOND // 100
    return [
        (number * step, stamp + number * step, float(number))
        for number in range(first, first + count)
    ]


def frame_of(path: Path, **state):
    """Return the first frame of a browser in a state, of a bag that was read whole."""
    with RecordedStore(path) as store:
        store.read_all()
        client = ClientState(**state)
        store.open(client)
        return store.frame(client)
