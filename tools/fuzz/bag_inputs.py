"""Hostile bags, each drawn from a seed: well-formed files with odd content, then damaged."""

from __future__ import annotations

import functools
import json
import random
import struct
import tempfile
from pathlib import Path
from typing import NamedTuple

from mcap.writer import CompressionType, Writer

import rpud_sim.bag
from rpud_sim.bag import Message, TopicSummary
from rpud_sim.recorded.offline_bag import write_offline_bag
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.scenario_file import parse_scenario
from tools.fuzz import hostile

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
  storage_identifier: mcap
  duration: {nanoseconds: 5}
  starting_time: {nanoseconds_since_epoch: 1}
  message_count: 4
  topics_with_message_count: []
  compression_format: ''
  compression_mode: ''
  relative_file_paths: [bag.mcap]
  files: []
  custom_data: {a: b}
  ros_distro: jazzy
"""
VALUES = [None, True, [], {}, [0.0], 0, -1, 10**400, 2**63, *hostile.NUMBERS, *hostile.WORDS]
DRILLS = (
    {"telemetry_rate": 40, "sample_rate": 1000, "block_duration": 0.1},
    {"telemetry_rate": 20, "sample_rate": 1000, "feed_model": "arm", "initial_feed": 0.005}
    | {"rotation_model": "friction_drive", "strata": "sandstone"},
)
FAULTS = [
    {"kind": "lost_preload", "onset": 0.03, "duration": 0.02},
    {"kind": "noise", "channel": "wrench", "onset": 0.04},
]
WORDS = (".inf", "-1", "1e400", "9" * 80, "!!timestamp 1", "[1]", "{a: b}", *hostile.WORDS)


class Content(NamedTuple):
    """Content of a bag."""

    topics: list[tuple[str, str, str, str]]  # name, type, hash of the type, definition
    messages: list[tuple[int, bytes, int]]  # number of the topic, data and time
    records: list[tuple[str, dict[str, str]]]


def draw_bag(drawn: random.Random, folder: Path, of_drills: float = 0.2) -> Path:
    """Write a bag, with or without metadata, into a new folder and return its path.

    Args:
        of_drills: share of the bags that are a drill's, with a few odd messages.
    """
    folder.mkdir()
    file = folder / "bag.mcap"
    if drawn.random() < of_drills:
        _write_mcap(drawn, file, _drill_content(drawn), 0.01)
        if drawn.random() < 0.1:
            file.write_bytes(damaged(drawn, file.read_bytes()))
        return file
    _write_mcap(drawn, file, _small_content(drawn), 0.1)
    if drawn.random() < 0.4:
        file.write_bytes(damaged(drawn, file.read_bytes()))
    if drawn.random() < 0.7:
        return file
    text = METADATA
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
            number = hostile.whole(drawn, 8 * size)
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


def _maybe(drawn: random.Random, text: str, share: float = 0.1) -> str:
    return odd_text(drawn, text) if drawn.random() < share else text


def _small_content(drawn: random.Random) -> Content:
    topics = []
    for _ in range(drawn.choice([1, 1, 2, 4])):
        definition, valid = drawn.choice(list(DEFINITIONS.items()))
        name, kind = drawn.choice(TOPICS), drawn.choice(TYPES[:1] * 6 + TYPES)
        topics.append(((name, kind, "x", definition), valid))
    messages = []
    for number in range(drawn.choice([0, 1, 4, 30])):
        time = hostile.whole(drawn, 64) if drawn.random() < 0.05 else number * 10**6
        topic = drawn.randrange(len(topics))
        messages.append((topic, _message(drawn, topics[topic][1]), time))
    records = [(name, content) for name, content in RECORDS.items() if drawn.random() < 0.3]
    return Content([topic for topic, _ in topics], messages, records)


def _message(drawn: random.Random, valid: bytes) -> bytes:
    data = b"\0\1\0\0" + valid
    if drawn.random() < 0.1:
        data = damaged(drawn, data + bytes(drawn.choice([0, 1, 8, 100, 5000])))
    return data


@functools.cache
def drill_bag(number: int) -> tuple[list[TopicSummary], list[Message], dict[str, str]]:
    """Return topics, messages and manifest of a drill's bag without damage."""
    scenario = parse_scenario({"seed": 1, "faults": FAULTS}, "scenario")
    beginning = Beginning(to_settings(DRILLS[number]), 0.2, 1, scenario)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "bag")
        write_offline_bag(path, Plan(beginning), 0.25)
        with rpud_sim.bag.open(path) as bag:
            return list(bag.topics), list(bag.messages()), bag.records("rpud_manifest")[0]


