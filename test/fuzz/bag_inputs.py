"""Hostile bags, each drawn from a seed: well-formed files with odd content, then damaged."""

from __future__ import annotations

import functools
import json
import random
import sqlite3
import struct
import tempfile
from pathlib import Path

import zstandard
from mcap.writer import CompressionType, Writer

import rpud_sim.bag
from rpud_sim.bag import Message, TopicSummary
from rpud_sim.inspection.offline_bag import write_offline_bag
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.plans import parse_scenario
from rpud_sim.simulation.run import Beginning

SEPARATOR = "=" * 80
PART = f"{SEPARATOR}\nMSG: a_msgs/B\nfloat64 x\nstring name\n"
TIME = f"{SEPARATOR}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
HEADER = (
    f"{SEPARATOR}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{TIME}"
)
NO_TEXT = b"\1\0\0\0\0"
DEFINITIONS = {  # with the data of a message
    "string data\n": NO_TEXT,
    "float64 x # [m]\nuint8[] data\nint16[3] three\nbool good\n": bytes(19),
    f"B part\nB[] parts\nB[2] two\n{PART}": (
        bytes(8) + NO_TEXT + bytes(19) + NO_TEXT + bytes(11) + NO_TEXT
    ),
    f"std_msgs/Header header\nuint64 sequence\nfloat32[] values # [N]\n{HEADER}": (
        bytes(8) + NO_TEXT + bytes(15)
    ),
    "string[] names\nstring wide\nuint8[<=4] few\nfloat64[<=3] log_time\n": (
        bytes(4) + NO_TEXT + bytes(11)
    ),
    f"B[] parts\n{SEPARATOR}\nMSG: a_msgs/B\nint8 X=1\n": bytes(4),
    f"builtin_interfaces/Time time\nbuiltin_interfaces/Time[] times\n{TIME}": bytes(12),
    "wstring wide\n": bytes(4),
    "\n": b"\0",
}
TYPES = ["a_msgs/msg/A", "rpud_msgs/msg/Waveform", "rpud_msgs/msg/Impact", "a", ""]
TOPICS = ["/a", "/rpud/contact_force", "/b/c", "no name", "/\u00e9\n\x1b[1m<b>", "../../x", ""]
OFFER = (
    "- history: keep_last\n  depth: 7\n  reliability: reliable\n  durability: volatile\n"
    "  deadline: {sec: 9223372036, nsec: 854775807}\n  lifespan: {sec: 1, nsec: 0}\n"
    "  liveliness: automatic\n  liveliness_lease_duration: {sec: 1, nsec: 0}\n"
    "  avoid_ros_namespace_conventions: false\n"
)
RECORDS = {
    "rpud_losses": {"/a": '{"transport": 1, "queue": null}'},
    "rpud_recording": {"max_loss": "1.0"},
    "rpud_manifest": {"manifest": '{"drill": {"parameters": {}}, "version": "0.1.0"}'},
    "rosbag2": {"serialized_metadata": "custom_data: {a: b}\n"},
    "notes": {"a": "b"},
}
METADATA = """rosbag2_bagfile_information:
  version: 9
  storage_identifier: {storage}
  duration: {{nanoseconds: 5}}
  starting_time: {{nanoseconds_since_epoch: 1}}
  message_count: 4
  topics_with_message_count: []
  compression_format: {format}
  compression_mode: {mode}
  relative_file_paths: [{name}]
  files: []
  custom_data: {{a: b}}
  ros_distro: jazzy
"""
NUMBERS = [0, 1, 0x7F, 0x80, 0xFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63, 2**64 - 1]
REALS = [0.0, -1.0, 1e-300, 1e9, 1e18, 1e308, float("inf"), float("-inf"), float("nan")]
VALUES = [None, True, "", "x", "two\nlines", [], {}, [0.0], 0, -1, 10**400, 2**63, *REALS]
DRILLS = (
    {"telemetry_rate": 40, "sample_rate": 1000, "block_duration": 0.1},
    {"telemetry_rate": 20, "sample_rate": 1000, "feed_model": "arm", "initial_feed": 0.005}
    | {"rotation_model": "friction_drive", "strata": "sandstone"},
)
FAULTS = [
    {"kind": "lost_preload", "onset": 0.03, "duration": 0.02},
    {"kind": "noise", "channel": "wrench", "onset": 0.04},
]
WORDS = [
    "",
    ".inf",
    "-1",
    "1e400",
    "9" * 80,
    "!!timestamp 1",
    "[1]",
    "{a: b}",
    "*a",
    "\x00",
    "\ud7ff",
]


