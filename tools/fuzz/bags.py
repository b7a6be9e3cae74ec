"""Hostile bags for all commands that read bags: well-formed files with odd content, then damaged.

A command reads a bag, or rejects it in one line and leaves nothing behind, within limits of time
and memory. Each has a process of its own.
"""

from __future__ import annotations

import contextlib
import faulthandler
import functools
import io
import itertools
import json
import multiprocessing
import random
import resource
import struct
import tempfile
import time
import traceback
import warnings
from collections import deque
from collections.abc import Iterable
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

import rpud_sim.bag
from rpud_sim.cli.main import execute, load_command
from rpud_sim.recorded.offline_bag import write_offline_bag
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.scenario_file import parse_scenario
from tools.fuzz import Outcome, hostile
from tools.fuzz.hostile import damaged, odd_text

CPU = 10  # processor time that a command may take [s]
PATIENCE = 120  # after which a command that waits is ended, and its stack printed [s]
MEMORY = 1024.0  # that a command may have resident [MB]
LONGEST_LINE = 2000
ROOT = Path(__file__).resolve().parents[2]
WAYS = {  # share of the bags, how many of them are a drill's, and options to choose from
    "info": (4, 0.2, "", "--json"),
    "recover": (6, 0.2, "--out {out}"),
    "export": (
        *(5, 0.2, "--out {out} --format parquet", "--out {out} --format csv"),
        *("--out {out}", "--out {out} --format csv --rate 20000"),
    ),
    "report": (2, 0.2, "--out {out}.html"),
    "arrays": (4, 0.2, ""),
    "verify": (6, 0.9, "", "--strict", "--json"),
    "compare": (
        *(3, 0.9, "{other} --from 0 --json", "{other} --from 0 --tolerance 5"),
        "{other} --from 0 --out {out}.html",
    ),
    "fork": (
        *(5, 0.9, "--at 0 --out {out}", "--at 0.01 --out {out} --duration 0.02"),
        *("--at 0.2 --out {out} --set gravity=1.62", "--at 1e9 --out {out}"),
    ),
    "test": (
        *(3, 0.9, f"--expect {ROOT}/config/expectations.yaml --json"),
        f"--expect {ROOT}/config/expectations.yaml --junit {{out}}.xml",
    ),
}
_B = f"{'=' * 80}\nMSG: a_msgs/B\nfloat64 x\nstring name\n"
_TIME = f"{'=' * 80}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_HEADER = f"{'=' * 80}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring id\n{_TIME}"
_EMPTY = b"\1\0\0\0\0"  # a text
DEFINITIONS = {  # with the data of a message
    "string data\n": _EMPTY,
    "float64 x # [m]\nuint8[] data\nint16[3] three\nbool good\n": bytes(19),
    f"B part\nB[] parts\nB[2] two\n{_B}": (
        bytes(8) + _EMPTY + bytes(19) + _EMPTY + bytes(11) + _EMPTY
    ),
    f"std_msgs/Header header\nuint64 sequence\nfloat32[] values # [N]\n{_HEADER}": (
        bytes(8) + _EMPTY + bytes(15)
    ),
    "string[] names\nstring wide\nuint8[<=4] few\nfloat64[<=3] log_time\n": (
        bytes(4) + _EMPTY + bytes(11)
    ),
    f"B[] parts\n{'=' * 80}\nMSG: a_msgs/B\nint8 X=1\n": bytes(4),
    f"builtin_interfaces/Time time\nbuiltin_interfaces/Time[] times\n{_TIME}": bytes(12),
    "wstring wide\n": bytes(4),
    "\n": b"\0",
}
TYPES = (*["a_msgs/msg/A"] * 7, "rpud_msgs/msg/Waveform", "rpud_msgs/msg/Impact", "a", "")
TOPICS = ("/a", "/rpud/contact_force", "/b/c", "no name", "/\u00e9\n\x1b[1m<b>", "../../x", "")
RECORDS = {
    "rpud_losses": {"/a": '{"transport": 1, "queue": null}'},
    "rpud_recording": {"max_loss": "1.0"},
    "rpud_manifest": {"manifest": '{"drill": {"parameters": {}}, "version": "0.1.0"}'},
    "rosbag2": {"serialized_metadata": "custom_data: {a: b}\n"},
}
WORDS = (".inf", "-1", "1e400", "9" * 80, "!!timestamp 1", "[1]", "{a: b}", *hostile.WORDS)
VALUES = (None, True, [], {}, [0.0], -1, 10**400, 2**63, *hostile.NUMBERS, *hostile.WORDS)
DRILLS: tuple[dict[str, Any], ...] = (
    {"telemetry_rate": 40, "sample_rate": 1000, "block_duration": 0.1},
    {"telemetry_rate": 20, "sample_rate": 1000, "feed_model": "arm", "initial_feed": 0.005}
    | {"rotation_model": "friction_drive", "strata": "sandstone"},
)
FAULTS = [
    {"kind": "lost_preload", "onset": 0.03, "duration": 0.02},
    {"kind": "noise", "channel": "wrench", "onset": 0.04},
]
Content = tuple[list[tuple[str, str, str, str, str]], list[tuple[int, bytes, int]], dict[str, Any]]
"""Topics (name, type, hash, definition, offer), messages (topic, data, time) and records."""


