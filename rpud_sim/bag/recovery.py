"""Recovery of the whole chunks of a truncated or damaged bag into a new one, in bounded memory.

Records follow each other by their lengths. Behind a record without a valid length the recovery
continues at the next chunk that the summary section lists, and ends where there is none.
"""

from __future__ import annotations

import os
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema

from rpud_sim.bag.folders import BagFiles, mcap_files, storage_files, without_copies
from rpud_sim.bag.mcap_contents import check_declared, summary_of
from rpud_sim.bag.mcap_writer import MessageRecords
from rpud_sim.bag.metadata import (
    FILE_NAME,
    LOSSES_RECORD,
    OFFERED_QOS_KEY,
    RECORD_NAME,
    RECORDING_RECORD,
    QosProfile,
    Topic,
    dump_offered_qos,
    load_offered_qos,
    losses_from_record,
)
from rpud_sim.bag.reader import BagReader
from rpud_sim.bag.records import (
    HEAD,
    MAGIC,
    RECORD,
    UNREADABLE,
    RawRecord,
    RecordFile,
    message_index,
    parse,
    reading,
    split_records,
    uncompressed,
)
from rpud_sim.bag.recovery_account import Recovery
from rpud_sim.bag.writer import BagWriter, whole_bag
from rpud_sim.foundation.json_text import json_text
from rpud_sim.foundation.user_files import open_file
from rpud_sim.messages.batch import LATEST
from rpud_sim.messages.encoder import gathered, items
from rpud_sim.messages.errors import (
    BagError,
    BagFormatError,
    BagNotFoundError,
    BagWarning,
    OtherStorageError,
)

# Metadata record of a recovered bag with the account of its recovery.
RECOVERY_RECORD = "rpud_recovery"


def recover(
    torn: str | os.PathLike[str],
    out: str | os.PathLike[str],
    progress: Callable[[int], object] = lambda _: None,
) -> Recovery:
    """Write a new bag from a truncated one, which is not changed, and return the account.

    ``torn`` is an MCAP file or a bag's directory. A recovery that fails leaves nothing at ``out``.
    ``progress`` is called with the bytes that were read since the last call.
    """
    chosen = files_to_recover(torn)
    recovery = Recovery(Path(out))
    for reason in (*chosen.missing, *chosen.gaps):
        recovery.note(f"lost: {reason}")
    for text in chosen.warnings:
        warnings.warn(BagWarning(text), stacklevel=2)
    with whole_bag(out) as bag:
        numbers: dict[tuple[Any, ...], int] = {}
        found = [
            _TruncatedFile(file, bag, recovery, numbers).recover(progress) for file in chosen.files
        ]
        if not any(found):
            raise BagFormatError(f"{torn} has no part of an MCAP file")
        bag.add_record(RECOVERY_RECORD, {"account": json_text(recovery.to_mapping())})
        bag.close()
        with BagReader(bag.path) as whole:
            _ = whole.topics  # raises an error if the new bag cannot be listed
    return recovery


def files_to_recover(torn: str | os.PathLike[str]) -> BagFiles:
    """Return the MCAP files of a bag, whether or not its metadata can be read."""
    path = Path(torn)
    try:
        found = storage_files(path)
    except OtherStorageError:
        raise
    except BagFormatError:  # damaged metadata
        found = BagFiles(())
    folder = path.parent if path.name == FILE_NAME and path.is_file() else path
    files = [file for file in found.files if file.is_file()]
    if folder.is_dir():
        # Of a truncated bag the metadata may be missing, or be older than its last files.
        files += [file for file in mcap_files(folder) if file.is_file() and file not in files]
    if not files:
        raise BagNotFoundError(f"there is no MCAP file at {torn}")
    distinct = without_copies(files)
    said = (*found.warnings, *distinct.warnings)
    return found._replace(files=distinct.files, warnings=tuple(dict.fromkeys(said)))


