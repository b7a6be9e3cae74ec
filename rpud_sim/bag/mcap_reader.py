"""One MCAP file: its topics, records and chunks. Times are integer nanoseconds."""

from __future__ import annotations

from collections.abc import Collection, Container, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from mcap.records import Channel, Chunk, Metadata, Schema

from rpud_sim.bag.mcap_contents import REMEDY, ChunkPlace, contents_of, loose_places, spans_of
from rpud_sim.bag.metadata import OFFERED_QOS_KEY, QosProfile, Topic, TopicSummary, load_offered_qos
from rpud_sim.bag.records import (
    HEAD,
    MESSAGE,
    RecordFile,
    message_index,
    parse,
    reading,
    split_records,
    uncompressed,
)
from rpud_sim.foundation.user_files import open_file
from rpud_sim.messages.batch import LATEST, Batch
from rpud_sim.messages.definitions import definition_of, full_name
from rpud_sim.messages.errors import BagError, BagFormatError

_NO_SCHEMA = Schema(id=0, data=b"", encoding="", name="")


@dataclass(eq=False)
class BagChunk:
    """Chunk of a bag, or consecutive messages outside of chunks, which can be read by itself."""

    file: McapFile  # file that contains it
    place: ChunkPlace  # in the file

    @property
    def start_time(self) -> int:
        """Log time that no message precedes, by the record of the file [ns]."""
        return self.place.start_time

    @property
    def end_time(self) -> int:
        """Log time that no message follows, by the record of the file [ns]."""
        return self.place.end_time

    @property
    def size(self) -> int:
        """Memory that its messages take [bytes]."""
        return self.place.size

    @property
    def topics(self) -> frozenset[str]:
        """Names of the topics that it may hold."""
        channels = self.file.channels
        if not self.place.indexes:
            return frozenset(self.file.topic_channels)
        return frozenset(channels[each].topic for each in self.place.indexes if each in channels)

    def batches(self, topics: Collection[str] | None = None) -> list[Batch]:
        """Return the messages of topics, a batch for each in the order of log times; None for all.

        A damaged chunk is a BagFormatError.
        """
        return self.file.batches(self.place, topics)