def draw_bag(drawn: random.Random, folder: Path, of_drills: float = 0.2) -> Path:
    """Write a bag, with or without metadata, into a new folder and return its path.

    Args:
        of_drills: share of the bags that are a drill's, with a few odd messages.
    """
    folder.mkdir()
    if drawn.random() < of_drills:
        return _write_drill(drawn, folder / "bag.mcap")
    mode = drawn.choice(["", "", "", "", "FILE", "MESSAGE"])
    storage = drawn.choice(["mcap"] * 5 + ["sqlite3"])
    file = folder / ("bag.mcap" if storage == "mcap" else "bag.db3")
    write = _write_mcap if storage == "mcap" else _write_sqlite
    write(drawn, file, mode == "MESSAGE")
    content = file.read_bytes()
    if drawn.random() < 0.4:
        content = damaged(drawn, content)
    if mode == "FILE":
        file.unlink()
        file = file.with_name(f"{file.name}.zstd")
        content = zstandard.compress(content)
        if drawn.random() < 0.2:
            content = damaged(drawn, content)
    file.write_bytes(content)
    if not mode and drawn.random() < 0.7:
        return file
    text = METADATA.format(
        storage=storage, name=file.name, mode=mode or "''", format="zstd" if mode else "''"
    )
    if drawn.random() < 0.3:
        text = odd_text(drawn, text)
    (folder / "metadata.yaml").write_bytes(text.encode())
    return folder


def damaged(drawn: random.Random, content: bytes) -> bytes:
    """Damage bytes in a few places."""
    data = bytearray(content)
    for _ in range(drawn.choice([1, 1, 1, 2, 5, 20])):
        place = drawn.randrange(len(data) + 1)
        length = drawn.choice([1, 1, 4, 9, 50, 400])
        kind = drawn.randrange(6)
        if kind == 0:
            del data[place:]
        elif kind == 1:
            del data[place : place + length]
        elif kind == 2:
            data[place : place + length] = drawn.randbytes(length)
        elif kind == 3:
            source = drawn.randrange(len(data) + 1)
            data[place:place] = data[source : source + length]
        elif kind == 4:
            size = drawn.choice([1, 2, 4, 8])
            number = drawn.choice(NUMBERS) % 2 ** (8 * size)
            data[place : place + size] = number.to_bytes(size, "little")
        elif data:
            data[place % len(data)] ^= 1 << drawn.randrange(8)
    return bytes(data)


def odd_text(drawn: random.Random, text: str) -> str:
    """Change a few words or lines of a text."""
    for _ in range(drawn.choice([1, 1, 2, 4])):
        kind = drawn.randrange(4)
        lines = text.split("\n")
        at = drawn.randrange(len(lines))
        if kind == 0:
            lines.insert(at, lines[drawn.randrange(len(lines))])
        elif kind == 1:
            del lines[at]
        elif kind == 2:
            words = lines[at].split(" ")
            words[drawn.randrange(len(words))] = drawn.choice(WORDS)
            lines[at] = " ".join(words)
        else:
            place = drawn.randrange(len(text) + 1)
            lines = [text[:place] + drawn.choice(WORDS) + text[place + drawn.randrange(4) :]]
        text = "\n".join(lines)
    return text


def _maybe(drawn: random.Random, text: str) -> str:
    return odd_text(drawn, text) if drawn.random() < 0.1 else text