class _TruncatedFile:
    """File of a bag that is recovered into a new bag.

    ``numbers`` maps the content of a channel to its number in the new bag.
    """

    def __init__(
        self, path: Path, bag: BagWriter, recovery: Recovery, numbers: dict[tuple[Any, ...], int]
    ) -> None:
        self._path, self._bag, self._recovery = path, bag, recovery
        self._numbers = numbers
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._number_of: dict[int, int] = {}  # number in the new bag by the file's channel
        self._found: Counter[int] = Counter()  # messages of each channel
        self._missing: Counter[int] = Counter()  # messages of each channel in lost chunks
        self._unknown = 0  # messages of undeclared channels
        self._loose = 0  # messages outside of chunks
        self._index_lost = False  # whether the next message indexes belong to a lost chunk

    def recover(self, progress: Callable[[int], object]) -> bool:
        """Recover the file, and return whether it contains any part of an MCAP file."""
        expected, listed = self._read_summary()
        with reading(self._path), open_file(self._path) as stream:
            self._file = file = RecordFile(stream)
            held = file.content(0, len(MAGIC)) == MAGIC
            offset, kind, ended = min(len(MAGIC), file.size), 0, False
            progress(offset)
            while offset < file.size and not ended:
                ended = file.content(offset, len(MAGIC) + 1) == MAGIC
                if ended:
                    end = file.size
                elif found := self._add(offset):
                    kind, end = found
                    held = True
                else:
                    end = next((place for place in listed if place > offset), file.size)
                    kind = 0
                    self._damage(offset, end, f"({end - offset} bytes) is not a whole chunk")
                progress(end - offset)
                offset = end
        self._recovery.closed &= ended and kind == Opcode.FOOTER
        if self._loose:
            self._note(f"{self._loose} messages outside of chunks are left out")
        self._account(expected)
        return held

    def _add(self, offset: int) -> tuple[int, int] | None:
        """Add the record at an offset; return its kind and its end, None without a record."""
        head = self._file.head(offset)
        if head is None or head[1] > self._file.size:
            return None
        kind, end = head
        if kind == Opcode.CHUNK:
            return head if self._add_chunk(offset, end) else None
        if kind == Opcode.ATTACHMENT:
            self._note(f"byte {offset} to {end} is an attachment, which is left out")
        elif kind == Opcode.MESSAGE:
            self._loose += 1
        else:
            try:
                record = self._file.record(offset)
                if kind != Opcode.MESSAGE_INDEX:
                    self._index_lost = False
                    self._add_record(record, checked=False)
                elif self._index_lost:
                    channel, entries = message_index(record)
                    self._missing[channel] += len(entries)
            except UNREADABLE:
                return None
        return head

    def _add_chunk(self, offset: int, end: int) -> bool:
        """Add a chunk, or note why it is lost; return whether its length can be relied on."""
        self._index_lost = True
        try:
            chunk = parse(self._file.record(offset))
            assert isinstance(chunk, Chunk)
            data, checked = uncompressed(chunk), chunk.uncompressed_crc != 0
            declarations, places, heads = split_records(data)
            for record in declarations:
                self._add_record(record, checked)
        except UNREADABLE as error:
            if not self._file.continues(end):
                return False
            reason = error if isinstance(error, BagFormatError) else "it cannot be uncompressed"
            self._damage(offset, end, f"is a lost chunk: {reason}")
        else:
            self._add_messages(data, places, heads, checked)
            self._index_lost = False
        return True

    def _read_summary(self) -> tuple[Mapping[int, int], list[int]]:
        """Declare what the summary section declares; return messages by channel, and chunks.

        The first is empty if the section lacks something; of a damaged one nothing is declared.
        """
        try:
            with reading(self._path), open_file(self._path) as stream:
                found = summary_of(RecordFile(stream))
        except BagError:
            return {}, []
        declared: list[Schema | Channel] = [*found.schemas.values(), *found.channels.values()]
        for record in declared:
            self._declare(record, True)
        return {} if found.lacks else found.counts, sorted(chunk.start for chunk in found.chunks)

    def _add_record(self, raw: RawRecord, checked: bool) -> None:
        record = parse(raw)
        if isinstance(record, Schema | Channel):
            self._declare(record, checked)
        elif isinstance(record, Metadata) and record.name != RECORD_NAME:  # the bag has its own
            try:
                if record.name == LOSSES_RECORD:
                    for name, losses in losses_from_record(record.metadata).items():
                        self._recovery.topic(name).recording_losses = losses
            except BagFormatError as error:
                self._note(f"a record is left out: {error}")
                return
            if record.name == RECORDING_RECORD:
                with suppress(ValueError):
                    self._recovery.max_loss = float(record.metadata.get("max_loss", ""))
            self._bag.add_record(record.name, record.metadata)

    def _declare(self, record: Schema | Channel, checked: bool) -> None:
        """Note a declaration; one with a checksum replaces others of its number."""
        known: dict[int, Any] = self._schemas if isinstance(record, Schema) else self._channels
        if record.id in known and (not checked or known[record.id] == record):
            return
        known[record.id] = record
        check_declared(self._schemas, self._channels)
        self._number_of.clear()

    def _add_messages(
        self, data: bytes, places: np.ndarray, heads: np.ndarray, checked: bool
    ) -> None:
        """Add messages with their heads, and with the numbers of the new bag's channels."""
        known = np.maximum(heads["log_time"], heads["publish_time"]) <= LATEST
        known &= np.isin(heads["channel"], [*self._channels])
        self._unknown += int((~known).sum())
        places, heads = places[known], heads[known]
        numbers = np.zeros(2**16, np.int64)  # numbers in the new bag
        channels, counts = np.unique(heads["channel"], return_counts=True)
        for channel, count in zip(channels.tolist(), counts.tolist(), strict=True):
            numbers[channel] = self._number(channel)
            self._found[channel] += count
            account = self._recovery.topics[self._channels[channel].topic]
            account.recovered += count
            account.unchecked += 0 if checked else count
        own = numbers[heads["channel"]]
        if not len(own):
            return
        heads["channel"] = own
        sizes = heads["length"].astype(np.int64) + RECORD.size
        content, ends = gathered(np.frombuffer(data, np.uint8), places, sizes), np.cumsum(sizes)
        items(content, f"V{HEAD.itemsize}")[ends - sizes] = heads.view(f"V{HEAD.itemsize}")
        log_times = heads["log_time"].astype(np.int64)
        self._bag.write_records(MessageRecords(content, ends, own, log_times))

    def _number(self, channel_id: int) -> int:
        """Return the number of a channel in the new bag, declared if it is new."""
        if channel_id not in self._number_of:
            channel = self._channels[channel_id]
            schema = self._schemas.get(channel.schema_id)
            kind = (schema.name, schema.encoding, schema.data) if schema else ()
            metadata = tuple(sorted(channel.metadata.items()))
            key = (channel.topic, channel.message_encoding, kind, metadata)
            if key not in self._numbers:
                self._numbers[key] = self._add_channel(channel, schema)
            self._number_of[channel_id] = self._numbers[key]
        return self._number_of[channel_id]

    def _add_channel(self, channel: Channel, schema: Schema | None) -> int:
        """Declare a channel without what a bag cannot hold: the account gets the reasons."""
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
            offers = load_offered_qos(metadata.get(OFFERED_QOS_KEY, ""))
            if load_offered_qos(dump_offered_qos(offers)) != offers:
                raise BagFormatError("they cannot be written as they were read")
        except BagFormatError as error:
            self._recovery.note(f"the offers on {channel.topic:.200} are left out: {error}")
            offers = ()
            del metadata[OFFERED_QOS_KEY]
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
            self._number(number)  # also without a message
            missing = expected.get(number, 0) - self._found[number]
            topic = self._recovery.topics[channel.topic]
            topic.lost += max(0, missing, self._missing[number])
        undeclared = self._missing.keys() - self._channels.keys()
        unknown = self._unknown + sum(self._missing[number] for number in undeclared)
        if unknown:
            reason = "belong to no known topic, or have a time that rosbag2 cannot have"
            self._note(f"{unknown} messages {reason}")

    def _damage(self, offset: int, end: int, reason: str) -> None:
        self._recovery.size_lost += end - offset
        self._note(f"byte {offset} to {end} {reason}")

    def _note(self, reason: str) -> None:
        self._recovery.note(f"{self._path.name}: {reason}")