@functools.cache
def drill_bag(number: int) -> tuple[Content, str]:
    """Return the content of a drill's bag without damage, and its metadata.yaml."""
    scenario = parse_scenario({"seed": 1, "faults": FAULTS}, "scenario")
    beginning = Beginning(to_settings(DRILLS[number]), 0.2, 1, scenario)
    topics, messages = dict[str, tuple[str, str, str, str, str]](), []
    with tempfile.TemporaryDirectory() as folder:
        write_offline_bag(path := Path(folder, "bag"), Plan(beginning), 0.25)
        (file,) = path.glob("*.mcap")
        with file.open("rb") as stream:
            reader = make_reader(stream)
            for schema, channel, each in reader.iter_messages():
                about = channel.metadata["topic_type_hash"], schema.data.decode()
                offer = channel.metadata["offered_qos_profiles"]
                topics.setdefault(channel.topic, (channel.topic, schema.name, *about, offer))
                messages.append((list(topics).index(channel.topic), each.data, each.log_time))
            records = {each.name: each.metadata for each in reader.iter_metadata()}
        metadata = (path / "metadata.yaml").read_text().replace(file.name, "bag.mcap")
    return (list(topics.values()), messages, records), metadata


def _small(drawn: random.Random) -> Content:
    """Draw a few topics with definitions of each kind."""
    offer = drill_bag(0)[0][0][0][4]
    topics = [
        (drawn.choice(TOPICS), drawn.choice(TYPES), "x", drawn.choice(list(DEFINITIONS)), offer)
        for _ in range(drawn.choice([1, 1, 2, 4]))
    ]
    messages = []
    for number in range(drawn.choice([0, 1, 4, 30])):
        topic = drawn.randrange(len(topics))
        data = b"\0\1\0\0" + DEFINITIONS[topics[topic][3]]
        if drawn.random() < 0.1:
            data = damaged(drawn, data + bytes(drawn.choice([0, 1, 8, 100, 5000])))
        time = hostile.whole(drawn, 64) if drawn.random() < 0.05 else number * 10**6
        messages.append((topic, data, time))
    return topics, messages, {k: v for k, v in RECORDS.items() if drawn.random() < 0.3}


