"""Small bags for the tests, made of real serialized messages."""

from __future__ import annotations

import struct
from pathlib import Path

from rpud_sim.bag import BagWriter, QosProfile, Topic

STRING = "std_msgs/msg/String"
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STRING_DEFINITION = "string data\n"
SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND

TALK = Topic("/rpud/talk", STRING, STRING_HASH, (QosProfile(),))
CHAT = Topic(
    "/rpud/chat",
    STRING,
    STRING_HASH,
    (QosProfile(reliability="best_effort"), QosProfile(durability="transient_local")),
)


def serialized_string(text: str) -> bytes:
    """Serialize a std_msgs/String as little-endian CDR."""
    data = text.encode()
    return b"\x00\x01\x00\x00" + struct.pack("<I", len(data) + 1) + data + b"\x00"


def write_bag(
    path: Path, count: int = 10, *, compression: str = "zstd", chunk_size: int = 1 << 20
) -> Path:
    """Write `count` messages on TALK, one each millisecond from START, and none on CHAT."""
    with BagWriter(path, compression=compression, chunk_size=chunk_size) as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        bag.add_topic(CHAT, STRING_DEFINITION)
        for number in range(count):
            time = START + number * 1_000_000
            bag.write(TALK.name, serialized_string(f"message {number}"), time, time - 1000)
    return path
