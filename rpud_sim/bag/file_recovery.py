"""Recovery of one file of a torn bag."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Message, Metadata, Schema

from rpud_sim.bag.bag_folder import BagFolder
from rpud_sim.bag.errors import BagError, BagFormatError, reading
from rpud_sim.bag.latched import REPEATED_KEY
from rpud_sim.bag.losses import RECORD_NAME as LOSSES_RECORD
from rpud_sim.bag.losses import RECORDING_RECORD, losses_from_record
from rpud_sim.bag.mcap_file import McapFile
from rpud_sim.bag.metadata import LATEST, RECORD_KEY, metadata_from_record
from rpud_sim.bag.metadata import RECORD_NAME as ROSBAG2_RECORD
from rpud_sim.bag.recovered_channels import RecoveredChannels
from rpud_sim.bag.recovery_account import Recovery
from rpud_sim.bag.scan import Damage, Missing, Scan

_DECLARED_LIMIT = 64 * 2**20  # bytes of all channels and schemas
_KEPT_LIMIT = 64 * 2**20  # bytes of all metadata records
_CUSTOM_DATA_LIMIT = 2**20  # characters


class FileRecovery:
    """Recovery of one file into a new bag; ``repeats`` keeps messages that it repeats."""

    def __init__(
        self,
        file: Path,
        bag: BagFolder,
        recovery: Recovery,
        channels: RecoveredChannels,
        repeats: bool,
    ) -> None:
        self._file = file
        self._bag = bag
        self._recovery = recovery
        self._outputs = channels
        self._repeats = repeats
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._sure: set[tuple[type, int]] = set()  # declarations with a checksum
        self._declared = 0
        self._numbers: dict[int, int] = {}  # of the file's channels in the new bag
        self._found: Counter[int] = Counter()  # messages of each channel
        self._missing: Counter[int] = Counter()  # messages of each channel in lost chunks
        self._kept = 0  # characters of metadata records
        self._unknown = 0  # messages of undeclared channels

    def run(self, progress: Callable[[int], object]) -> None:
        """Recover the file; call ``progress`` with the bytes read since the last call."""
        expected = self._read_summary()
        with reading(self._file), self._file.open("rb") as stream:
            scan = Scan(stream, os.fstat(stream.fileno()).st_size)
            before = 0
            for item in scan:
                if isinstance(item, Damage):
                    self._add_damage(item)
                elif isinstance(item, Missing):
                    self._missing[item.channel] += item.count
                elif isinstance(item.record, Message):
                    self._add_message(item.record, item.checked)
                else:
                    self._add_record(item.record, item.checked)
                progress(scan.position - before)
                before = scan.position
            progress(scan.position - before)
        self._recovery.closed &= scan.closed
        self._account(expected)

    def _read_summary(self) -> Mapping[int, int]:
        """Declare what a whole summary section declares; return its number of messages by channel.

        Nothing is declared, and the result empty, if there is no such section.
        """
        try:
            with McapFile(self._file) as file:
                for schema in file.schemas.values():
                    self._declare(schema, True)
                for channel in file.channels.values():
                    self._declare(channel, True)
                return file.statistics.channel_message_counts
        except BagError:
            return {}

    def _add_record(self, record: Any, checked: bool) -> None:
        if isinstance(record, Schema | Channel):
            self._declare(record, checked)
        elif isinstance(record, Attachment):
            self._bag.add_attachment(record)
        elif isinstance(record, Metadata) and record.name == ROSBAG2_RECORD:
            with suppress(BagFormatError):  # the new bag has its own; only custom data is kept
                content = metadata_from_record(record.metadata.get(RECORD_KEY, ""))
                add_custom_data(self._bag, self._recovery, content.custom_data)
        elif isinstance(record, Metadata):
            try:
                self._add_metadata(record)
            except BagFormatError as error:
                self._recovery.note(f"{self._file.name}: a record is left out: {error}")

    def _add_metadata(self, record: Metadata) -> None:
        """Copy a record. Raise BagFormatError if the new bag cannot hold it."""
        size = _characters(record.metadata)
        if self._kept + size > _KEPT_LIMIT:
            raise BagFormatError(f"all together have more than {_KEPT_LIMIT} characters")
        if record.name == LOSSES_RECORD:
            for name, losses in losses_from_record(record.metadata).items():
                self._recovery.topic(name).recording_losses = losses
        if record.name == RECORDING_RECORD:
            with suppress(ValueError):
                self._recovery.max_loss = float(record.metadata.get("max_loss", ""))
        self._kept += size
        self._bag.add_record(record.name, record.metadata)

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

    def _add_message(self, message: Message, checked: bool) -> None:
        channel = self._channels.get(message.channel_id)
        if channel is None or max(message.log_time, message.publish_time) > LATEST:
            self._unknown += 1
            return
        self._found[channel.id] += 1
        if not self._is_kept(channel):
            return
        number = self._number(channel)
        self._bag.write(
            number, message.data, message.log_time, message.publish_time, message.sequence
        )
        topic = self._recovery.topics[channel.topic]
        topic.recovered += 1
        topic.unchecked += not checked
        self._outputs.note(number, message.data)

    def _is_kept(self, channel: Channel) -> bool:
        return self._repeats or REPEATED_KEY not in channel.metadata

    def _number(self, channel: Channel) -> int:
        number = self._numbers.get(channel.id)
        if number is None:
            number = self._outputs.number(channel, self._schemas.get(channel.schema_id))
            self._numbers[channel.id] = number
        return number

    def _add_damage(self, damage: Damage) -> None:
        self._recovery.size_lost += damage.size
        self._recovery.note(
            f"{self._file.name}: byte {damage.offset} to {damage.offset + damage.size} "
            f"{damage.reason}"
        )

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
            self._recovery.note(
                f"{self._file.name}: {unknown} messages belong to no known topic, "
                "or have a time that rosbag2 cannot have"
            )


def add_custom_data(bag: BagFolder, recovery: Recovery, content: Mapping[str, str]) -> None:
    """Add custom data to a recovered bag, or note in its account that it is too large."""
    size = _characters(content)
    if size > _CUSTOM_DATA_LIMIT:
        recovery.note(f"custom data of {size} characters is left out: at most {_CUSTOM_DATA_LIMIT}")
    else:
        bag.add_custom_data(content)


def _characters(content: Mapping[str, str]) -> int:
    return sum(len(text) for item in content.items() for text in item)
