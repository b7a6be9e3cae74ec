"""What analysis of ever larger bags needs: ``python -m bench.long_bag 100 1000 10000``.

For each size in MB it writes a bag of the drill's waveform, exports and reports it, each in a
process of its own, and prints their peak memory and time. The disk needs about three times the
largest size.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from array import array
from pathlib import Path

import numpy as np

from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition

WAVEFORM = "rpud_msgs/msg/Waveform"
CHANNELS = (
    "nodal_plane_position",
    "actuator_position",
    "free_mass_position",
    "drill_tool_displacement",
    "contact_force",
    "reacting_force",
)
BLOCK = 2500  # samples of a block
RATE = 50_000  # Hz

_SECOND = 1_000_000_000
_WORK = {
    "export to parquet": ("export", "--out"),
    "export to numpy": ("export", "--format", "numpy", "--out"),
    "report": ("report", "--out"),
}


def long_waveform(path: Path, size: int) -> Path:
    """Write blocks of noise on ``/rpud/waveform``, not compressed, with so many bytes of samples.

    Args:
        path: of the new bag.
        size: of the samples [bytes].
    """
    definition = find_definition(WAVEFORM)
    codec = Codec(WAVEFORM, definition)
    numbers = np.random.default_rng(1)
    arrays = {name: array("d", numbers.normal(size=BLOCK)) for name in CHANNELS}
    with BagWriter(path, compression="none") as bag:
        bag.add_topic(Topic("/rpud/waveform", WAVEFORM), definition)
        for block in range(size // (BLOCK * len(CHANNELS) * 8)):
            moment = block * BLOCK * _SECOND // RATE
            stamp = {"sec": moment // _SECOND, "nanosec": moment % _SECOND}
            fields = {"header": {"stamp": stamp, "frame_id": "rpud_mount"}}
            fields |= {"sequence": block * BLOCK, "sample_period": 1.0 / RATE, **arrays}
            bag.write("/rpud/waveform", codec.encode(fields), moment, moment)
    return path


def measure(size: int, folder: Path) -> None:
    """Print what each kind of work needs for a bag of so many MB."""
    bag = long_waveform(folder / "bag", size * 10**6)
    for name, words in _WORK.items():
        script = (
            "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True, stdout=-3);"
            "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
        )
        command = ["rpud", words[0], str(bag), *words[1:], str(folder / "out")]
        started = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", script, *command], check=True, capture_output=True, text=True
        )
        wall = time.perf_counter() - started
        print(
            f"{size:6d} MB  {name:17s}  {int(done.stdout) / 1024:6.0f} MiB  {wall:7.1f} s",
            flush=True,
        )
        out = folder / "out"
        if out.is_dir():
            shutil.rmtree(out)
        else:
            out.unlink()
    shutil.rmtree(bag)


def main() -> int:
    """Measure every size; give the exit code."""
    parser = argparse.ArgumentParser(prog="long_bag", description="Memory of analysis.")
    parser.add_argument("sizes", nargs="+", type=int, metavar="MB", help="of the bags")
    parser.add_argument("--folder", type=Path, help="for the bags (default: the temporary one)")
    arguments = parser.parse_args()
    for size in arguments.sizes:
        with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
            measure(size, Path(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
