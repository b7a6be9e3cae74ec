"""Signals of one topic, read from the bytes of its messages, of a bag or as they arrive."""

from __future__ import annotations

from collections.abc import Sequence

from rpud_sim.bag import TopicSummary
from rpud_sim.bag.tables import compiled
from rpud_sim.messages.batch import Batch
from rpud_sim.messages.columns import Column, FieldReader, Kind
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.viewer.history import Signal

_NO_SIGNALS = {"sequence", "sample_period"}  # they number messages, or help to read them


class TopicReader:
    """Reader of the signals of one topic, of which it takes at most so many."""

    def __init__(self, summary: TopicSummary, columns: Sequence[Column], most: int) -> None:
        self.topic, self.type = summary.topic.name, summary.topic.type
        self.unreadable = 0  # messages that are not of the type
        self.block = columns[0].name == "time"  # whether a message holds many rows
        stamp = [each for each in columns if each.name == "header.stamp" and each.kind is Kind.TIME]
        numbers = [
            each
            for each in columns
            if each.kind is Kind.NUMBER and each.name not in _NO_SIGNALS and not self.block
        ][:most]
        self.stamped = bool(stamp)
        self.latched = "transient_local" in {each.durability for each in summary.topic.offered_qos}
        self.signals = [Signal(self.topic, self.type, each.name, each.unit) for each in numbers]
        self.codec, _ = compiled(self.type, summary.definition or "")
        self._fields = FieldReader(self.codec, [*stamp, *numbers])

    @property
    def is_own(self) -> bool:
        """Whether it has name and type of a drill's own; commands and other programs have not."""
        name = self.topic.rpartition("/")[2]
        return name in TOPICS and self.type == TOPICS[name].type

    def read(self, batch: Batch) -> Batch:
        """Return the signals of messages, and their times since the origin of the batch.

        These are stamps, or log times of messages without one. Messages that are not of the type
        are counted.
        """
        found = self._fields.read(batch)
        self.unreadable += len(found.errors)
        logs = batch.log_times[found.rows]
        stamps = found.array("header.stamp") if self.stamped else logs
        fields = {each.column: found.array(each.column).astype(float) for each in self.signals}
        published, times = batch.publish_times[found.rows], stamps - batch.origin
        given = {"log_times": logs, "run": batch.run, "origin": batch.origin, "times": times}
        return Batch(self.topic, published, fields, **given)
