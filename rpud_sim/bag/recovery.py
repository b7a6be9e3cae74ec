"""Recovery of a torn or damaged bag into a whole one."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message, Metadata, Schema

from rpud_sim.bag.errors import BagError, BagFormatError, BagNotFoundError
from rpud_sim.bag.losses import LOSSES_RECORD, RECORDING_RECORD, Losses, losses_from_record
from rpud_sim.bag.mcap_file import McapFile
from rpud_sim.bag.messages import LATEST, REPEATED_KEY
from rpud_sim.bag.metadata import (
    FILE_NAME,
    RECORD_NAME,
    QosProfile,
    ReadMetadata,
    Topic,
    dump_offered_qos,
    load_offered_qos,
    read_document,
)
from rpud_sim.bag.reader import BagReader
from rpud_sim.bag.records import RecordFile, reading
from rpud_sim.bag.scan import Damage, Item, Scan, UnreadMessages
from rpud_sim.bag.storage_files import SUFFIXES, in_order, storage_files
from rpud_sim.bag.writer import BagWriter, whole_bag

# Metadata record of a recovered bag with the account of its recovery.
RECOVERY_RECORD = "rpud_recovery"

_SHOWN = 1000  # damages that are kept one by one
_DECLARED_LIMIT = 64 * 2**20  # bytes of all channels and schemas of a file
_KEPT_LIMIT = 64 * 2**20  # characters of all metadata records of a file
_OFFERS = "offered_qos_profiles"
_OTHERS = (
    "rpud recover makes whole bags of MCAP files that are compressed by chunks alone: "
    "ros2 bag convert makes such a bag of others"
)


@dataclass
class TopicRecovery:
    """Recovered and lost messages of one topic."""

    name: str  # of the topic
    type: str  # of its messages
    recovered: int = 0  # messages in the new bag
    unchecked: int = 0  # those of them without a checksum
    lost: int = 0  # messages that are known to have been in the file
    # messages that the recorder lost; None if they were not counted
    recording_losses: Losses | None = None


@dataclass
class Recovery:
    """Result of a recovery."""

    path: Path  # of the new bag
    topics: dict[str, TopicRecovery] = field(default_factory=dict)  # by their names
    # whether every file has the end of a closed one. If not, the messages that its recorder
    # had not written yet are missing.
    closed: bool = True
    max_loss: float | None = None  # greatest duration of those messages [s]; None if it is unknown
    size_lost: int = 0  # unreadable bytes
    damage_count: int = 0  # unreadable places, and parts that the new bag cannot hold
    damages: list[str] = field(default_factory=list)  # reasons for the first of these

    def note(self, reason: str) -> None:
        """Count a lost or omitted part, and keep the reason if there are few."""
        self.damage_count += 1
        if len(self.damages) < _SHOWN:
            self.damages.append(reason)

    def topic(self, name: str, type_name: str = "") -> TopicRecovery:
        """Return the account of a topic, new if it was not known; its first type remains."""
        topic = self.topics.setdefault(name, TopicRecovery(name, type_name))
        topic.type = topic.type or type_name
        return topic

    @property
    def message_count(self) -> int:
        """Messages in the new bag."""
        return sum(topic.recovered for topic in self.topics.values())

    @property
    def complete(self) -> bool:
        """Whether nothing that the files ever held is missing."""
        lost = any(topic.lost for topic in self.topics.values())
        return self.closed and not (self.damage_count or lost)

    def to_mapping(self) -> dict[str, Any]:
        """Return the account as plain values."""
        topics = [
            {**vars(topic), "recording_losses": losses.total if losses else None}
            for _, topic in sorted(self.topics.items())
            for losses in (topic.recording_losses,)
        ]
        calculated = {"complete": self.complete, "message_count": self.message_count}
        return {**vars(self), "path": str(self.path), **calculated, "topics": topics}


def recover(
    torn: str | os.PathLike[str],
    out: str | os.PathLike[str],
    progress: Callable[[int], object] = lambda _: None,
) -> Recovery:
    """Write a new bag from a torn one, which is not changed, and return the account.

    ``torn`` is an MCAP file or a bag's directory. A recovery that fails leaves nothing at ``out``.
    ``progress`` is called with the bytes that were read since the last call.
    """
    files = files_to_recover(torn)
    recovery = Recovery(Path(out))
    with whole_bag(out) as bag:
        recovering = _Recovering(bag, recovery)
        held = [recovering.add(file, progress) for file in files]
        if not any(held):
            raise BagFormatError(f"{torn} holds nothing of an MCAP file")
        bag.add_record(RECOVERY_RECORD, {"account": json.dumps(recovery.to_mapping())})
        bag.close()
        with BagReader(bag.path) as whole:
            _ = whole.topics  # raises an error if the new bag cannot be listed
    return recovery


def files_to_recover(torn: str | os.PathLike[str]) -> list[Path]:
    """Return the MCAP files of a bag, whether or not its metadata can be read."""
    path = Path(torn)
    document = _document(path)
    if document is not None and document.compression_mode.lower() not in ("", "none"):
        raise BagFormatError(
            f"{path / FILE_NAME}: compression_mode is {document.compression_mode!r:.80}; {_OTHERS}"
        )
    try:
        named, _ = storage_files(path)
    except BagFormatError:
        named = []
    for file in named:
        if not file.name.endswith(".mcap") and file.name.endswith(SUFFIXES):
            raise BagFormatError(f"{file} is no plain MCAP file; {_OTHERS}")
    files = [file for file in named if file.is_file()]
    if path.is_dir():
        # Of a torn bag the metadata may be missing, or be older than its last files.
        present = {file for file in path.glob("*.mcap") if file.is_file()}
        files += in_order(present - set(files))
    if not files:
        raise BagNotFoundError(f"there is no MCAP file at {torn}")
    return files


def _document(torn: Path) -> ReadMetadata | None:
    """Return the metadata of a bag's directory; None if it cannot be read."""
    with suppress(BagError, OSError, ValueError):
        if torn.is_dir():
            return read_document(torn / FILE_NAME)
    return None


