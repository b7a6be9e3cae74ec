"""Campaign of hostile bags against the commands that read them, in workers with limits."""

from __future__ import annotations

import contextlib
import dataclasses
import faulthandler
import io
import itertools
import multiprocessing
import random
import resource
import shutil
import signal
import tempfile
import time
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from rpud_sim.cli.main import execute, load_command
from tools.fuzz.bag_inputs import draw_bag, warm_up
from tools.fuzz.tally import Outcome

CPU = 10  # seconds that a command may take
PATIENCE = 120  # seconds after which a command that waits is ended, and its stack printed
MEMORY = 2**30  # bytes that a command may have resident
LONGEST_LINE = 2000
EXPECTATIONS = Path(__file__).resolve().parents[2] / "config" / "expectations.yaml"


@dataclasses.dataclass(frozen=True)
class Way:
    """Reader of bags: a command with its further words, or one that is no command."""

    share: int  # of the bags, before division by the sum
    words: Callable[[random.Random, Path], list[str]] | None = None  # by the path of a result
    of_drills: float = 0.2  # share of the bags that are a drill's


WAYS = {
    "info": Way(4, lambda drawn, out: drawn.choice([[], ["--json"]])),
    "recover": Way(6, lambda drawn, out: ["--out", str(out)]),
    "export": Way(
        5,
        lambda drawn, out: [
            *("--out", str(out), "--format", drawn.choice(("parquet", "csv"))),
            *drawn.choice([[], [], [], ["--rate", "20000"]]),
        ],
    ),
    "report": Way(2, lambda drawn, out: ["--out", f"{out}.html"]),
    "arrays": Way(4),
    "verify": Way(6, lambda drawn, out: drawn.choice([[], ["--strict"], ["--json"]]), 0.9),
    "compare": Way(
        3,
        lambda drawn, out: [
            *(str(draw_bag(drawn, out.with_name("other"), 0.9)), "--from", "0"),
            *drawn.choice([["--json"], ["--out", f"{out}.html"], ["--tolerance", "5"]]),
        ],
        0.9,
    ),
    "fork": Way(
        5,
        lambda drawn, out: [
            *("--at", drawn.choice(["0", "0.01", "0.2", "1e9"]), "--out", str(out)),
            *drawn.choice([[], ["--duration", "0.02"], ["--set", "gravity=1.62"]]),
        ],
        0.9,
    ),
    "test": Way(
        3,
        lambda drawn, out: [
            *("--expect", str(EXPECTATIONS), *drawn.choice([["--json"], ["--junit", f"{out}.xml"]]))
        ],
        0.9,
    ),
}


class HarmError(Exception):
    """Error of a command that breaks its contract."""


def run(
    inputs: int, seed: int, workers: int = 1, progress: Callable[[], object] = lambda: None
) -> Outcome:
    """Run a campaign; each bag depends on the seed and its own number, and can be repeated."""
    outcome = Outcome(WAYS)
    for way, how in WAYS.items():
        if how.words is not None:
            load_command(way)
    warm_up()
    context = multiprocessing.get_context("fork")
    numbers = iter(range(inputs))
    running: dict[Any, tuple[int, Any]] = {}
    with tempfile.TemporaryDirectory() as folder:
        while True:
            for number in itertools.islice(numbers, workers - len(running)):
                pipe, child = context.Pipe()
                arguments = (child, seed, number, Path(folder, str(number)))
                process = context.Process(target=_send_result, args=arguments, daemon=True)
                process.start()
                child.close()
                running[pipe] = number, process
            if not running:
                return outcome
            for pipe in wait(list(running)):
                number, process = running.pop(pipe)
                try:
                    way, refused, cpu, memory, harms = pipe.recv()
                except EOFError:
                    process.join()
                    way, refused, cpu, memory = _way_of(seed, number), False, 0.0, 0
                    harms = [f"ended by {_name(process.exitcode)}"]
                process.join()
                outcome.tallies[way].add(refused, cpu, memory)
                outcome.harms += [f"bag {number} of seed {seed}, {way}: {harm}" for harm in harms]
                progress()


def _name(code: int | None) -> str:
    return signal.Signals(-code).name if code and code < 0 else f"exit {code}"