def warm_up() -> None:
    """Make what all bags share, and load the kernels of drills."""
    for number in range(len(DRILLS)):
        drill_bag(number)


def _drill_content(drawn: random.Random) -> Content:
    topics, messages, manifest = drill_bag(drawn.randrange(len(DRILLS)))
    names = [each.topic.name for each in topics]
    written = [(names.index(each.topic), each.data, each.log_time) for each in messages]
    for _ in range(drawn.choice([0, 1, 1, 1, 2, 5, 20])):
        number = drawn.randrange(len(names))
        places = [place for place, each in enumerate(written) if each[0] == number]
        if places:
            place = drawn.choice(places)
            written[place : place + 1] = _odd_messages(drawn, *written[place])
    parameters = dict(manifest)
    if drawn.random() < 0.2:
        parameters["manifest"] = _odd_json(drawn, parameters["manifest"])
    records = [("rpud_manifest", parameters)] if drawn.random() < 0.9 else []
    kinds = [
        (each.topic.name, each.topic.type, each.topic.type_hash, each.definition or "")
        for each in topics
    ]
    return Content(kinds, written, records)


def _odd_messages(
    drawn: random.Random, topic: int, data: bytes, time: int
) -> list[tuple[int, bytes, int]]:
    """Return what stands in place of a message: none, two, a later one, or one of other bytes."""
    kind = drawn.randrange(8)
    if kind == 0:
        return []
    if kind == 1:
        return [(topic, data, time)] * 2
    if kind == 2:
        return [(topic, data, hostile.whole(drawn, 64))]
    if kind == 3:
        return [(topic, damaged(drawn, data), time)]
    changed = bytearray(data)
    place = 4 + drawn.randrange(max(1, len(data) - 4)) // 4 * 4
    number = struct.pack("<d", hostile.number(drawn))
    if kind == 4:
        number = hostile.whole(drawn, 64).to_bytes(8, "little")
    if kind == 5:
        number = hostile.whole(drawn, 32).to_bytes(4, "little")
    changed[place : place + len(number)] = number
    return [(topic, bytes(changed[: len(data)]), time)]


def _odd_json(drawn: random.Random, text: str) -> str:
    """Change one value of an object in JSON, or of an object in it, or a word of the text."""
    content = json.loads(text)
    inner = drawn.choice([content, *[each for each in content.values() if isinstance(each, dict)]])
    if not inner or drawn.random() < 0.1:
        return odd_text(drawn, text)
    inner[drawn.choice(list(inner))] = drawn.choice(VALUES)
    return json.dumps(content)


def _write_mcap(drawn: random.Random, file: Path, content: Content, odd: float) -> None:
    """Write a file of which each declaration is odd with a probability."""
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
        for name, kind, type_hash, definition in content.topics:
            text = _maybe(drawn, definition, odd).encode()
            text = damaged(drawn, text) if drawn.random() < odd / 2 else text
            encoding = drawn.choice(["", "ros2idl"]) if drawn.random() < odd / 2 else "ros2msg"
            schema = writer.register_schema(kind, encoding, text)
            offers = _maybe(drawn, OFFER, odd)
            metadata = {"offered_qos_profiles": offers, "topic_type_hash": type_hash}
            coding = "json" if drawn.random() < odd / 3 else "cdr"
            channels.append(writer.register_channel(name, coding, schema, metadata))
        for number, (topic, data, time) in enumerate(content.messages):
            writer.add_message(channels[topic], time, data, time, number)
        for name, texts in content.records:
            writer.add_metadata(
                name, {key: _maybe(drawn, text, odd) for key, text in texts.items()}
            )
        if drawn.random() < odd:
            writer.add_attachment(1, 2, "name", "type", b"data")
        writer.finish()