class _Recovering:
    """Recovery of the files of a bag, one after the other, into a new bag.

    Messages that a file repeats of the previous one are kept of the first file only.
    """

    def __init__(self, bag: BagWriter, recovery: Recovery) -> None:
        self._bag, self._recovery = bag, recovery
        self._numbers: dict[tuple[Any, ...], int] = {}  # of channels in the new bag, by content
        self._repeats = True

    def add(self, file: Path, progress: Callable[[int], object]) -> bool:
        """Recover a file, and return whether it holds anything of an MCAP file.

        ``progress`` is called with the bytes read since the last call.
        """
        self._file = file
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._declared = 0
        self._number_of: dict[int, int] = {}  # of the file's channels in the new bag
        self._found: Counter[int] = Counter()  # messages of each channel
        self._missing: Counter[int] = Counter()  # messages of each channel in lost chunks
        self._kept = 0  # characters of metadata records
        self._unknown = 0  # messages of undeclared channels
        expected = self._read_summary()
        with reading(file), file.open("rb") as stream:
            scan = Scan(RecordFile(stream))
            before, held = 0, scan.begins
            for item in scan:
                held |= not isinstance(item, Damage)
                self._add_item(item)
                progress(scan.position - before)
                before = scan.position
            progress(scan.position - before)
        self._recovery.closed &= scan.closed
        self._account(expected)
        self._repeats = False
        return held

    def _add_item(self, item: Item) -> None:
        if isinstance(item, Damage):
            self._recovery.size_lost += item.size
            self._note(f"byte {item.offset} to {item.offset + item.size} {item.reason}")
        elif isinstance(item, UnreadMessages):
            self._missing[item.channel] += item.messages
        elif isinstance(item.record, Message):
            self._add_message(item.record, item.checked)
        elif isinstance(item.record, Schema | Channel):
            self._declare(item.record, item.checked)
        elif isinstance(item.record, Metadata):
            self._add_metadata(item.record)

    def _read_summary(self) -> Mapping[int, int]:
        """Declare what a whole summary section declares; return its number of messages by channel.

        Nothing is declared, and the result empty, if there is no such section.
        """
        try:
            with McapFile(self._file) as file:
                declared: list[Schema | Channel] = [*file.schemas.values(), *file.channels.values()]
                for record in declared:
                    self._declare(record, True)
                return file.counts
        except BagError:
            return {}

    def _add_metadata(self, record: Metadata) -> None:
        if record.name == RECORD_NAME:  # the new bag has its own
            return
        size = sum(len(text) for item in record.metadata.items() for text in item)
        try:
            if self._kept + size > _KEPT_LIMIT:
                raise BagFormatError(f"all together have more than {_KEPT_LIMIT} characters")
            if record.name == LOSSES_RECORD:
                for name, losses in losses_from_record(record.metadata).items():
                    self._recovery.topic(name).recording_losses = losses
        except BagFormatError as error:
            self._note(f"a record is left out: {error}")
            return
        if record.name == RECORDING_RECORD:
            with suppress(ValueError):
                self._recovery.max_loss = float(record.metadata.get("max_loss", ""))
        self._kept += size
        self._bag.add_record(record.name, record.metadata)

    def _declare(self, record: Schema | Channel, checked: bool) -> None:
        """Note a declaration; one with a checksum replaces others of its number."""
        known: dict[int, Any] = self._schemas if isinstance(record, Schema) else self._channels
        if record.id in known and (not checked or known[record.id] == record):
            return
        self._declared += len(repr(record))
        if self._declared > _DECLARED_LIMIT:
            raise BagFormatError(f"{self._file} declares more than {_DECLARED_LIMIT} bytes")
        known[record.id] = record
        self._number_of.clear()

    def _add_message(self, message: Message, checked: bool) -> None:
        channel = self._channels.get(message.channel_id)
        if channel is None or max(message.log_time, message.publish_time) > LATEST:
            self._unknown += 1
            return
        self._found[channel.id] += 1
        if self._is_kept(channel):
            times = message.log_time, message.publish_time
            self._bag.write_on(self._number(channel), message.data, *times, message.sequence)
            account = self._recovery.topics[channel.topic]
            account.recovered += 1
            account.unchecked += not checked

    def _is_kept(self, channel: Channel) -> bool:
        return self._repeats or REPEATED_KEY not in channel.metadata

    def _number(self, channel: Channel) -> int:
        """Return the number of a channel in the new bag, declared if it is new."""
        if channel.id not in self._number_of:
            schema = self._schemas.get(channel.schema_id)
            kind = (schema.name, schema.encoding, schema.data) if schema else ()
            metadata = tuple(sorted(channel.metadata.items()))
            key = (channel.topic, channel.message_encoding, kind, metadata)
            if key not in self._numbers:
                self._numbers[key] = self._add_channel(channel, schema)
            self._number_of[channel.id] = self._numbers[key]
        return self._number_of[channel.id]

    def _add_channel(self, channel: Channel, schema: Schema | None) -> int:
        """Declare a channel without what no bag can have: the account has the reasons."""
        metadata = dict(channel.metadata)
        offers: tuple[QosProfile, ...] = ()
        if schema is not None and schema.encoding == "ros2msg":
            try:
                schema.data.decode()
            except UnicodeDecodeError:
                name = f"{schema.name:.80}"
                self._recovery.note(f"the definition of {name} is left out: it is not UTF-8")
                schema = Schema(id=schema.id, name=schema.name, encoding="", data=b"")
        try:
            offers = load_offered_qos(metadata.get(_OFFERS, ""))
            if load_offered_qos(dump_offered_qos(offers)) != offers:
                raise BagFormatError("they cannot be written as they were read")
        except BagFormatError as error:
            self._recovery.note(f"the offers on {channel.topic:.200} are left out: {error}")
            offers = ()
            del metadata[_OFFERS]
        topic = Topic(
            name=channel.topic,
            type=schema.name if schema else "",
            type_hash=metadata.get("topic_type_hash", ""),
            offered_qos=offers,
            serialization_format=channel.message_encoding,
        )
        self._recovery.topic(topic.name, topic.type)
        return self._bag.add_channel(topic, schema, metadata)

    def _account(self, expected: Mapping[int, int]) -> None:
        for number, channel in self._channels.items():
            if self._is_kept(channel):
                self._number(channel)  # also without a message
                missing = expected.get(number, 0) - self._found[number]
                topic = self._recovery.topics[channel.topic]
                topic.lost += max(0, missing, self._missing[number])
        undeclared = self._missing.keys() - self._channels.keys()
        unknown = self._unknown + sum(self._missing[number] for number in undeclared)
        if unknown:
            self._note(
                f"{unknown} messages belong to no known topic, or have a time that rosbag2 "
                "cannot have"
            )

    def _note(self, reason: str) -> None:
        self._recovery.note(f"{self._file.name}: {reason}")
