"""How long commands take from start to end, with an empty cache of compiled code and a full one."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import rpud_sim
from bench.row import Row, row

REPEATS = 7
RPUD = ("-m", "rpud_sim.cli.main")
SIMULATE = (*RPUD, "simulate", "--duration", "0.1")
COMMANDS: Mapping[str, Sequence[str]] = {
    "python -c 'import numpy'": ("-c", "import numpy"),
    "rpud --help": (*RPUD, "--help"),
    "rpud simulate --duration 0.1": SIMULATE,
}


def start() -> Iterator[Row]:
    """Time whole commands in turns, beside the import of NumPy alone."""
    with tempfile.TemporaryDirectory() as folder:
        ours = Path(rpud_sim.__file__).parent
        without = shutil.ignore_patterns("compiled", "__pycache__")
        shutil.copytree(ours, Path(folder) / "rpud_sim", ignore=without)
        cold, _ = _run(
            SIMULATE,
            {
                "PYTHONPATH": f"{folder}:{os.environ.get('PYTHONPATH', '')}",
                "XDG_CACHE_HOME": folder,
            },
        )
    yield row("start: rpud simulate --duration 0.1, cold cache", [cold], "s")
    _run(SIMULATE)
    walls: dict[str, list[float]] = {name: [] for name in COMMANDS}
    processor: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for _ in range(REPEATS):
        for name, words in COMMANDS.items():
            wall, used = _run(words)
            walls[name].append(wall)
            processor[name].append(used)
    first = next(iter(COMMANDS))
    for name in COMMANDS:
        yield row(f"start: {name}", walls[name], "s")
        yield row(f"start: {name}, time of processors", processor[name], "s")
        if name != first:
            pairs = zip(processor[name], processor[first], strict=True)
            ratios = [ours / bare for ours, bare in pairs]
            yield row(f"start: {name}, over {first}", ratios)


def _run(words: Sequence[str], environment: Mapping[str, str] | None = None) -> tuple[float, float]:
    """Wall time and time of processors of a command [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    subprocess.run(
        [sys.executable, *words],
        check=True,
        stdout=subprocess.DEVNULL,
        env={**os.environ, **(environment or {})},
    )
    wall = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return wall, used
