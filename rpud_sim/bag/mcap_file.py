"""One MCAP file: its topics, records and messages. Times are integer nanoseconds."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property, lru_cache, partial
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema

from rpud_sim.bag.contents import Contents, Part, contents_of_closed, walked_contents
from rpud_sim.bag.errors import BagError, BagFormatError
from rpud_sim.bag.messages import LATEST, REPEATED_KEY, BagSegment, MessageBlock, items
from rpud_sim.bag.metadata import Topic, TopicSummary, load_offered_qos
from rpud_sim.bag.records import (
    HEAD,
    MAGIC,
    MESSAGE,
    RECORD,
    RecordFile,
    message_index,
    parse,
    reading,
    records_in,
    uncompressed,
)

RECORDS_LIMIT = 64 * 2**20  # greatest size of all metadata records of one name together [bytes]

_COMMENT = re.compile(r"#.*")
_NO_SCHEMA = Schema(id=0, data=b"", encoding="", name="")


class McapFile:
    """Open MCAP file; ``shown`` is its name in errors.

    With ``repeats`` it includes messages that the file repeats of the previous one. With
    ``unclosed`` a file that was not closed, or lost its end, is read up to its last whole record.
    """

    def __init__(
        self,
        path: Path,
        *,
        repeats: bool = True,
        shown: Path | None = None,
        unclosed: bool = False,
    ) -> None:
        self._shown = shown or path
        self.closed = True  # whether the file was closed
        with reading(self._shown):
            self._stream = path.open("rb")
        try:
            with reading(self._shown):
                self._file = RecordFile(self._stream)
                self.size = self._file.size
                try:
                    self._contents = contents_of_closed(self._file, self._shown)
                except BagFormatError:
                    if not unclosed or not self._walked.end > len(MAGIC):
                        raise
                    self.closed = False
                    self._contents = self._walked
        except BaseException:
            self._stream.close()
            raise
        self.schemas, self.counts = self._contents.schemas, self._contents.counts
        self.start_time, self.end_time = self._contents.first, self._contents.last
        self.channels = {
            number: channel
            for number, channel in self._contents.channels.items()
            if repeats or REPEATED_KEY not in channel.metadata
        }
        left_out = self._contents.channels.keys() - self.channels.keys()
        repeated = sum(self.counts.get(number, 0) for number in left_out)
        self.message_count = self._contents.message_count - repeated
        # Compressions of the chunks; an empty text for those without.
        self.compressions = {each.compression or "" for each in self._contents.parts}
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
        offsets = {offset for one, offset in self._contents.metadata if one == name}
        total = 0
        with self._reading():
            for offset in sorted(offsets):
                found = self._file.record(offset)
                record = parse(found)
                total += len(found.content)
                if not isinstance(record, Metadata):
                    raise BagFormatError("a metadata record is not where it should be")
                if total > RECORDS_LIMIT:
                    raise BagFormatError(f"the records {name} have more than {RECORDS_LIMIT} bytes")
                if record.name == name:
                    yield record.metadata

    def topic(self, name: str) -> TopicSummary:
        """Return the summary of one topic."""
        with self._reading():
            channels = self.topic_channels[name]
            schema = self.schemas.get(channels[0].schema_id, _NO_SCHEMA)
            first, last = self._span({channel.id for channel in channels})
            return TopicSummary(
                topic=Topic(
                    name=name,
                    type=schema.name,
                    type_hash=channels[0].metadata.get("topic_type_hash", ""),
                    offered_qos=_offered_qos(channels[0].metadata.get("offered_qos_profiles", "")),
                    serialization_format=channels[0].message_encoding,
                ),
                message_count=sum(self.counts.get(channel.id, 0) for channel in channels),
                first_time=first,
                last_time=last,
                definition=self._definitions.get(schema.id),
                kinds=frozenset(map(self._kind, channels)),
            )

    def segments(self) -> Iterator[BagSegment]:
        """Yield the parts that can be read by themselves, in the order of the file."""
        contents = self._contents
        with self._reading():
            if self.closed and not contents.parts:
                contents = self._walked
                if not contents.whole:
                    raise BagFormatError("its messages do not end as they should")
        channels, everything = self.channels, frozenset(self.topic_channels)
        for part in contents.parts:
            held = [
                channels[each].topic for each in part.indexes or part.counts if each in channels
            ]
            known = part.indexes or part.compression is None
            topics = frozenset(held) if known else everything
            blocks = partial(self._blocks, part)
            yield BagSegment(part.first, part.last, part.size, topics, blocks)

    def _blocks(self, part: Part, topics: Collection[str] | None) -> list[MessageBlock]:
        """Return the messages of a part, a block for each topic in the order of log times."""
        wanted = {
            number: channel.topic
            for number, channel in self.channels.items()
            if topics is None or channel.topic in topics
        }
        with self._reading():
            if part.compression is None:
                content = self._file.content(part.start, part.end - part.start)
            else:
                chunk = parse(self._file.record(part.start, part.end))
                if not isinstance(chunk, Chunk) or chunk.uncompressed_size != part.size:
                    raise BagFormatError("a chunk is not what its index says")
                content = uncompressed(chunk)
            blocks = _blocks_in(content, wanted)
            if any(block.log_times[0] < part.first for block in blocks):
                raise BagFormatError(
                    "a message is earlier than its chunk says; rpud recover makes a whole bag of it"
                )
            return blocks

    @contextmanager
    def _reading(self) -> Iterator[None]:
        if self._stream.closed:
            raise BagError(f"{self._shown} was closed; open the bag again")
        with reading(self._shown):
            yield

    @cached_property
    def _walked(self) -> Contents:
        return walked_contents(self._file)

    @cached_property
    def _definitions(self) -> dict[int, str]:
        texts = {}
        for number, schema in self.schemas.items():
            if schema.encoding == "ros2msg":
                with suppress(UnicodeDecodeError):
                    texts[number] = schema.data.decode()
        return texts

    def _kind(self, channel: Channel) -> tuple[str, str, str]:
        schema = self.schemas.get(channel.schema_id, _NO_SCHEMA)
        text = self._definitions.get(schema.id, "")
        return channel.message_encoding, schema.name, _without_comments(text)

    @cached_property
    def _parts_of(self) -> dict[int, list[Part]]:
        """Parts that have an index of a channel."""
        found: dict[int, list[Part]] = {}
        for part in self._contents.parts:
            for channel in part.indexes:
                found.setdefault(channel, []).append(part)
        return found

    def _span(self, channels: set[int]) -> tuple[int | None, int | None]:
        """Return log times of the first and the last message of channels [ns]; None without any.

        Only the indexes of two parts are read: files have thousands.
        """
        parts = [part for each in channels for part in self._parts_of.get(each, ())]
        if not parts:
            return None, None
        first = self._times(min(parts, key=lambda part: part.first), channels)
        last = self._times(max(parts, key=lambda part: part.last), channels)
        return min(first, default=None), max(last, default=None)

    def _times(self, part: Part, channels: set[int]) -> list[int]:
        # A set operation would visit all channels of the part.
        offsets = [part.indexes[each] for each in channels if each in part.indexes]
        found = [message_index(self._file.record(each))[1]["log_time"] for each in offsets]
        return [int(end) for times in found if len(times) for end in (times.min(), times.max())]


# Thousands of channels share a few texts.
_offered_qos = lru_cache(maxsize=1024)(load_offered_qos)


@lru_cache(maxsize=1024)
def _without_comments(definition: str) -> str:
    return " ".join(_COMMENT.sub("", definition).split())


def _blocks_in(content: bytes, topics: dict[int, str]) -> list[MessageBlock]:
    """Return the messages among records, a block for each topic in the order of log times.

    ``topics`` has the names of the channels to read, by their numbers.
    """
    data = np.frombuffer(content, np.uint8)
    message = Opcode.MESSAGE
    starts = [start for opcode, start, _ in records_in(content) if opcode == message]
    places = np.array(starts, np.int64) - RECORD.size
    heads = items(data, HEAD)[places] if starts else np.empty(0, HEAD)
    names: dict[str, int] = {}
    held = np.bincount(heads["channel"])
    numbers = np.full(len(held), -1)  # of the topic of each channel; -1 if it is not wanted
    for channel in np.flatnonzero(held).tolist():
        if channel in topics:
            numbers[channel] = names.setdefault(topics[channel], len(names))
    of_message = numbers[heads["channel"]]
    order = np.lexsort((heads["log_time"], of_message))
    cuts = np.searchsorted(of_message[order], np.arange(len(names) + 1))
    blocks = []
    for number, name in enumerate(names):
        rows = order[cuts[number] : cuts[number + 1]]
        logs, sent = (heads[each][rows] for each in ("log_time", "publish_time"))
        if len(rows) and max(logs.max(), sent.max()) > LATEST:
            raise BagFormatError(
                f"a message of {name:.200} has a time of more than {LATEST} ns; rpud recover "
                "makes a bag without it"
            )
        sizes = heads["length"][rows].astype(np.int64) - MESSAGE.size
        times = logs.astype(np.int64), sent.astype(np.int64)
        blocks.append(MessageBlock(name, *times, data, places[rows] + HEAD.itemsize, sizes))
    return blocks
