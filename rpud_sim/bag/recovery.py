"""Make a whole bag of one that is torn or damaged, and account for what is lost."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Message, Metadata, Schema

from rpud_sim.bag.errors import BagError, BagFormatError, BagNotFoundError
from rpud_sim.bag.latched import REPEATED_KEY
from rpud_sim.bag.losses import RECORD_NAME as LOSSES_RECORD
from rpud_sim.bag.losses import losses_from_record
from rpud_sim.bag.metadata import FILE_NAME as METADATA_FILE
from rpud_sim.bag.metadata import (
    RECORD_KEY,
    SIZE_LIMIT,
    BagMetadata,
    Topic,
    dump_offered_qos,
    load_offered_qos,
    metadata_from_record,
    read_document,
)
from rpud_sim.bag.metadata import RECORD_NAME as ROSBAG2_RECORD
from rpud_sim.bag.qos import QosProfile
from rpud_sim.bag.reader import SUFFIXES, BagReader, in_order, storage_files
from rpud_sim.bag.recovery_account import Recovery, TopicRecovery
from rpud_sim.bag.scan import Damage, Missing, Scan
from rpud_sim.bag.sequence import SequenceCounter
from rpud_sim.bag.storage_file import StorageFile, clear_errors
from rpud_sim.bag.writer import LATEST, BagWriter

RECORDING_RECORD = "rpud_recording"
"""Metadata record of what the recorder promised: `max_loss` [s]."""

RECOVERY_RECORD = "rpud_recovery"
"""Metadata record of the account that stands in a recovered bag."""

_OTHERS = (
    "rpud recover makes whole bags of MCAP files that are compressed by chunks alone: "
    "ros2 bag convert makes such a bag of others"
)
_OFFERS = "offered_qos_profiles"
_DECLARED_LIMIT = 64 * 2**20  # bytes of all channels and schemas
_KEPT_LIMIT = 64 * 2**20  # bytes of all metadata records
_CUSTOM_DATA_LIMIT = 2**20  # characters
_LISTED_LIMIT = SIZE_LIMIT * 3 // 4  # of metadata.yaml, for its topics


def recover(
    torn: str | os.PathLike[str],
    out: str | os.PathLike[str],
    progress: Callable[[int], object] = lambda _: None,
) -> Recovery:
    """Write the new bag `out`/ from a torn MCAP file, or a bag's folder; neither is changed.

    `progress` is called with the bytes that were read since it was called last. What fails
    leaves nothing at `out`. Raises BagNotFoundError where there is nothing to read, BagFormatError
    where it holds nothing of a bag or rosbag2 compressed it on its own, BagExistsError where
    anything exists at `out`, and BagError where the disk fails.
    """
    files = files_to_recover(torn)
    recovery = Recovery(Path(out))
    if not any(_holds_records(file) for file in files):
        raise BagFormatError(f"{torn} holds nothing of an MCAP file")
    bag = BagWriter(out)
    try:
        document = _document(Path(torn))
        _keep_custom_data(bag, recovery, document.custom_data if document else {})
        outputs = _Outputs(bag, recovery)
        for file in files:
            repeats = file == files[0]
            _FileRecovery(file, bag, recovery, outputs, repeats).run(progress)
        outputs.count_gaps()
        bag.add_record(RECOVERY_RECORD, {"account": json.dumps(recovery.to_mapping())})
        bag.close()
        _check(bag.path)
    except BaseException:
        with suppress(BagError):
            bag.abandon()
        shutil.rmtree(bag.path, ignore_errors=True)
        raise
    return recovery


def files_to_recover(torn: str | os.PathLike[str]) -> list[Path]:
    """Name the MCAP files of a bag, whether or not its metadata can be read.

    Raises BagNotFoundError where there are none, and BagFormatError where rosbag2 compressed
    them, or the messages in them, on its own, or they are of another storage.
    """
    path = Path(torn)
    document = _document(path)
    if document is not None and document.compression_mode.lower() not in ("", "none"):
        raise BagFormatError(
            f"{path / METADATA_FILE}: compression_mode is {document.compression_mode!r:.80}; "
            f"{_OTHERS}"
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
        there = {file for file in path.glob("*.mcap") if file.is_file()}
        files += in_order(there - set(files))
    if not files:
        raise BagNotFoundError(f"there is no MCAP file at {torn}")
    return files


def _check(path: Path) -> None:
    """Refuse to hand over a bag that cannot be listed. Raises BagFormatError."""
    with BagReader(path) as bag:
        assert bag.topics is not None


def _holds_records(file: Path) -> bool:
    with clear_errors(file), file.open("rb") as stream:
        size = os.fstat(stream.fileno()).st_size
        scan = Scan(stream, size)
        return scan.begins or any(not isinstance(item, Damage) for item in scan)


def _definition(schema: Schema | None) -> str:
    if schema is None or schema.encoding != "ros2msg":
        return ""
    return schema.data.decode("utf-8", "replace")


def _document(torn: Path) -> BagMetadata | None:
    """Read the metadata of a bag's folder, if that is possible."""
    with suppress(BagError, OSError, ValueError):
        if torn.is_dir():
            return read_document(torn / METADATA_FILE)
    return None


