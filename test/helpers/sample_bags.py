"""Small bags for the tests, made of real serialized messages."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rpud_sim.bag import BagWriter, QosProfile, Topic
from rpud_sim.messages.batch import Batch
from rpud_sim.messages.definitions import find_definition, installed_codec
from rpud_sim.recorded import offline_bag
from rpud_sim.simulation import Parameters
from rpud_sim.simulation.configuration import Configuration, Settings
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.topics import TOPICS, offered_topics

STRING = "std_msgs/msg/String"
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STRING_DEFINITION = "string data\n"
SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND

# Topics of a drill with the default parameters whose every bit a proof compares.
PLAIN_PROVED = tuple(
    name for name, topic in offered_topics(Settings().values()).items() if topic.proved
)
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


def batch_of(
    messages: Sequence[bytes], topic: str = "/a", gap: bytes = b"", times: Any = None
) -> Batch:
    """Return messages with bytes between them that are none; ``times`` has a row for each."""
    sizes = np.array([len(data) for data in messages], np.int64)
    if times is None:
        times = np.repeat(np.arange(len(messages))[:, None], 2, axis=1)
    logs, sent = np.array(times, np.int64).reshape(-1, 2).T
    data = np.frombuffer(gap + gap.join(messages), np.uint8)
    starts = np.cumsum(sizes + len(gap)) - sizes
    return Batch(topic, sent, log_times=logs, data=data, starts=starts, sizes=sizes)


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


def write_mcap(
    path: Path,
    entries: Iterable[tuple[str, int, bytes]],
    *,
    kind: str = STRING,
    definitions: Mapping[str, str | bytes] | None = None,
    encoding: str = "cdr",
    metadata: Mapping[str, str] | None = None,
    records: Iterable[tuple[str, dict[str, str]]] = (),
    publishers: int = 1,
    **options: Any,
) -> Path:
    """Write a file with the library: messages of topics at log times, sent at START and later.

    ``definitions`` are of topics other than of a text; each publisher has a channel.
    """
    entries = list(entries)
    schemas: dict[str | bytes, int] = {}
    channels: dict[str, list[int]] = {}
    with path.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start("ros2", "test")
        for topic in dict.fromkeys(topic for topic, _, _ in entries):
            text = (definitions or {}).get(topic, STRING_DEFINITION)
            if text not in schemas:
                content = text.encode() if isinstance(text, str) else text
                schemas[text] = writer.register_schema(kind, "ros2msg", content)
            channels[topic] = [
                writer.register_channel(topic, encoding, schemas[text], dict(metadata or {}))
                for _ in range(publishers)
            ]
        for number, (topic, log_time, data) in enumerate(entries):
            channel = channels[topic][number % publishers]
            writer.add_message(channel, log_time, data, START + number)
        for name, content in records:
            writer.add_metadata(name, content)
        writer.finish()
    return path


def rewrite(path: Path, old: str | bytes, new: str | bytes) -> None:
    """Replace a part of a file that it has."""
    old, new = (part.encode() if isinstance(part, str) else part for part in (old, new))
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new))


# YAML whose aliases grow to 10 billion values.
LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 10)}]\n"
    for before, name in zip("abcdefghij", "bcdefghijk", strict=True)
)

SEPARATOR = "=" * 80
EVERYTHING = f"""uint8 CONSTANT=3 # [not a field]
builtin_interfaces/Time stamp # of the reading
builtin_interfaces/Duration age
pkg/Part part # [m]
pkg/Part[] parts
float64[4] matrix # row by row [N, m]
float32[] ranges # distances [m]
bool[] flags
string[] names
string note
byte raw
bool good # whether it is [1]
int8 small
uint64 large
float64 log_time # a field of its own [s]
{SEPARATOR}
MSG: pkg/Part
float64 x
float64 turn # [rad]
{SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{SEPARATOR}
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
"""
MESSAGE = {
    "stamp": {"sec": 12, "nanosec": 34},
    "age": {"sec": -1, "nanosec": 5},
    "part": {"x": 1.5, "turn": float("nan")},
    "parts": [{"x": 2.0, "turn": 3.0}],
    "matrix": np.array([1.0, 2.0, 3.0, 4.0]),
    "ranges": np.array([0.5, np.inf], np.float32),
    "flags": np.array([True, False]),
    "names": ["a", "b"],
    "note": "größer",
    "raw": -56,  # rosbags has bytes signed
    "good": True,
    "small": -3,
    "large": 2**64 - 1,
    "log_time": 4.5,
}


def serialized(type_name: str, definition: str, fields: dict[str, Any]) -> bytes:
    """Serialize a message of any type, as others do; messages in it are dictionaries."""

    def to_object(value: Any) -> Any:
        if isinstance(value, dict):
            return SimpleNamespace(**{name: to_object(item) for name, item in value.items()})
        return [to_object(item) for item in value] if isinstance(value, list) else value

    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, type_name))
    return bytes(store.serialize_cdr(to_object(fields), type_name))


def write_everything(path: Path, count: int = 3) -> Path:
    """Write `count` messages of a type with fields of all kinds on /all, and none on /none."""
    with BagWriter(path) as bag:
        bag.add_topic(Topic("/all", "pkg/msg/Everything"), EVERYTHING)
        bag.add_topic(Topic("/none", "pkg/msg/Everything"), EVERYTHING)
        for number in range(count):
            fields = {**MESSAGE, "small": number - 3}
            data = serialized("pkg/msg/Everything", EVERYTHING, fields)
            bag.write("/all", data, START + number * SECOND, START)
    return path


# What `write_damaged` damages, and words of the reasons.
DAMAGED = {
    "record rpud_losses": "unreadable",
    "record rpud_manifest": "unreadable",
    TALK.name: "2 of its messages: ",
}


def write_damaged(path: Path) -> Path:
    """Write a bag with three whole messages on TALK, and with all of DAMAGED."""
    with BagWriter(path) as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        for number in range(5):
            time = START + number * SECOND
            data = serialized_string("whole") if number % 2 == 0 else b"\x00\x01\x00\x00\xff"
            bag.write(TALK.name, data, time, time)
        bag.add_record("rpud_losses", {"losses": "["})
        bag.add_record("rpud_manifest", {"manifest": "["})
    return path


def write_offline_bag(
    path: Path, parameters: Parameters, duration: float, phase=0.0, scenario=(), seed=0
) -> None:
    """Write the bag of a run without ROS at the default rates."""
    settings = Settings(Configuration(parameters))
    plan = Plan(Beginning(settings, phase, seed, scenario))
    offline_bag.write_offline_bag(path, plan, duration)


def long_waveform(path: Path, size: int) -> Path:
    """Write blocks of noise on ``/rpud/waveform``, not compressed, with so many bytes of samples.

    Args:
        path: of the new bag.
        size: of the samples [bytes].
    """
    kind, block_size, rate = TOPICS["waveform"].type, 2500, 50_000
    definition, codec = find_definition(kind), installed_codec(kind)
    numbers = np.random.default_rng(1)
    arrays = {
        name: array("d", numbers.normal(size=block_size))
        for name in (
            "nodal_plane_position",
            "actuator_position",
            "free_mass_position",
            "drill_tool_displacement",
            "contact_force",
            "reacting_force",
        )
    }
    with BagWriter(path, compression="none") as bag:
        bag.add_topic(Topic("/rpud/waveform", kind), definition)
        for block in range(size // (block_size * len(arrays) * 8)):
            moment = block * block_size * SECOND // rate
            stamp = {"sec": moment // SECOND, "nanosec": moment % SECOND}
            fields = {"header": {"stamp": stamp, "frame_id": "rpud_mount"}}
            fields |= {"sequence": block * block_size, "sample_period": 1.0 / rate, **arrays}
            bag.write("/rpud/waveform", codec.encode(fields), moment, moment)
    return path
