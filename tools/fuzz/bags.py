"""Hostile bags for all commands that read bags: a drill's, changed, rewritten and damaged.

A command reads a bag, or rejects it in one line and leaves nothing behind, within limits of time
and memory. Each has a process of its own.
"""

from __future__ import annotations

import contextlib
import faulthandler
import functools
import gc
import io
import multiprocessing
import os
import pickle
import random
import resource
import struct
import tempfile
import time
import traceback
import warnings
from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.records import Channel, Schema
from mcap.writer import CompressionType, Writer

import rpud_sim.bag
from rpud_sim.cli.main import execute, load_command
from rpud_sim.recorded.offline_bag import write_offline_bag
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.scenario_file import parse_scenario
from tools.fuzz import Outcome
from tools.fuzz.hostile import damaged, number, odd_text, whole

CPU = 10  # processor time that a command may take [s]
# After which a command that waits is ended, and its stack printed; beside other work it may get a
# sixtieth of a processor [s].
PATIENCE = 600
MEMORY = 1024.0  # that a command may have resident [MB]
LONGEST_LINE = 2000
_WARNING = ", so the whole file was read to open it"  # of a bag, before what may be an error
_EXPECT = f"--expect {Path(__file__).resolve().parents[2]}/config/expectations.yaml"
WAYS = {  # share of the bags, how odd their texts are, and options to choose from
    "info": (4, 0.1, "", "--json"),
    "recover": (6, 0.1, "--out {out}"),
    "export": (
        *(5, 0.1, "--out {out}", "--out {out} --format parquet", "--out {out} --format csv"),
        "--out {out} --format csv --rate 20000",
    ),
    "report": (2, 0.1, "--out {out}.html"),
    "arrays": (4, 0.1, ""),
    "verify": (6, 0.01, "", "--strict", "--json"),
    "compare": (
        *(3, 0.01, "{other} --from 0 --json", "{other} --from 0 --tolerance 5"),
        "{other} --from 0 --out {out}.html",
    ),
    "fork": (
        *(5, 0.01, "--at 0 --out {out}", "--at 0.01 --out {out} --duration 0.02"),
        *("--at 0.2 --out {out} --set gravity=1.62", "--at 1e9 --out {out}"),
    ),
    "test": (3, 0.01, f"{_EXPECT} --json", f"{_EXPECT} --junit {{out}}.xml"),
}
DRILLS: tuple[dict[str, Any], ...] = (
    {"telemetry_rate": 40, "sample_rate": 1000, "block_duration": 0.1},
    {"telemetry_rate": 20, "sample_rate": 1000, "feed_model": "arm", "initial_feed": 0.005}
    | {"rotation_model": "friction_drive", "strata": "sandstone"},
)
FAULTS = [
    {"kind": "lost_preload", "onset": 0.03, "duration": 0.02},
    {"kind": "noise", "channel": "wrench", "onset": 0.04},
]
# Foreign definitions, whose messages do not fit.
DEFINITIONS = (
    f"B part\nB[] parts\nB[2] two\n{'=' * 80}\nMSG: a_msgs/B\nfloat64 x\nstring name\n",
    "string[] names\nwstring wide\nuint8[<=4] few\nfloat64[<=3] log_time\nint16[3] three\n",
    "\n",
)
Row = tuple[Schema, Channel, bytes, int]  # of a message; the last ones are its data and time [ns]


@functools.cache
def drill_bag(drill: int) -> tuple[list[Row], dict[str, dict[str, str]], str]:
    """Return messages, records and metadata.yaml of a drill's bag without damage."""
    scenario = parse_scenario({"seed": 1, "faults": FAULTS}, "scenario")
    beginning = Beginning(to_settings(DRILLS[drill]), 0.2, 1, scenario)
    with tempfile.TemporaryDirectory() as folder:
        write_offline_bag(path := Path(folder, "bag"), Plan(beginning), 0.25)
        (file,) = path.glob("*.mcap")
        with file.open("rb") as stream:
            reader = make_reader(stream)
            rows = [(*about, each.data, each.log_time) for *about, each in reader.iter_messages()]
            records = {each.name: each.metadata for each in reader.iter_metadata()}
        return rows, records, (path / "metadata.yaml").read_text().replace(file.name, "bag.mcap")