def _keep_custom_data(bag: BagWriter, recovery: Recovery, content: Mapping[str, str]) -> None:
    size = sum(len(text) for item in content.items() for text in item)
    if size > _CUSTOM_DATA_LIMIT:
        recovery.note(f"custom data of {size} characters is left out: at most {_CUSTOM_DATA_LIMIT}")
    else:
        bag.add_custom_data(content)


class _Outputs:
    """The channels of the new bag. Files of one bag have the same ones, by other numbers."""

    def __init__(self, bag: BagWriter, recovery: Recovery) -> None:
        self._bag = bag
        self._recovery = recovery
        self._listed = 0  # characters of metadata.yaml, at most
        self._numbers: dict[tuple[Any, ...], int] = {}
        self._counters: dict[int, tuple[str, SequenceCounter]] = {}

    def open(self, channel: Channel, schema: Schema | None) -> int:
        """Give the number of a channel, declared if it is new."""
        kind = (schema.name, schema.encoding, schema.data) if schema else ()
        metadata = tuple(sorted(channel.metadata.items()))
        key = (channel.topic, channel.message_encoding, kind, metadata)
        if key not in self._numbers:
            self._numbers[key] = self._declare(channel, schema)
        return self._numbers[key]

    def note(self, output: int, data: bytes) -> None:
        """Note a message for the count of gaps."""
        self._counters[output][1].note(data)

    def count_gaps(self) -> None:
        """Account for the gaps when all is read."""
        for name, counter in self._counters.values():
            if counter.gaps is not None:
                topic = self._recovery.topics[name]
                topic.gaps = (topic.gaps or 0) + counter.gaps

    def _declare(self, channel: Channel, schema: Schema | None) -> int:
        type_name = schema.name if schema else ""
        schema = self._readable(schema)
        metadata, offers = self._offers(channel)
        topic = Topic(
            name=channel.topic,
            type=type_name,
            type_hash=channel.metadata.get("topic_type_hash", ""),
            offered_qos=offers,
            serialization_format=channel.message_encoding,
        )
        texts = (topic.name, topic.type, topic.type_hash, topic.serialization_format)
        self._listed += 1024 + 1536 * len(offers) + 4 * sum(map(len, texts))
        if self._listed > _LISTED_LIMIT:
            raise BagFormatError("its topics are more than the metadata of a bag can list")
        output = self._bag.add_channel(topic, schema, metadata)
        self._counters[output] = (
            channel.topic,
            SequenceCounter(_definition(schema), max(1, len(offers))),
        )
        found = self._recovery.topics.setdefault(
            channel.topic, TopicRecovery(channel.topic, type_name)
        )
        found.type = found.type or type_name
        return output

    def _readable(self, schema: Schema | None) -> Schema | None:
        """Leave out a text that is none, and keep the name of the type."""
        if schema is None or schema.encoding != "ros2msg":
            return schema
        try:
            schema.data.decode()
        except UnicodeDecodeError:
            self._recovery.note(f"the definition of {schema.name:.80} is left out: it is not UTF-8")
            return Schema(id=schema.id, name=schema.name, encoding="", data=b"")
        return schema

    def _offers(self, channel: Channel) -> tuple[dict[str, str], tuple[QosProfile, ...]]:
        """Give a channel's metadata, and the offers in it: both without these if unreadable."""
        try:
            offers = load_offered_qos(channel.metadata.get(_OFFERS, ""))
            if load_offered_qos(dump_offered_qos(offers)) == offers:
                return channel.metadata, offers
            reason = "they cannot be written as they were read"
        except BagFormatError as error:
            reason = str(error)
        self._recovery.note(f"the offers on {channel.topic:.200} are left out: {reason}")
        return {key: text for key, text in channel.metadata.items() if key != _OFFERS}, ()


