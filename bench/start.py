"""How long commands take from start to end, with an empty cache of compiled code and a full one."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from bench.checkout import Used, work_tree
from bench.row import Row, row

REPEATS = 7
SIMULATE = ("rpud", "simulate", "--duration", "0.1")
COMMANDS: Mapping[str, Sequence[str]] = {
    "python -c 'import numpy'": ("python", "-c", "import numpy"),
    "rpud --help": ("rpud", "--help"),
    " ".join(SIMULATE): SIMULATE,
}


def start() -> Iterator[Row]:
    """Time whole commands in turns, beside the import of NumPy alone."""
    with work_tree() as version:
        with tempfile.TemporaryDirectory() as folder:
            without = shutil.ignore_patterns("compiled", "__pycache__")
            sources = version.tree / "rpud_sim"
            shutil.copytree(sources, Path(folder) / "rpud_sim", ignore=without)
            others = version.environment["PYTHONPATH"].split(os.pathsep)[1:]
            paths = os.pathsep.join([folder, *others])
            cold = version.run(SIMULATE, variables={"PYTHONPATH": paths, "XDG_CACHE_HOME": folder})
        yield row(f"start: {' '.join(SIMULATE)}, cold cache", [cold.wall], "s")
        used: dict[str, list[Used]] = {name: [] for name in COMMANDS}
        for turn in range(-1, REPEATS):
            for name, words in COMMANDS.items():
                took = version.run(words)
                if turn >= 0:  # the first is to warm up
                    used[name].append(took)
    bare = used[next(iter(COMMANDS))]
    for name, found in used.items():
        yield row(f"start: {name}", [each.wall for each in found], "s")
        yield row(f"start: {name}, time of processors", [each.processor for each in found], "s")
        if found is not bare:
            pairs = zip(found, bare, strict=True)
            ratios = [ours.processor / theirs.processor for ours, theirs in pairs]
            yield row(f"start: {name}, over {next(iter(COMMANDS))}", ratios)
