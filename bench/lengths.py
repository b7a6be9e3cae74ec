"""What the offline commands cost for ever longer bags, over three decades."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from bench.checkout import Checkout, work_tree
from bench.growth import Point

LENGTHS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)  # of bags [s]
REPEATS = 2

_ARRAYS = """
import sys
from rpud_sim.bag import BagReader

with BagReader(sys.argv[1]) as reader:
    for topic in ("/rpud/contact_force", "/rpud/drill_tool", "/rpud/nodal_plane"):
        reader.arrays(topic)
"""


def growth() -> Iterator[Point]:
    """Time `simulate --bag`, `verify`, `export`, `report` and `arrays()` of the same bags."""
    with work_tree() as version:
        for _ in _costs(version, LENGTHS[0]):
            pass  # Python compiles what it imports for the first time
        for _ in range(REPEATS):
            for length in LENGTHS:
                yield from _costs(version, length)


def _costs(version: Checkout, length: float) -> Iterator[Point]:
    with tempfile.TemporaryDirectory() as name:
        bag, out = Path(name, "bag"), Path(name, "out")
        run = ("rpud", "simulate", "--regime", "drilling", "--duration", str(length))
        commands: Mapping[str, Sequence[str | Path]] = {
            "simulate --bag": [*run, "--bag", bag],
            "verify": ["rpud", "verify", bag],
            "export": ["rpud", "export", bag, "--out", out],
            "report": ["rpud", "report", bag, "--out", out.with_suffix(".html")],
            "arrays of 3 topics": ["python", "-c", _ARRAYS, bag],
        }
        for work, command in commands.items():
            yield Point(f"{work} (seconds of bag)", length, version.run(command).processor)