class _FileRecovery:
    """The part of a recovery that is one file, with or without what it repeats of another."""

    def __init__(
        self, file: Path, bag: BagWriter, recovery: Recovery, outputs: _Outputs, repeats: bool
    ) -> None:
        self._file = file
        self._bag = bag
        self._recovery = recovery
        self._outputs = outputs
        self._repeats = repeats
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._sure: set[tuple[type, int]] = set()  # declarations that a checksum vouches for
        self._declared = 0
        self._numbers: dict[int, int] = {}  # the new bag's channel of each of the file's
        self._found: dict[int, int] = {}  # messages of each channel, by the file
        self._missing: dict[int, int] = {}  # messages of each channel in chunks that are lost
        self._kept = 0  # characters of metadata records
        self._unknown = 0  # messages of channels that are declared nowhere

    def run(self, progress: Callable[[int], object]) -> None:
        """Recover it."""
        expected = self._summary()
        with clear_errors(self._file), self._file.open("rb") as stream:
            scan = Scan(stream, os.fstat(stream.fileno()).st_size)
            before = 0
            for item in scan:
                if isinstance(item, Damage):
                    self._damage(item)
                elif isinstance(item, Missing):
                    known = self._missing.get(item.channel, 0)
                    self._missing[item.channel] = known + item.count
                elif isinstance(item.record, Message):
                    self._message(item.record, item.checked)
                else:
                    self._keep(item.record, item.checked)
                progress(scan.position - before)
                before = scan.position
            progress(scan.position - before)
        self._recovery.closed &= scan.closed
        self._account(expected)

    def _summary(self) -> dict[int, int]:
        """Take the channels of a whole summary section; give each one's number of messages."""
        try:
            with StorageFile(self._file) as file:
                for schema in file.schemas.values():
                    self._declare(schema, True)
                for channel in file.channels.values():
                    self._declare(channel, True)
                return dict(file.statistics.channel_message_counts)
        except BagError:
            return {}

    def _keep(self, record: Any, checked: bool) -> None:
        if isinstance(record, Schema | Channel):
            self._declare(record, checked)
        elif isinstance(record, Attachment):
            self._bag.add_attachment(record)
        elif isinstance(record, Metadata) and record.name == ROSBAG2_RECORD:
            with suppress(BagFormatError):  # the new bag has its own; this was its maker's part
                content = metadata_from_record(record.metadata.get(RECORD_KEY, ""))
                _keep_custom_data(self._bag, self._recovery, content.custom_data)
        elif isinstance(record, Metadata):
            try:
                self._check(record)
            except BagFormatError as error:
                self._recovery.note(f"{self._file.name}: a record is left out: {error}")
                return
            self._bag.add_record(record.name, record.metadata)
            if record.name == RECORDING_RECORD:
                with suppress(ValueError):
                    self._recovery.max_loss = float(record.metadata.get("max_loss", ""))

    def _declare(self, record: Schema | Channel, checked: bool) -> None:
        known: dict[int, Any] = self._schemas if isinstance(record, Schema) else self._channels
        key = (type(record), record.id)
        if key in self._sure and not checked:
            return
        if checked:
            self._sure.add(key)
        if known.get(record.id) == record:
            return
        self._declared += len(repr(record))
        if self._declared > _DECLARED_LIMIT:
            raise BagFormatError(f"{self._file} declares more than {_DECLARED_LIMIT} bytes")
        known[record.id] = record
        if isinstance(record, Schema):
            self._numbers.clear()
        else:
            self._numbers.pop(record.id, None)

    def _message(self, message: Message, checked: bool) -> None:
        number = message.channel_id
        channel = self._channels.get(number)
        if channel is None or max(message.log_time, message.publish_time) > LATEST:
            self._unknown += 1
            return
        self._found[number] = self._found.get(number, 0) + 1
        if not self._keeps(channel):
            return
        output = self._numbers.get(number)
        if output is None:
            output = self._open(channel)
        self._bag.write_to(
            output, message.data, message.log_time, message.publish_time, message.sequence
        )
        topic = self._recovery.topics[channel.topic]
        topic.recovered += 1
        topic.unchecked += not checked
        self._outputs.note(output, message.data)

    def _keeps(self, channel: Channel) -> bool:
        return self._repeats or REPEATED_KEY not in channel.metadata

    def _open(self, channel: Channel) -> int:
        output = self._outputs.open(channel, self._schemas.get(channel.schema_id))
        self._numbers[channel.id] = output
        return output

    def _check(self, record: Metadata) -> None:
        """Take the losses of a record. Raises BagFormatError where a bag cannot have it."""
        size = sum(len(text) for item in record.metadata.items() for text in item)
        if self._kept + size > _KEPT_LIMIT:
            raise BagFormatError(f"all together have more than {_KEPT_LIMIT} characters")
        if record.name == LOSSES_RECORD:
            for name, losses in losses_from_record(record.metadata).items():
                topic = self._recovery.topics.setdefault(name, TopicRecovery(name, ""))
                topic.recording_losses = losses
        self._kept += size

    def _damage(self, damage: Damage) -> None:
        self._recovery.size_lost += damage.size
        self._recovery.note(
            f"{self._file.name}: byte {damage.offset} to {damage.offset + damage.size} "
            f"{damage.reason}"
        )

    def _account(self, expected: dict[int, int]) -> None:
        for number, channel in self._channels.items():
            if not self._keeps(channel):
                continue
            self._open(channel)  # also one that had no message
            topic = self._recovery.topics[channel.topic]
            missing = expected.get(number, 0) - self._found.get(number, 0)
            topic.lost += max(0, missing, self._missing.get(number, 0))
        nameless = sum(n for number, n in self._missing.items() if number not in self._channels)
        if self._unknown + nameless:
            self._recovery.note(
                f"{self._file.name}: {self._unknown + nameless} messages belong to no known topic, "
                "or have a time that rosbag2 cannot have"
            )