def _send_result(pipe: Connection, seed: int, number: int, folder: Path) -> None:
    folder.mkdir()
    pipe.send(attack(seed, number, folder))
    shutil.rmtree(folder)


def _way_of(seed: int, number: int) -> str:
    return drawn_way(random.Random(f"{seed}:{number}"))


def drawn_way(drawn: random.Random) -> str:
    """Draw the reader of a bag, before anything else is drawn."""
    return drawn.choices(list(WAYS), [way.share for way in WAYS.values()])[0]


def attack(seed: int, number: int, folder: Path) -> tuple[str, bool, float, int, list[str]]:
    """Read one bag; return reader, whether it rejected it, CPU [s], memory [byte], and harms."""
    drawn = random.Random(f"{seed}:{number}")
    way = drawn_way(drawn)
    bag = draw_bag(drawn, folder / "bag", WAYS[way].of_drills)
    Path("/proc/self/clear_refs").write_text("5")  # the peak of memory begins here
    held = _peak()  # by the process that forked this one, too
    began = time.process_time()
    resource.setrlimit(resource.RLIMIT_CPU, (CPU + 2, resource.RLIM_INFINITY))  # SIGXCPU ends it
    harms, refused = [], False
    faulthandler.dump_traceback_later(PATIENCE, exit=True)
    try:
        refused = _arrays(bag) if way == "arrays" else _command(way, bag, folder, drawn)
    except HarmError as harm:
        harms.append(str(harm))
    except Exception:
        harms.append("".join(traceback.format_exc().splitlines(keepends=True)[-6:]))
    finally:
        faulthandler.cancel_dump_traceback_later()
    cpu = time.process_time() - began
    memory = _peak() - held
    if cpu > CPU:
        harms.append(f"took {cpu:.1f} s")
    if memory > MEMORY:
        harms.append(f"took {memory / 1e6:.0f} MB")
    return way, refused, cpu, memory, harms


def _command(way: str, bag: Path, folder: Path, drawn: random.Random) -> bool:
    out = folder / "out"
    words = WAYS[way].words
    assert words is not None
    refused, code = _called(way, bag, *words(drawn, out))
    if refused and list(folder.glob("out*")):
        raise HarmError("it was refused, and left something behind")
    if way == "recover" and code != 1:
        _check_recovered(out, folder)
    return refused


def _called(way: str, bag: Path, *words: str) -> tuple[bool, int]:
    """Call a command within its own handlers; return whether it rejects the bag, and its code."""
    with _captured() as (out, errors):
        code = execute([way, str(bag), *words])
    output = errors.getvalue()
    # Expectations that do not fit the types in a bag are a wrong call.
    if code not in (0, 1, 2 if way == "test" else 1, 3):
        raise HarmError(f"exit code {code}: {output}")
    # What gives an account has read the bag: then 1 says that something is undecided.
    refused = code in (1, 2) and not out.getvalue()
    if refused:
        _check_line(output.removesuffix("\n"))
    elif "Warning" in output or "Traceback" in output:
        raise HarmError(output)
    return refused, int(code)


def _check_line(output: str) -> None:
    if not output.strip() or len(output.splitlines()) > 1 or len(output) > LONGEST_LINE:
        raise HarmError(f"the error is not one line: {output[:500]!r}")


def _check_recovered(path: Path, folder: Path) -> None:
    """List and export a recovered bag, and read it with another library."""
    from mcap.reader import make_reader

    with _captured() as (_, errors):
        code = execute(["info", str(path)])
    if code:
        raise HarmError(f"it was recovered to what cannot be listed: {errors.getvalue()}")
    _called("export", path, "--out", str(folder / "tables"))
    for file in path.glob("*.mcap"):
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            deque(reader.iter_messages(), 0)
            deque(reader.iter_metadata(), 0)


def _arrays(path: Path) -> bool:
    import rpud_sim.bag

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


@contextlib.contextmanager
def _captured() -> Iterator[tuple[io.StringIO, Any]]:
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        yield out, errors


def _peak() -> int:
    """Return the greatest memory of this process since the last reset [byte]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) * 1024
    raise RuntimeError("no VmHWM")