def _changed(drawn: random.Random, row: Row) -> list[Row]:
    """Return what takes the place of a message: none, two, or another one."""
    *about, data, moment = row
    at, bits = 4 + drawn.randrange(max(1, len(data) - 4)) // 4 * 4, drawn.choice([32, 64])
    value = whole(drawn, bits).to_bytes(bits // 8, "little")
    value = drawn.choice([struct.pack("<d", number(drawn)), value])
    other = (data[:at] + value + data[at + len(value) :])[: len(data)]
    moved = [(*about, data, whole(drawn, 64))]
    broken = [(*about, damaged(drawn, data), moment)]
    return drawn.choice([[], [row, row], moved, broken, *[[(*about, other, moment)]] * 4])


def draw_bag(drawn: random.Random, folder: Path, odd: float) -> Path:
    """Write a bag, with or without metadata.yaml, into a new folder and return its path."""
    folder.mkdir()
    rows, records, metadata = drill_bag(drawn.randrange(len(DRILLS)))
    parts = [[row] for row in rows]
    for _ in range(drawn.choice([0, 1, 1, 1, 2, 5, 20])):
        topic = drawn.choice(rows)[1].id
        place = drawn.choice([n for n, row in enumerate(rows) if row[1].id == topic])
        parts[place] = _changed(drawn, rows[place])

    def maybe(text: str) -> str:
        return odd_text(drawn, text) if drawn.random() < odd else text

    with (file := folder / "bag.mcap").open("wb") as stream:
        writer = Writer(
            stream,
            chunk_size=drawn.choice([50, 500, 100_000]),
            compression=drawn.choice(list(CompressionType)),
            use_chunking=drawn.random() < 0.8,
            enable_crcs=drawn.random() < 0.3,  # damage is found by them
        )
        writer.start("ros2", "fuzz")
        channels = dict[int, int]()
        for schema, channel, data, moment in (row for part in parts for row in part):
            if channel.id not in channels:
                text = drawn.choice(DEFINITIONS) if drawn.random() < odd else schema.data.decode()
                encoding = schema.encoding if drawn.random() > odd / 2 else "ros2idl"
                known = writer.register_schema(maybe(schema.name), encoding, maybe(text).encode())
                about = {key: maybe(value) for key, value in channel.metadata.items()}
                coding = channel.message_encoding if drawn.random() > odd / 3 else "json"
                name = maybe(channel.topic)
                channels[channel.id] = writer.register_channel(name, coding, known, about)
            writer.add_message(channels[channel.id], moment, data, moment)
        for name, texts in records.items():
            writer.add_metadata(name, {key: maybe(text) for key, text in texts.items()})
        writer.finish()
    if drawn.random() < 4 * odd + 0.06:
        file.write_bytes(damaged(drawn, file.read_bytes()))
    if drawn.random() < 1.0 - 3 * odd:
        return file
    metadata = odd_text(drawn, metadata) if drawn.random() < 0.3 else metadata
    (folder / "metadata.yaml").write_bytes(metadata.encode())
    return folder


def run(numbers: Iterable[int], seed: int) -> Iterator[Outcome]:
    """Have bags read, each drawn from the seed and its number."""
    for way in WAYS.keys() - {"arrays"}:
        load_command(way)
    for drill in range(len(DRILLS)):  # what all bags share, with the kernels of drills
        drill_bag(drill)
    _import_all()
    with multiprocessing.get_context("fork").Pool() as pool:
        yield from pool.imap_unordered(functools.partial(_outcome, seed), numbers)


def _import_all() -> None:
    """Read sound bags in each way: each process would import by itself what a command needs."""
    for way, (_, _, *options) in WAYS.items():
        for words in options if way != "arrays" else ():
            with tempfile.TemporaryDirectory() as folder:
                bag = draw_bag(random.Random(0), Path(folder, "bag"), 0.0)
                _called(way, bag, *words.format(out=Path(folder, "out"), other=bag).split())
    gc.freeze()


def _outcome(seed: int, input_number: int) -> Outcome:
    """Have one bag read by a process of its own."""
    drawn = random.Random(f"{seed}:{input_number}")
    way = drawn.choices(list(WAYS), [each[0] for each in WAYS.values()])[0]
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder, "result")
        if (child := os.fork()) == 0:
            with contextlib.suppress(BaseException):
                result.write_bytes(pickle.dumps(_read(drawn, Path(folder), way)))
                os._exit(0)
            os._exit(1)
        if code := os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]):
            return Outcome(input_number, way, False, 0.0, [f"ended by {code}"])
        return Outcome(input_number, way, *pickle.loads(result.read_bytes()))


