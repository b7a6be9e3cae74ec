"""Install the wheels of ``dist/`` into fresh environments; print the times and the disk space.

Packages come from the package index that pip is set up for. Nothing is sourced. The time of
processors says how long a machine takes that does nothing else.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rpud_sim.foundation.terminal import complain
from toolchain.dist.messages import ROOT

# What env.bash, colcon and an installed ROS leave in a shell.
_OF_ROS = ("AMENT_", "CMAKE_", "COLCON_", "FASTRTPS_", "LD_LIBRARY_", "PYTHON", "RMW_", "ROS_")
_OF_ROS += ("VIRTUAL_ENV", "_ROS_")


def plain_environment() -> dict[str, str]:
    """Return the environment of a shell that has sourced nothing, in the same ROS domain."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(_OF_ROS)}
    if "ROS_DOMAIN_ID" in os.environ:
        kept["ROS_DOMAIN_ID"] = os.environ["ROS_DOMAIN_ID"]
    return kept


class Steps:
    """Commands in one folder, each with its time.

    Args:
        folder: where they run.
        options: given to pip.
    """

    def __init__(self, folder: Path, options: Sequence[str]) -> None:
        self.folder = folder
        self.programs = folder / "v" / "bin"
        self._options = options
        self._begin = time.monotonic()

    def install(self, python: str, extras: str, wheels: Path) -> None:
        """Make an environment and install the package with its extras into it."""
        with self._timed("python -m venv v"):
            self._run(python, "-m", "venv", "v")
        requirement = f"rpud_sim[{extras}]" if extras else "rpud_sim"
        options = " ".join(self._options)
        with self._timed(f"pip install {options}{' ' if options else ''}'{requirement}'"):
            self._run(
                *(self.programs / "pip", "install", "--quiet", "--disable-pip-version-check"),
                *(*self._options, "--find-links", wheels, requirement),
            )
        print(f"{_disk(self.folder / 'v'):8.0f} MB of disk", flush=True)

    def call(self, program: str, *words: str) -> None:
        """Run an installed program."""
        with self._timed(" ".join((program, *words))):
            self._run(self.programs / program, *words)

    def total(self) -> None:
        """Print the time since the beginning."""
        _print("all together", time.monotonic() - self._begin, _processor_time())

    def _run(self, *command: str | Path) -> None:
        done = subprocess.run(
            list(map(str, command)),
            cwd=self.folder,
            env=plain_environment(),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
        )
        if done.returncode:
            print(done.stdout, done.stderr, sep="", file=sys.stderr)
            done.check_returncode()

    @contextmanager
    def _timed(self, name: str) -> Iterator[None]:
        begin, processor = time.monotonic(), _processor_time()
        yield
        _print(name, time.monotonic() - begin, _processor_time() - processor)


def _print(name: str, elapsed: float, processor: float) -> None:
    print(f"{elapsed:8.1f} s {processor:6.1f} s of processors  {name}", flush=True)


def _processor_time() -> float:
    """Return the processor time of all programs that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _disk(folder: Path) -> float:
    """Return the disk space of a folder [MB]."""
    output = subprocess.check_output(["du", "-s", "--block-size=1000", folder], text=True)
    return int(output.split()[0]) / 1000.0


def main() -> int:
    """Measure, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m toolchain.dist.measure", description=__doc__)
    parser.add_argument("--extras", default="", help="such as ros,test (default: none)")
    parser.add_argument("--python", default="python3", help="to make the environment with")
    parser.add_argument("--wheels", type=Path, default=ROOT / "dist", help="folder of the wheels")
    parser.add_argument("--pip", action="append", default=[], metavar="OPTION", help="for pip")
    parser.add_argument("--test", type=Path, metavar="FILE", help="file of tests to run by pytest")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rpud_sim_measure_") as folder:
        steps = Steps(Path(folder), arguments.pip)
        try:
            steps.install(arguments.python, arguments.extras, arguments.wheels.resolve())
            if arguments.test:
                steps.call("pytest", "-q", str(arguments.test.resolve()))
                steps.total()
                return 0
            steps.call("rpud", "simulate", "--duration", "0.1")
            if "ros" in arguments.extras.split(","):
                # Its own name: another drill may run on this machine.
                words = ("--record", "bag", "--quiet", "--namespace", f"/measure_{os.getpid()}")
                steps.call("rpud", "run", "--duration", "1", *words)
            else:
                steps.call("rpud", "simulate", "--duration", "1", "--bag", "bag")
            steps.call("rpud", "verify", "bag")
            steps.total()
        except subprocess.CalledProcessError as error:
            complain("measure", f"{error.cmd[0]} failed with exit code {error.returncode}")
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
