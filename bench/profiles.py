"""Where the commands that miss their goals spend their time, by module."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.checkout import work_tree
from bench.profiled import OTHERS
from bench.reading import TOGETHER_CODE, TOPICS
from bench.row import Row, row
from bench.talk import Talk
from bench.telemetry import LOADS, ros
from rpud_sim.bag import BagReader

SECONDS = 120  # of the bag
MOST = 8  # modules of each command that are shown
LEAST = 2.0  # share of a module that is shown [%]
_RPUD = "rpud_sim.cli.main:main"
_LOAD = {**LOADS["largest"], "real_time_factor": 0.5}  # the profiler takes time as well
_RATE = 20_000  # of messages [1/s]
_SECONDS = 6.0  # that the nodes run
_AFTER = 2.0  # the start of a program, when counting begins [s]
_ENDING = 60.0  # [s]

# Runs a command under Python's profiler. What a module calls of compiled code counts as its own.
# Other threads are not profiled; their processor time is one entry.
_PROFILED = """
import cProfile, io, json, pstats, runpy, sys, time
out, program, *words = sys.argv[1:]
sys.argv = [program, *words]
profiler = cProfile.Profile(time.thread_time, builtins=False)
began, began_here = time.process_time(), time.thread_time()
profiler.enable()
try:
    if program == "rpud":
        runpy.run_module("rpud_sim.cli.main", run_name="__main__", alter_sys=True)
    else:
        exec(program)
except SystemExit as end:
    if end.code:
        raise
finally:
    profiler.disable()
others = (time.process_time() - began) - (time.thread_time() - began_here)
found = {"other threads": others}
for (file, _, _), (_, _, own, _, _) in pstats.Stats(profiler).stats.items():
    found[file] = found.get(file, 0.0) + own
with open(out, "w") as stream:
    json.dump(found, stream)
"""


def profiles() -> Iterator[Row]:
    """Profile commands of bags, and the nodes at their largest loads: the share of modules [%]."""
    yield from _commands()
    with tempfile.TemporaryDirectory() as folder:
        yield from _shares(
            f"profile, a drill at {_LOAD['telemetry_rate']} Hz", _drill(Path(folder, "drill.json"))
        )
        yield from _shares(f"profile, record of {_RATE:,} messages/s", _record(Path(folder)))
        yield from _shares(f"profile, replay of {_RATE:,} messages/s", _replay(Path(folder)))


def _commands() -> Iterator[Row]:
    with work_tree() as version, tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, "bag")
        commands: dict[str, Sequence[str | Path]] = {
            "simulate --bag": ("rpud", "simulate", "--duration", str(SECONDS), "--bag", bag),
            "verify": ("rpud", "verify", bag),
            "export": (
                "rpud",
                "export",
                bag,
                "--format",
                "parquet",
                "--out",
                Path(folder, "tables"),
            ),
            "arrays": (TOGETHER_CODE, bag, *TOPICS),
        }
        for name, words in commands.items():
            kept = Path(folder, "profile.json")
            version.run(["python", "-c", _PROFILED, kept, *words])
            yield from _shares(f"profile, {name} of {SECONDS} s", json.loads(kept.read_text()))


def _profiled(file: Path, entry: str, *arguments: str | Path) -> list[str]:
    """Return the words of a command that runs under the profiler."""
    words = ("-m", "bench.profiled", file, _AFTER, entry, *arguments)
    return [sys.executable, *map(str, words)]


def _drill(file: Path) -> dict[str, float]:
    """Run the drill at its largest load beside one listener."""
    with ros(), Talk(_profiled(file, "rpud_sim.cli.executables:drill_node"), _LOAD) as talk:
        talk.settle()
        talk.measure(_SECONDS)
    return _read(file)


def _record(folder: Path) -> dict[str, float]:
    """Record messages of 100 bytes from one publisher."""
    file, topic = folder / "record.json", f"/bench_{os.getpid()}/record"
    rates = ("--size", "100", "--rate", str(_RATE), "--seconds", str(_SECONDS))
    words = _profiled(file, _RPUD, "record", topic, "--out", folder / "recorded")
    with open(os.devnull, "w") as nowhere:
        recorder = subprocess.Popen(words, stdout=nowhere, stderr=nowhere)
        try:
            talker = (sys.executable, "-m", "bench.byte_talker", topic, *rates)
            subprocess.run(talker, stdout=nowhere, check=True)
        finally:
            recorder.send_signal(signal.SIGINT)
            recorder.wait(_ENDING)
    return _read(file)


def _replay(folder: Path) -> dict[str, float]:
    """Replay the drill's mix to one listener that takes bytes."""
    file, bag = folder / "replay.json", folder / "bag"
    words = (sys.executable, "-m", "rpud_sim.cli.main", "simulate", "--bag", str(bag))
    with open(os.devnull, "w") as nowhere:
        subprocess.run(
            (*words, "--duration", str(SECONDS)), stdout=nowhere, stderr=nowhere, check=True
        )
        with BagReader(bag) as reader:
            factor = _RATE * reader.duration / 1e9 / reader.message_count
        listener = subprocess.Popen(
            (sys.executable, "-m", "bench.replay_listener", str(bag), str(folder / "heard.json"))
        )
        try:
            options = ("--wait-for-subscribers",)
            replay = _profiled(file, _RPUD, "replay", bag, "--rate", str(factor), *options)
            subprocess.run(replay, stdout=nowhere, check=True)
        finally:
            listener.send_signal(signal.SIGINT)
            listener.wait(_ENDING)
    return _read(file)


def _read(file: Path) -> dict[str, float]:
    found: dict[str, float] = json.loads(file.read_text())
    return found


def _shares(name: str, seconds: dict[str, float]) -> Iterator[Row]:
    """Yield the largest shares of modules, and the rest."""
    shares: dict[str, float] = {}
    for file, spent in seconds.items():
        place = _place(file)
        shares[place] = shares.get(place, 0.0) + 100.0 * spent / sum(seconds.values())
    ordered = sorted(shares, key=lambda place: -shares[place])
    shown = [place for place in ordered[:MOST] if shares[place] >= LEAST]
    for place in shown:
        yield row(f"{name}: {place}", [shares[place]], "%")
    yield row(f"{name}: all else", [100.0 - sum(shares[place] for place in shown)], "%")


def _place(file: str) -> str:
    """Return what a table calls a file: our module, or the package that it is of."""
    parts = Path(file).parts
    if "site-packages" in parts:
        return parts[parts.index("site-packages") + 1]
    if "rpud_sim" in parts:
        last = len(parts) - 1 - parts[::-1].index("rpud_sim")
        return "/".join(parts[last + 1 :])
    return file if file == OTHERS else "Python"


if __name__ == "__main__":
    for each in profiles():
        print(f"{each.name}: {each.median:.1f} {each.unit}", file=sys.stdout)
