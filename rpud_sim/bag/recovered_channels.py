"""Channels of a recovered bag, from those of the torn files."""

from __future__ import annotations

from typing import Any

from mcap.records import Channel, Schema

from rpud_sim.bag.bag_folder import BagFolder
from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.metadata import SIZE_LIMIT, Topic, dump_offered_qos, load_offered_qos
from rpud_sim.bag.qos import QosProfile
from rpud_sim.bag.recovery_account import Recovery
from rpud_sim.bag.sequence import SequenceCounter

_OFFERS = "offered_qos_profiles"
_LISTED_LIMIT = SIZE_LIMIT * 3 // 4  # of metadata.yaml, for its topics


class RecoveredChannels:
    """Channels of the new bag; files of one bag have the same ones under other numbers."""

    def __init__(self, bag: BagFolder, recovery: Recovery) -> None:
        self._bag = bag
        self._recovery = recovery
        self._listed = 0  # characters of metadata.yaml, at most
        self._numbers: dict[tuple[Any, ...], int] = {}
        self._counters: dict[int, tuple[str, SequenceCounter]] = {}

    def number(self, channel: Channel, schema: Schema | None) -> int:
        """Return the number of a file's channel in the new bag, declared if it is new."""
        kind = (schema.name, schema.encoding, schema.data) if schema else ()
        metadata = tuple(sorted(channel.metadata.items()))
        key = (channel.topic, channel.message_encoding, kind, metadata)
        if key not in self._numbers:
            self._numbers[key] = self._declare(channel, schema)
        return self._numbers[key]

    def note(self, number: int, data: bytes) -> None:
        """Note a message of the new bag's channel, to count gaps."""
        self._counters[number][1].note(data)

    def count_gaps(self) -> None:
        for name, counter in self._counters.values():
            if counter.gaps is not None:
                topic = self._recovery.topic(name)
                topic.gaps = (topic.gaps or 0) + counter.gaps

    def _declare(self, channel: Channel, schema: Schema | None) -> int:
        type_name = schema.name if schema else ""
        schema, definition = self._readable(schema)
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
        number = self._bag.add_channel(topic, schema, metadata)
        counter = SequenceCounter(definition, max(1, len(offers)))
        self._counters[number] = (channel.topic, counter)
        self._recovery.topic(channel.topic, type_name)
        return number

    def _readable(self, schema: Schema | None) -> tuple[Schema | None, str]:
        """Return a schema without a definition that is not UTF-8, and its ``ros2msg`` text."""
        if schema is None or schema.encoding != "ros2msg":
            return schema, ""
        try:
            return schema, schema.data.decode()
        except UnicodeDecodeError:
            self._recovery.note(f"the definition of {schema.name:.80} is left out: it is not UTF-8")
            return Schema(id=schema.id, name=schema.name, encoding="", data=b""), ""

    def _offers(self, channel: Channel) -> tuple[dict[str, str], tuple[QosProfile, ...]]:
        """Return a channel's metadata and its offers, both without offers that are unreadable."""
        try:
            offers = load_offered_qos(channel.metadata.get(_OFFERS, ""))
            if load_offered_qos(dump_offered_qos(offers)) == offers:
                return channel.metadata, offers
            reason = "they cannot be written as they were read"
        except BagFormatError as error:
            reason = str(error)
        self._recovery.note(f"the offers on {channel.topic:.200} are left out: {reason}")
        return {key: text for key, text in channel.metadata.items() if key != _OFFERS}, ()
