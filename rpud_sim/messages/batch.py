"""Batches: messages of a topic as columns or as bytes, one by one, and in order."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate, groupby, pairwise
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rpud_sim.foundation.values import Sequences
from rpud_sim.messages.encoder import gathered

if TYPE_CHECKING:
    from rpud_sim.messages.cdr import Codec

LATEST = 2**63 - 1  # greatest time in a bag of rosbag2 [ns since the epoch]

Fields = dict[str, Any]  # fields of a message, by name
# A message: simulation time at which it is published [ns], topic, fields.
Row = tuple[int, str, Fields]

_TYPE_CODES = {np.dtype(np.int64): "q", np.dtype(np.float64): "d", np.dtype(np.uint8): "B"}
_NO_TIMES, _NO_BYTES = np.empty(0, np.int64), np.empty(0, np.uint8)


class Message(NamedTuple):
    """One serialized message; a tuple, as it is made three times as fast as a data class."""

    topic: str  # its name
    log_time: int  # time of receipt [ns since the epoch]
    publish_time: int  # time of sending [ns since the epoch]
    data: bytes  # its bytes (CDR)


@dataclass(eq=False, slots=True)
class Batch:
    """Messages of one topic, in their order: ``fields`` of a source that computes, or bytes."""

    topic: str  # its name
    # publishing time of each [ns], int64, shape (n,): simulation time; in a bag since the epoch
    publish_times: np.ndarray
    # fields as of one message, with an array instead of each value that differs. A sequence has a
    # row for each message, or is ``Sequences``. Empty if there are bytes.
    fields: Fields = field(default_factory=dict)
    # Messages of batches of one group alternate by their order; 0 if they follow each other.
    group: int = 0
    order: np.ndarray | None = None  # place of each in the group, ascending, shape (n,), int64
    # When each is received [ns]; by default when it is published.
    log_times: np.ndarray = field(default_factory=lambda: _NO_TIMES)
    # Bytes (CDR) of all messages, uint8, which may have other bytes between them; where each
    # message begins there, and its size [bytes], int64, shape (n,).
    data: np.ndarray = field(default_factory=lambda: _NO_BYTES)
    starts: np.ndarray = field(default_factory=lambda: _NO_TIMES)
    sizes: np.ndarray = field(default_factory=lambda: _NO_TIMES)
    run: int = 0  # number of their run, given by their source; 0 if it is not known
    origin: int = 0  # stamp of zero in the time of that run [ns]
    times: np.ndarray = field(default_factory=lambda: _NO_TIMES)  # since the origin, of values [ns]

    def __post_init__(self) -> None:
        if self.log_times is _NO_TIMES:
            self.log_times = self.publish_times

    @staticmethod
    def of(time: int, topic: str, fields: Fields) -> Batch:
        """Return a batch of one message."""
        return Batch(topic, np.array([time], np.int64), fields)

    @staticmethod
    def of_bytes(topic: str, messages: Sequence[tuple[bytes, int, int]]) -> Batch:
        """Return a batch of messages, each with its times of publishing and receiving [ns]."""
        data, published, received = zip(*messages, strict=True)
        sizes = np.array([len(each) for each in data], np.int64)
        return Batch(
            topic,
            np.array(published, np.int64),
            log_times=np.array(received, np.int64),
            data=np.frombuffer(b"".join(data), np.uint8),
            starts=np.cumsum(sizes) - sizes,
            sizes=sizes,
        )

    def __len__(self) -> int:
        return len(self.publish_times)

    def row(self, number: int) -> Fields:
        """Return the fields of one message; a batch of bytes has none."""
        return _row(self.fields, number)

    def rows(self) -> Iterator[Row]:
        for number, time in enumerate(self.publish_times.tolist()):
            yield time, self.topic, self.row(number)

    def serialized(self, codec: Codec) -> Batch:
        """Return the same messages as bytes."""
        if not self.fields:
            return self
        if len(self) == 1:
            data = np.frombuffer(codec.encode(self.row(0)), np.uint8)
            sizes = np.array([len(data)], np.int64)
        else:
            data, sizes = codec.encoder.encode_columns(self.fields, len(self))
        starts = np.cumsum(sizes) - sizes
        return replace(self, fields={}, data=data, starts=starts, sizes=sizes)

    def message(self, number: int) -> bytes:
        """Return the bytes of one message."""
        start = int(self.starts[number])
        return self.data[start : start + int(self.sizes[number])].tobytes()

    def part(self, chosen: slice | np.ndarray) -> Batch:
        """Return some of the serialized messages, in the same buffer."""
        if isinstance(chosen, slice) and chosen.indices(len(self)) == (0, len(self), 1):
            return self
        return replace(
            self,
            publish_times=self.publish_times[chosen],
            log_times=self.log_times[chosen],
            starts=self.starts[chosen],
            sizes=self.sizes[chosen],
        )

    def packed(self) -> Batch:
        """Return the same serialized messages in a buffer that holds little else."""
        if 2 * int(self.sizes.sum()) >= len(self.data):
            return self
        data = gathered(self.data, self.starts, self.sizes)
        return replace(self, data=data, starts=np.cumsum(self.sizes) - self.sizes)


def to_array(values: np.ndarray) -> array[Any]:
    """Return a copy of a NumPy array as the array type that message fields accept."""
    return array(_TYPE_CODES[values.dtype], np.ascontiguousarray(values).tobytes())


def _row(fields: Fields, number: int) -> Fields:
    row = {}
    for name, column in fields.items():
        kind = type(column)
        if kind is np.ndarray:
            row[name] = column.item(number) if column.ndim == 1 else to_array(column[number])
        elif kind is dict:
            row[name] = _row(column, number)
        elif kind is Sequences:
            row[name] = to_array(column.sequence(number))
        else:
            row[name] = list(column) if kind is list else column
    return row


def groups(batches: Iterable[Batch]) -> Iterator[list[Batch]]:
    """Yield batches whose messages alternate together, and each of the others by itself."""
    for number, found in groupby(batches, attrgetter("group")):
        if number:
            yield list(found)
        else:
            yield from ([batch] for batch in found)


def rows_of(batches: Iterable[Batch]) -> Iterator[Row]:
    """Yield the messages of batches one by one, in the order in which they are published."""
    for together in groups(batches):
        if len(together) == 1:
            yield from together[0].rows()
            continue
        found = [
            (place, number, batch)
            for batch in together
            if batch.order is not None
            for number, place in enumerate(batch.order.tolist())
        ]
        for _, number, batch in sorted(found, key=itemgetter(0)):
            yield int(batch.publish_times[number]), batch.topic, batch.row(number)


def joined(batches: Sequence[Batch]) -> Batch:
    """Return the messages of batches of one topic and run in one, in their order."""
    if len(batches) == 1:
        return batches[0]
    batches = [batch.packed() for batch in batches]
    begins = accumulate((len(batch.data) for batch in batches), initial=0)
    starts = [batch.starts + begin for batch, begin in zip(batches, begins, strict=False)]
    return replace(
        batches[0],
        log_times=np.concatenate([batch.log_times for batch in batches]),
        publish_times=np.concatenate([batch.publish_times for batch in batches]),
        data=np.concatenate([batch.data for batch in batches]),
        starts=np.concatenate(starts),
        sizes=np.concatenate([batch.sizes for batch in batches]),
    )


def messages_of(batches: Sequence[Batch]) -> Iterator[Message]:
    """Yield the messages of batches in the order of their log times.

    Messages with equal times keep the order of the buffers, and of their places there.
    """
    if not batches:
        return
    buffers: dict[int, int] = {}
    numbers = [buffers.setdefault(id(batch.data), len(buffers)) for batch in batches]
    counts = [len(batch) for batch in batches]
    starts = np.concatenate([batch.starts for batch in batches])
    logs = np.concatenate([batch.log_times for batch in batches])
    order = np.lexsort((starts, np.repeat(numbers, counts), logs))
    own = np.repeat(np.arange(len(batches)), counts)[order].tolist()
    ends = starts + np.concatenate([batch.sizes for batch in batches])
    sent = np.concatenate([batch.publish_times for batch in batches])
    topics, contents = [batch.topic for batch in batches], [batch.data.data for batch in batches]
    places = zip(own, starts[order].tolist(), ends[order].tolist(), strict=True)
    yield from map(
        Message,
        map(topics.__getitem__, own),
        logs[order].tolist(),
        sent[order].tolist(),
        (bytes(contents[number][start:end]) for number, start, end in places),
    )


def ordered_by_topic(batches: Iterable[Batch]) -> Iterator[Batch]:
    """Yield batches; within each topic they have the order of log times."""
    by_topic: dict[str, list[Batch]] = {}
    for batch in batches:
        by_topic.setdefault(batch.topic, []).append(batch)
    for parts in by_topic.values():
        if all(a.log_times[-1] <= b.log_times[0] for a, b in pairwise(parts)):
            yield from parts
        else:
            batch = joined(parts)
            yield batch.part(np.argsort(batch.log_times, kind="stable"))