def _message(drawn: random.Random, valid: bytes, compressed: bool) -> bytes:
    parts = [b"\0\1\0\0" if drawn.random() < 0.9 else drawn.randbytes(drawn.randrange(5))]
    for _ in range(drawn.randrange(12)):
        parts.append(
            drawn.choice(
                [
                    struct.pack("<I", drawn.choice([0, 0, 1, 2, 3, *NUMBERS[:8]]) % 2**32),
                    struct.pack("<d", drawn.choice([0.0, 1.5, float("nan"), float("inf"), 1e308])),
                    b"\2\0\0\0a\0\0\0",
                    drawn.randbytes(drawn.randrange(9)),
                    bytes(drawn.choice([1, 8, 100, 5000])),
                ]
            )
        )
    data = b"".join(parts)
    if drawn.random() < 0.9:
        data = b"\0\1\0\0" + valid
    if compressed:
        data = zstandard.compress(data)
        return damaged(drawn, data) if drawn.random() < 0.1 else data
    return data


@functools.cache
def drill_bag(number: int) -> tuple[list[TopicSummary], list[Message], dict[str, str]]:
    """Return topics, messages and manifest of a drill's bag without damage."""
    scenario = parse_scenario({"seed": 1, "faults": FAULTS}, "scenario")
    beginning = Beginning(to_settings(DRILLS[number]), 0.2, 1, scenario)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "bag")
        write_offline_bag(path, beginning, 0.25)
        with rpud_sim.bag.open(path) as bag:
            return list(bag.topics), list(bag.messages()), bag.records("rpud_manifest")[0]


def _write_drill(drawn: random.Random, file: Path) -> Path:
    topics, messages, manifest = drill_bag(drawn.randrange(len(DRILLS)))
    written = [(each.topic, each.data, each.log_time) for each in messages]
    for _ in range(drawn.choice([0, 1, 1, 1, 2, 5, 20])):
        name = drawn.choice(topics).topic.name
        places = [place for place, each in enumerate(written) if each[0] == name]
        if places:
            place = drawn.choice(places)
            written[place : place + 1] = _odd_messages(drawn, *written[place])
    parameters = dict(manifest)
    if drawn.random() < 0.2:
        parameters["manifest"] = _odd_json(drawn, parameters["manifest"])
    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, enable_crcs=False)
        writer.start("ros2", "fuzz")
        channels = {}
        for each in topics:
            text = _maybe(drawn, each.definition or "") if drawn.random() < 0.1 else each.definition
            schema = writer.register_schema(each.topic.type, "ros2msg", (text or "").encode())
            metadata = {"topic_type_hash": each.topic.type_hash, "offered_qos_profiles": OFFER}
            channels[each.topic.name] = writer.register_channel(
                each.topic.name, "cdr", schema, metadata
            )
        for number, (name, data, time) in enumerate(written):
            writer.add_message(channels[name], time, data, time, number)
        if drawn.random() < 0.9:
            writer.add_metadata("rpud_manifest", parameters)
        writer.finish()
    if drawn.random() < 0.1:
        file.write_bytes(damaged(drawn, file.read_bytes()))
    return file


def _odd_messages(
    drawn: random.Random, name: str, data: bytes, time: int
) -> list[tuple[str, bytes, int]]:
    """Return what stands in place of a message: none, two, a later one, or one of other bytes."""
    kind = drawn.randrange(8)
    if kind == 0:
        return []
    if kind == 1:
        return [(name, data, time)] * 2
    if kind == 2:
        return [(name, data, drawn.choice(NUMBERS))]
    if kind == 3:
        return [(name, damaged(drawn, data), time)]
    changed = bytearray(data)
    place = 4 + drawn.randrange(max(1, len(data) - 4)) // 4 * 4
    number = struct.pack("<d", drawn.choice(REALS))
    if kind == 4:
        number = (drawn.choice(NUMBERS) % 2**64).to_bytes(8, "little")
    if kind == 5:
        number = (drawn.choice(NUMBERS) % 2**32).to_bytes(4, "little")
    changed[place : place + len(number)] = number
    return [(name, bytes(changed[: len(data)]), time)]


