"""Where the commands that miss their goals spend their time, by module."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.checkout import work_tree
from bench.row import Row, row

SECONDS = 120  # of the bag
MOST = 8  # modules of each command that are shown
LEAST = 2.0  # share of a module that is shown [%]

# Runs a command under Python's profiler. What a module calls of compiled code counts as its own.
# Other threads are not profiled; their processor time is one entry.
_PROFILED = """
import cProfile, io, json, pstats, runpy, sys, time
out, *sys.argv = sys.argv[1:]
profiler = cProfile.Profile(time.thread_time, builtins=False)
began, began_here = time.process_time(), time.thread_time()
profiler.enable()
try:
    runpy.run_module("rpud_sim.cli.main", run_name="__main__", alter_sys=True)
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
    """Profile writing, proving and exporting a bag: the share of each module [%]."""
    with work_tree() as version, tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, "bag")
        commands: dict[str, Sequence[str | Path]] = {
            "simulate --bag": ("simulate", "--duration", str(SECONDS), "--bag", bag),
            "verify": ("verify", bag),
            "export": ("export", bag, "--format", "parquet", "--out", Path(folder, "tables")),
        }
        for name, words in commands.items():
            kept = Path(folder, "profile.json")
            version.run(["python", "-c", _PROFILED, kept, "rpud", *words])
            yield from _shares(f"profile, {name} of {SECONDS} s", json.loads(kept.read_text()))


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
    return file if file == "other threads" else "Python"


if __name__ == "__main__":
    for each in profiles():
        print(f"{each.name}: {each.median:.1f} {each.unit}", file=sys.stdout)