def _read(drawn: random.Random, folder: Path, way: str) -> tuple[bool, float, list[str], float]:
    """Read a bag; return whether it was rejected, time [s], harms and memory [MB]."""
    _, odd, *options = WAYS[way]
    bag, other, out = draw_bag(drawn, folder / "bag", odd), "", folder / "out"
    if way == "compare":
        other = draw_bag(drawn, folder / "other", odd)
    words = drawn.choice(options).format(out=out, other=other).split()
    Path("/proc/self/clear_refs").write_text("5")  # the peak of memory begins here
    held, began, harms, refused = _peak(), time.process_time(), [], False
    resource.setrlimit(resource.RLIMIT_CPU, (CPU + 2, resource.RLIM_INFINITY))  # by SIGXCPU
    faulthandler.dump_traceback_later(PATIENCE, exit=True)
    try:
        refused = _arrays(bag) if way == "arrays" else _called(way, bag, *words)
        left = refused and list(folder.glob("out*"))
        assert not left, "it was refused, and left something behind"
        if way == "recover" and out.exists():
            _check_recovered(out)
    except Exception:
        harms.append("".join(traceback.format_exc().splitlines(keepends=True)[-6:]))
    spent, memory = time.process_time() - began, _peak() - held
    harms += [f"took {spent:.1f} s"] if spent > CPU else []
    harms += [f"took {memory:.0f} MB"] if memory > MEMORY else []
    return refused, spent, harms, memory


def _called(way: str, bag: Path, *words: str) -> bool:
    """Call a command within its own handlers; return whether it rejects the bag."""
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        code = execute([way, str(bag), *words])
    text = errors.getvalue()
    # Expectations that do not fit a bag's types are a wrong call, as no --namespace of its drills.
    usage = 2 if way in ("test", "fork", "compare") else 1
    assert code in (0, 1, usage, 3), f"exit code {code}: {text}"
    # What gives an account has read the bag: then 1 says that something is undecided.
    refused = code in (1, 2) and not out.getvalue()
    if refused:
        _check_line(text)
    assert "Warning" not in text or refused, text
    assert "Traceback" not in text, text
    return refused


def _check_line(text: str) -> None:
    lines = [each for each in text.splitlines() if not each.endswith(_WARNING)]
    one = len(lines) == 1 and text.strip() and len(text) <= LONGEST_LINE
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
    """Read each topic as arrays; return whether one was rejected."""
    refused = []

    @contextlib.contextmanager
    def rejecting() -> Iterator[None]:
        try:
            yield
        except rpud_sim.bag.BagError as error:
            refused.append(_check_line(str(error)))

    with warnings.catch_warnings(), rejecting(), rpud_sim.bag.open(path) as bag:
        warnings.simplefilter("error")
        for summary in bag.topics:
            with rejecting():
                bag.arrays(summary.topic.name)
    return bool(refused)


def _peak() -> float:
    """Return the greatest memory of this process since the last reset [MB]."""
    return int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) / 1e3