def _odd_json(drawn: random.Random, text: str) -> str:
    """Change one value of an object in JSON, or of an object in it, or a word of the text."""
    content = json.loads(text)
    inner = drawn.choice([content, *[each for each in content.values() if isinstance(each, dict)]])
    if not inner or drawn.random() < 0.1:
        return odd_text(drawn, text)
    inner[drawn.choice(list(inner))] = drawn.choice(VALUES)
    return json.dumps(content)


def _write_mcap(drawn: random.Random, file: Path, compressed: bool) -> None:
    with file.open("wb") as stream:
        writer = Writer(
            stream,
            chunk_size=drawn.choice([50, 500, 100_000]),
            compression=drawn.choice(list(CompressionType)),
            use_chunking=drawn.random() < 0.8,
            enable_crcs=drawn.random() < 0.3,  # damage is found by them
        )
        writer.start("ros2", "fuzz")
        channels = []
        for _ in range(drawn.choice([1, 1, 2, 4])):
            definition, valid = drawn.choice(list(DEFINITIONS.items()))
            text = _maybe(drawn, definition).encode()
            text = damaged(drawn, text) if drawn.random() < 0.05 else text
            encoding = drawn.choice(["ros2msg"] * 28 + ["", "ros2idl"])
            schema = writer.register_schema(drawn.choice(TYPES[:1] * 6 + TYPES), encoding, text)
            metadata = {"offered_qos_profiles": _maybe(drawn, OFFER), "topic_type_hash": "x"}
            if drawn.random() < 0.1:
                metadata["rpud_repeated"] = "true"
            topic = drawn.choice(TOPICS)
            coding = drawn.choice(["cdr"] * 29 + ["json"])
            channels.append((writer.register_channel(topic, coding, schema, metadata), valid))
        for number in range(drawn.choice([0, 1, 4, 30])):
            time = drawn.choice(NUMBERS) if drawn.random() < 0.05 else number * 10**6
            channel, valid = drawn.choice(channels)
            writer.add_message(channel, time, _message(drawn, valid, compressed), time, number)
        for name, content in RECORDS.items():
            if drawn.random() < 0.3:
                content = {key: _maybe(drawn, text) for key, text in content.items()}
                writer.add_metadata(name, content)
        if drawn.random() < 0.2:
            writer.add_attachment(1, 2, "name", "type", b"data")
        writer.finish()


def _write_sqlite(drawn: random.Random, file: Path, compressed: bool) -> None:
    with sqlite3.connect(file) as database:
        database.executescript(
            "CREATE TABLE schema(schema_version INTEGER, ros_distro TEXT);"
            "CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT,"
            " offered_qos_profiles TEXT, type_description_hash TEXT);"
            "CREATE TABLE message_definitions(id INTEGER, topic_type TEXT, encoding TEXT,"
            " encoded_message_definition TEXT, type_description_hash TEXT);"
            "CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB);"
        )
        version = drawn.choice([4, 4, 4, 3, 0, -1, "x"])
        database.execute("INSERT INTO schema VALUES (?, 'jazzy')", (version,))
        definition, valid = drawn.choice(list(DEFINITIONS.items()))
        text = _maybe(drawn, definition)
        database.execute(
            "INSERT INTO message_definitions VALUES (1, 'a_msgs/msg/A', ?, ?, 'x')",
            (drawn.choice(["ros2msg"] * 5 + ["ros2idl"]), text),
        )
        for number in range(drawn.choice([1, 2, 3])):
            row = (number, drawn.choice(TOPICS), "a_msgs/msg/A", "cdr", _maybe(drawn, OFFER), "x")
            database.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)", row)
        for number in range(drawn.choice([0, 1, 30])):
            odd = drawn.random() < 0.02
            time = drawn.choice([-1, 2**62, "x", None, 1.5]) if odd else number * 10**6
            row = (number, drawn.randrange(3), time, _message(drawn, valid, compressed))
            database.execute("INSERT INTO messages VALUES (?, ?, ?, ?)", row)
    database.close()