def _of_drill(drawn: random.Random) -> Content:
    """Draw a drill's bag with some messages missing, repeated, moved or changed."""
    topics, messages, records = drill_bag(drawn.randrange(len(DRILLS)))[0]
    messages, records = list(messages), dict(records)
    for _ in range(drawn.choice([0, 1, 1, 1, 2, 5, 20])):
        topic = drawn.randrange(len(topics))
        place = drawn.choice([i for i, each in enumerate(messages) if each[0] == topic] or [0])
        topic, data, time = messages[place]
        at = 4 + drawn.randrange(max(1, len(data) - 4)) // 4 * 4
        new = drawn.choice(
            [
                struct.pack("<d", hostile.number(drawn)),
                hostile.whole(drawn, 64).to_bytes(8, "little"),
                hostile.whole(drawn, 32).to_bytes(4, "little"),
            ]
        )
        changed = (data[:at] + new + data[at + len(new) :])[: len(data)]
        moved = [(topic, data, hostile.whole(drawn, 64))]
        broken = [(topic, damaged(drawn, data), time)]
        kinds = [[], [(topic, data, time)] * 2, moved, broken, *[[(topic, changed, time)]] * 4]
        messages[place : place + 1] = drawn.choice(kinds)
    if drawn.random() < 0.2:
        content = json.loads(records["rpud_manifest"]["manifest"])
        inner = drawn.choice([content, *(v for v in content.values() if isinstance(v, dict) and v)])
        inner[drawn.choice(list(inner))] = drawn.choice(VALUES)
        records["rpud_manifest"] = {"manifest": json.dumps(content)}
    return topics, messages, records if drawn.random() < 0.9 else {}


def draw_bag(drawn: random.Random, folder: Path, of_drills: float) -> Path:
    """Write a bag, with or without metadata.yaml, into a new folder and return its path."""
    folder.mkdir()
    file = folder / "bag.mcap"
    of_drill = drawn.random() < of_drills
    topics, messages, records = _of_drill(drawn) if of_drill else _small(drawn)
    odd = 0.01 if of_drill else 0.1

    def maybe(text: str) -> str:
        return odd_text(drawn, text, WORDS) if drawn.random() < odd else text

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
        for name, kind, type_hash, definition, offer in topics:
            text = maybe(definition).encode()
            text = damaged(drawn, text) if drawn.random() < odd / 2 else text
            encoding = drawn.choice(["", "ros2idl"]) if drawn.random() < odd / 2 else "ros2msg"
            metadata = {"offered_qos_profiles": maybe(offer), "topic_type_hash": type_hash}
            coding = "json" if drawn.random() < odd / 3 else "cdr"
            schema = writer.register_schema(kind, encoding, text)
            channels.append(writer.register_channel(name, coding, schema, metadata))
        for number, (topic, data, time) in enumerate(messages):
            writer.add_message(channels[topic], time, data, time, number)
        for name, texts in records.items():
            writer.add_metadata(name, {key: maybe(text) for key, text in texts.items()})
        if drawn.random() < odd:
            writer.add_attachment(1, 2, "name", "type", b"data")
        writer.finish()
    if drawn.random() < (0.1 if of_drill else 0.4):
        file.write_bytes(damaged(drawn, file.read_bytes()))
    if of_drill or drawn.random() < 0.7:
        return file
    text = drill_bag(0)[1]
    text = odd_text(drawn, text, WORDS) if drawn.random() < 0.3 else text
    (folder / "metadata.yaml").write_bytes(text.encode())
    return folder


def run(numbers: Iterable[int], seed: int, workers: int = 1) -> Outcome:
    """Have bags read, each drawn from the seed and its number."""
    outcome, context = Outcome(), multiprocessing.get_context("fork")
    for way in WAYS.keys() - {"arrays"}:
        load_command(way)
    for number in range(len(DRILLS)):  # what all bags share, with the kernels of drills
        drill_bag(number)
    left, running = iter(numbers), dict[Any, tuple[int, Any]]()
    while True:
        for number in itertools.islice(left, workers - len(running)):
            pipe, child = context.Pipe()
            process = context.Process(target=_send_result, args=(child, seed, number), daemon=True)
            process.start()
            child.close()
            running[pipe] = number, process
        if not running:
            return outcome
        for pipe in wait(list(running)):
            number, process = running.pop(pipe)
            way, result, harms = _draw(seed, number)[1], [False, 0.0], list[str]()
            with contextlib.suppress(EOFError):
                *result, harms = pipe.recv()
            process.join()
            harms += [f"ended by {process.exitcode}"] if process.exitcode else []
            outcome.add(way, *result)
            outcome.harms += [f"bag {number} of seed {seed}, {way}: {harm}" for harm in harms]


