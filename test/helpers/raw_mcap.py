"""MCAP files record by record: legal ones that few writers make, and wrong hints on purpose."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from mcap.opcode import Opcode

MAGIC = b"\x89MCAP0\r\n"
ALL = frozenset({"channels", "schemas", "statistics", "chunks", "message indexes", "metadata"})

Message = tuple[str, int, bytes]  # topic, log time [ns], CDR


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(value: str | bytes) -> bytes:
    content = value.encode() if isinstance(value, str) else value
    return struct.pack("<I", len(content)) + content


@dataclass(frozen=True)
class Chunk:
    """Messages that are together in a chunk, and what its index says of their times."""

    messages: Sequence[Message]
    index_times: tuple[int, int] | None = None  # None for the true ones


@dataclass(frozen=True)
class RawMcap:
    """File of chunks, and of messages outside of chunks."""

    parts: Sequence[Chunk | Message]
    held: Collection[str] = ALL  # parts of the summary section, and indexes of messages
    pad: bytes = b""  # behind the fields of every record but messages, attachments and the footer
    footer_pad: bytes = b""
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    statistics: Mapping[str, int] = field(default_factory=dict)  # wrong values, by their names
    unknown: bool = False  # whether there is a record of a later version between the others
    summary: bool = True
    type: str = "std_msgs/msg/String"
    encoding: str = "ros2msg"
    definition: bytes = b"string data\n"

    def __post_init__(self) -> None:
        """Prepare the numbers of the channels."""
        flat = [m for p in self.parts for m in (p.messages if isinstance(p, Chunk) else [p])]
        object.__setattr__(self, "_flat", flat)
        numbers = {name: n for n, name in enumerate(dict.fromkeys(m[0] for m in flat), 1)}
        object.__setattr__(self, "_numbers", numbers)

    def record(self, opcode: int, content: bytes) -> bytes:
        return record(opcode, content + self.pad)

    def content(self) -> bytes:
        """Return the bytes of the file."""
        flat: list[Message] = self._flat  # type: ignore[attr-defined]
        numbers: dict[str, int] = self._numbers  # type: ignore[attr-defined]
        kind = text(self.type) + text(self.encoding) + text(self.definition)
        schema = self.record(Opcode.SCHEMA, struct.pack("<H", 1) + kind)
        channels = b"".join(
            self.record(
                Opcode.CHANNEL, struct.pack("<HH", n, 1) + text(name) + text("cdr") + text(b"")
            )
            for name, n in numbers.items()
        )
        data = MAGIC + self.record(Opcode.HEADER, text("ros2") + text("test"))
        if any(not isinstance(part, Chunk) for part in self.parts):
            data += schema + channels
        if self.unknown:
            data += record(0x20, b"of a later version") + record(0x81, b"of somebody")
        chunk_indexes, metadata_indexes, count = b"", b"", 0
        for part in self.parts:
            if not isinstance(part, Chunk):
                data += self.message(part)
                continue
            inner = schema + channels + b"".join(map(self.message, part.messages))
            times = [m[1] for m in part.messages] or [0]
            span = min(times), max(times)
            crc = zlib.crc32(inner)
            head = struct.pack("<QQQI", *span, len(inner), crc) + text("")
            chunk = self.record(Opcode.CHUNK, head + struct.pack("<Q", len(inner)) + inner)
            start, data = len(data), data + chunk
            offsets, indexes, count = b"", b"", count + 1
            if "message indexes" in self.held:
                for name in dict.fromkeys(m[0] for m in part.messages):
                    entries = b"".join(
                        struct.pack("<QQ", m[1], 0) for m in part.messages if m[0] == name
                    )
                    offsets += struct.pack("<HQ", numbers[name], len(data) + len(indexes))
                    indexes += self.record(
                        Opcode.MESSAGE_INDEX, struct.pack("<H", numbers[name]) + text(entries)
                    )
            data += indexes
            chunk_indexes += self.record(
                Opcode.CHUNK_INDEX,
                struct.pack("<QQQQ", *(part.index_times or span), start, len(chunk))
                + text(offsets)
                + struct.pack("<Q", len(indexes))
                + text("")
                + struct.pack("<QQ", len(inner), len(inner)),
            )
        for name, content in self.metadata.items():
            entries = b"".join(text(key) + text(value) for key, value in content.items())
            one = self.record(Opcode.METADATA, text(name) + text(entries))
            metadata_indexes += self.record(
                Opcode.METADATA_INDEX, struct.pack("<QQ", len(data), len(one)) + text(name)
            )
            data += one
        data += self.record(Opcode.DATA_END, struct.pack("<I", 0))
        sections = {
            "schemas": schema,
            "channels": channels,
            "statistics": self.statistics_record(flat, numbers, count),
            "chunks": chunk_indexes,
            "metadata": metadata_indexes,
        }
        summary = b"".join(each for name, each in sections.items() if name in self.held)
        start = len(data) if self.summary and summary else 0
        footer = record(Opcode.FOOTER, struct.pack("<QQI", start, 0, 0) + self.footer_pad)
        return data + (summary if self.summary else b"") + footer + MAGIC

    def message(self, message: Message) -> bytes:
        topic, time, data = message
        number = self._numbers[topic]  # type: ignore[attr-defined]
        return record(Opcode.MESSAGE, struct.pack("<HIQQ", number, 0, time, time) + data)

    def statistics_record(
        self, flat: Sequence[Message], numbers: Mapping[str, int], chunks: int
    ) -> bytes:
        times = [m[1] for m in flat] or [0]
        values = {
            "message_count": len(flat),
            "schema_count": 1,
            "channel_count": len(numbers),
            "attachment_count": 0,
            "metadata_count": len(self.metadata),
            "chunk_count": chunks,
            "message_start_time": min(times),
            "message_end_time": max(times),
            **self.statistics,
        }
        amounts = Counter(numbers[m[0]] for m in flat)
        counts = b"".join(struct.pack("<HQ", *each) for each in amounts.items())
        fixed = struct.pack("<QHIIIIQQ", *values.values())
        return self.record(Opcode.STATISTICS, fixed + text(counts))

    def without(self, *names: str) -> RawMcap:
        return replace(self, held=frozenset(self.held) - {*names})