class McapFile:
    """Open MCAP file that was closed by its writer."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with reading(path):
            self._stream = open_file(path)
        try:
            with reading(path):
                self._file = RecordFile(self._stream)
                contents = contents_of(self._file, path)
        except BaseException:
            self._stream.close()
            raise
        self._contents = contents
        self.size = self._file.size  # [bytes]
        # Why the whole file was read, in one line; empty if it was not.
        self.warning = (
            f"{path}: {contents.lacks}, so the whole file was read to open it"
            if contents.lacks
            else ""
        )
        self.schemas = contents.schemas
        self.channels = contents.channels
        # Messages by channel, and of all of them.
        self.counts = contents.counts
        self.message_count = sum(self.counts.values())
        self.start_time = min(contents.times, default=0)
        self.end_time = max(contents.times, default=0)
        self.unread_offers: dict[str, str] = {}  # why offers are left out, by topic
        # definition, or None and the reason, by schema
        self._definitions: dict[int, tuple[str | None, str]] = {}
        # log times by channel, of chunks without indexes
        self._spans: dict[int, dict[int, tuple[int, int]]] = {}
        # Compressions of the chunks; an empty text for those without.
        self.compressions = {each.compression for each in contents.chunks}
        # Of each topic; each publisher may have had its own.
        self.topic_channels: dict[str, list[Channel]] = {}
        for channel in self.channels.values():
            self.topic_channels.setdefault(channel.topic, []).append(channel)

    def __enter__(self) -> McapFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def records(self, name: str) -> Iterator[dict[str, str]]:
        """Yield the content of the metadata records of a name."""
        with self._reading():
            for offset in sorted({place for one, place in self._contents.metadata if one == name}):
                record = parse(self._file.record(offset))
                if not isinstance(record, Metadata):
                    raise BagFormatError("a metadata record is not where it should be")
                if record.name == name:
                    yield record.metadata

    def topic(self, name: str) -> TopicSummary:
        """Return the summary of one topic."""
        with self._reading():
            channels = self.topic_channels[name]
            schema = self.schemas.get(channels[0].schema_id, _NO_SCHEMA)
            first, last = self._span({channel.id for channel in channels})
            definition, reason = self._definition(schema)
            return TopicSummary(
                topic=Topic(
                    name=name,
                    type=full_name(schema),
                    type_hash=channels[0].metadata.get("topic_type_hash", ""),
                    offered_qos=self._offers(channels),
                    serialization_format=channels[0].message_encoding,
                ),
                message_count=sum(self.counts.get(channel.id, 0) for channel in channels),
                first_time=first,
                last_time=last,
                definition=definition,
                kinds=frozenset(map(self._kind, channels)),
                undefined=reason,
            )

    def chunks(self) -> list[BagChunk]:
        """Return the chunks, and the messages outside of chunks, in bounded parts."""
        with self._reading():
            return [BagChunk(self, each) for each in (*self._contents.chunks, *self._loose)]

    def written_times(self) -> Iterator[tuple[str, np.ndarray]]:
        """Yield topics with log times [ns] in the order of the file; chunks by their indexes."""
        for chunk in sorted(self.chunks(), key=lambda chunk: chunk.place.start):
            if not chunk.place.indexes:
                for batch in chunk.batches():
                    yield batch.topic, batch.log_times[np.argsort(batch.starts)]
            with self._reading():
                for channel, offset in chunk.place.indexes.items():
                    entries = message_index(self._file.record(offset))[1]
                    if channel in self.channels:
                        written = entries[np.argsort(entries["offset"], kind="stable")]
                        yield self.channels[channel].topic, written["log_time"]

    @cached_property
    def _loose(self) -> list[ChunkPlace]:
        """Messages outside of chunks."""
        contents = self._contents
        if contents.loose is not None:
            return contents.loose
        return loose_places(self._file, contents.chunks)

    def batches(self, place: ChunkPlace, topics: Collection[str] | None) -> list[Batch]:
        """Return the messages of a chunk, a batch for each topic in the order of log times."""
        wanted = {
            number: channel.topic
            for number, channel in self.channels.items()
            if topics is None or channel.topic in topics
        }
        with self._reading():
            if place.loose:
                content = self._file.content(place.start, place.end - place.start)
            else:
                record = parse(self._file.record(place.start, place.end))
                if not isinstance(record, Chunk) or record.uncompressed_size != place.size:
                    raise BagFormatError("a chunk does not match its index")
                content = uncompressed(record)
            _, places, heads = split_records(content)
            return _batches_in(content, places, heads, wanted, self._contents.channels)

    @contextmanager
    def _reading(self) -> Iterator[None]:
        if self._stream.closed:
            raise BagError(f"{self.path} was closed; open the bag again")
        with reading(self.path):
            yield

    def _offers(self, channels: list[Channel]) -> tuple[QosProfile, ...]:
        """Return what publishers of a topic offered; of messages this is only a hint."""
        try:
            texts = dict.fromkeys(each.metadata.get(OFFERED_QOS_KEY, "") for each in channels)
            return tuple(offer for text in texts for offer in _offered_qos(text))
        except BagFormatError as error:
            self.unread_offers[channels[0].topic] = str(error)
            return ()

    def _definition(self, schema: Schema) -> tuple[str | None, str]:
        if schema.id not in self._definitions:
            self._definitions[schema.id] = definition_of(schema)
        return self._definitions[schema.id]

    def _kind(self, channel: Channel) -> tuple[str, str, str]:
        schema = self.schemas.get(channel.schema_id, _NO_SCHEMA)
        return channel.message_encoding, full_name(schema), self._definition(schema)[0] or ""

    @cached_property
    def _chunks_of(self) -> dict[int, list[ChunkPlace]]:
        """Chunks that may have messages of a channel."""
        found: dict[int, list[ChunkPlace]] = {}
        for chunk in self._contents.chunks:
            for channel in chunk.indexes or self.channels:
                found.setdefault(channel, []).append(chunk)
        return found

    def _span(self, channels: set[int]) -> tuple[int | None, int | None]:
        """Return log times of the first and the last message of channels [ns].

        None without any, or where only reading all messages outside of chunks would show them. Few
        indexes are read, for files have thousands: only if their chunk may have an earlier or a
        later message than is known. Chunks may overlap in time.
        """
        if (spans := self._contents.spans) is not None:
            known = [time for each in channels if each in spans for time in spans[each]]
            return min(known, default=None), max(known, default=None)
        if self._contents.chunks and self._loose:
            return None, None
        chunks = [chunk for each in channels for chunk in self._chunks_of.get(each, ())]
        seen: list[int] = []
        for chunk in sorted(chunks, key=lambda chunk: chunk.start_time):
            if seen and chunk.start_time >= min(seen):
                break
            seen += self._times(chunk, channels)
        for chunk in sorted(chunks, key=lambda chunk: -chunk.end_time):
            if seen and chunk.end_time <= max(seen):
                break
            seen += self._times(chunk, channels)
        return min(seen, default=None), max(seen, default=None)

    def _times(self, chunk: ChunkPlace, channels: set[int]) -> list[int]:
        """Return the first and last log time of each channel in a chunk [ns]."""
        if not chunk.indexes:
            spans = self._unindexed_spans(chunk.start)
            return [time for each in channels if each in spans for time in spans[each]]
        # A set operation would visit all channels of the chunk.
        offsets = [chunk.indexes[each] for each in channels if each in chunk.indexes]
        found = [message_index(self._file.record(each))[1]["log_time"] for each in offsets]
        return [int(end) for times in found if len(times) for end in (times.min(), times.max())]

    def _unindexed_spans(self, offset: int) -> dict[int, tuple[int, int]]:
        """Return the first and last log time of each channel in a chunk without indexes [ns]."""
        if offset not in self._spans:
            record = parse(self._file.record(offset))
            if not isinstance(record, Chunk):
                raise BagFormatError("a chunk does not match its index")
            self._spans[offset] = spans_of(split_records(uncompressed(record))[2])
        return self._spans[offset]


# Thousands of channels share a few texts.
_offered_qos = lru_cache(maxsize=1024)(load_offered_qos)


def _batches_in(
    content: bytes,
    places: np.ndarray,
    heads: np.ndarray,
    topics: dict[int, str],
    declared: Container[int],
) -> list[Batch]:
    """Return the messages among records, a batch for each topic in the order of log times.

    ``topics`` has the names of the channels to read, by their numbers. A message of a channel that
    is not ``declared`` is a BagFormatError.
    """
    data = np.frombuffer(content, np.uint8)
    names: dict[str, int] = {}
    held = np.bincount(heads["channel"])
    numbers = np.full(len(held), -1)  # number of each channel's topic; -1 if it is not wanted
    for channel in np.flatnonzero(held).tolist():
        if channel not in declared:
            raise BagFormatError(f"it has messages of channel {channel}, undeclared; {REMEDY}")
        if channel in topics:
            numbers[channel] = names.setdefault(topics[channel], len(names))
    of_message = numbers[heads["channel"]]
    order = np.lexsort((heads["log_time"], of_message))
    cuts = np.searchsorted(of_message[order], np.arange(len(names) + 1))
    batches = []
    for number, name in enumerate(names):
        rows = order[cuts[number] : cuts[number + 1]]
        logs, sent = (heads[each][rows] for each in ("log_time", "publish_time"))
        if len(rows) and max(logs.max(), sent.max()) > LATEST:
            raise BagFormatError(
                f"a message of {name:.200} has a time of more than {LATEST} ns; rpud recover "
                "makes a bag without it"
            )
        sizes = heads["length"][rows].astype(np.int64) - MESSAGE.size
        batches.append(
            Batch(
                name,
                sent.astype(np.int64),
                log_times=logs.astype(np.int64),
                data=data,
                starts=places[rows] + HEAD.itemsize,
                sizes=sizes,
            )
        )
    return batches