def _draw(seed: int, number: int) -> tuple[random.Random, str]:
    drawn = random.Random(f"{seed}:{number}")
    return drawn, drawn.choices(list(WAYS), [each[0] for each in WAYS.values()])[0]


def _send_result(pipe: Any, seed: int, number: int) -> None:
    """Read one bag; send whether it was rejected, time [s], memory [MB] and harms."""
    drawn, way = _draw(seed, number)
    with tempfile.TemporaryDirectory() as name:
        _, of_drills, *options = WAYS[way]
        bag, out, other = draw_bag(drawn, Path(name, "bag"), of_drills), Path(name, "out"), ""
        if way == "compare":
            other = draw_bag(drawn, Path(name, "other"), of_drills)
        words = drawn.choice(options).format(out=out, other=other).split()
        Path("/proc/self/clear_refs").write_text("5")  # the peak of memory begins here
        held, began = _peak(), time.process_time()
        resource.setrlimit(resource.RLIMIT_CPU, (CPU + 2, resource.RLIM_INFINITY))  # by SIGXCPU
        faulthandler.dump_traceback_later(PATIENCE, exit=True)
        harms, refused = [], False
        try:
            if way == "arrays":
                refused = _arrays(bag)
            else:
                refused = _called(way, bag, *words)
                left = refused and list(out.parent.glob("out*"))
                assert not left, "it was refused, and left something behind"
                if way == "recover" and out.exists():
                    _check_recovered(out)
        except Exception:
            harms.append("".join(traceback.format_exc().splitlines(keepends=True)[-6:]))
        faulthandler.cancel_dump_traceback_later()
        spent, memory = time.process_time() - began, _peak() - held
        harms += [f"took {spent:.1f} s"] if spent > CPU else []
        harms += [f"took {memory:.0f} MB"] if memory > MEMORY else []
        pipe.send((refused, spent, memory, harms))


def _called(way: str, bag: Path, *words: str) -> bool:
    """Call a command within its own handlers; return whether it rejects the bag."""
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        code = execute([way, str(bag), *words])
    text = errors.getvalue()
    # Expectations that do not fit the types in a bag are a wrong call.
    assert code in (0, 1, 2 if way == "test" else 1, 3), f"exit code {code}: {text}"
    # What gives an account has read the bag: then 1 says that something is undecided.
    refused = code in (1, 2) and not out.getvalue()
    if refused:
        _check_line(text)
    assert "Warning" not in text or refused, text
    assert "Traceback" not in text, text
    return refused


def _check_line(text: str) -> None:
    one = text.strip() and len(text.splitlines()) == 1 and len(text) <= LONGEST_LINE
    assert one, f"the error is not one line: {text[:500]!r}"


def _check_recovered(path: Path) -> None:
    """List and export a recovered bag, and read it with another library."""
    assert not _called("info", path), "it was recovered to what cannot be listed"
    _called("export", path, "--out", str(path.with_name("tables")))
    for file in path.glob("*.mcap"):
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            deque(reader.iter_messages(), 0)
            deque(reader.iter_metadata(), 0)


def _arrays(path: Path) -> bool:
    refused = False
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            with rpud_sim.bag.open(path) as bag:
                for summary in bag.topics:
                    try:
                        bag.arrays(summary.topic.name)
                    except rpud_sim.bag.BagError as error:
                        refused = True
                        _check_line(str(error))
        except rpud_sim.bag.BagError as error:
            refused = True
            _check_line(str(error))
    return refused


def _peak() -> float:
    """Return the greatest memory of this process since the last reset [MB]."""
    return int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) / 1e3
