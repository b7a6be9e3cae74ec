"""Build the wheels of both packages into ``dist/``."""

from __future__ import annotations

import argparse
import fcntl
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from rpud_sim.foundation.terminal import print_error
from toolchain.dist.kernels import compile_kernels
from toolchain.dist.messages import BUILT, ROOT, stage_messages
from toolchain.dist.pythons import VERSIONS, Python, find_pythons

_PROGRAM = "make dist"


def main() -> int:
    """Build the wheels, print their files and sizes, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m toolchain.dist", description=__doc__)
    parser.add_argument(
        "--python",
        action="append",
        default=[],
        metavar="PATH",
        help="CPython to compile the messages for (default: each of "
        f"{VERSIONS[0]} to {VERSIONS[-1]} on the search path or of pyenv)",
    )
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the wheels")
    arguments = parser.parse_args()
    reason = _obstacle()
    if reason:
        print_error(_PROGRAM, reason)
        return 1
    pythons = find_pythons(arguments.python)
    if not pythons:
        print_error(_PROGRAM, f"needs the headers of a CPython {VERSIONS[0]} to {VERSIONS[-1]}")
        return 1

    work = ROOT / "build" / "dist"
    work.mkdir(parents=True, exist_ok=True)
    with (work / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # of two builds at one time, the second one waits
        return _build(work, arguments.out, pythons)


def _build(work: Path, out: Path, pythons: Sequence[Python]) -> int:
    """Build the wheels into a folder, and return the exit code."""
    try:
        tag = stage_messages(work / "rpud_msgs", pythons)
        for line in compile_kernels(work / "kernels", pythons, ROOT):
            print_error(_PROGRAM, f"{line}; the first start compiles there")
        # A wheel of an earlier build beside the new one would stop `pip install dist/*.whl`.
        for old in out.glob("rpud_*.whl"):
            old.unlink()
        _build_wheel(work / "rpud_msgs", out)
        _build_wheel(ROOT, out, f"--config-settings=kernels={work / 'kernels'}")
    except subprocess.CalledProcessError as error:
        print_error(_PROGRAM, f"{Path(error.cmd[0]).name} failed with exit code {error.returncode}")
        return 1
    print(f"messages for {tag}")
    for wheel in sorted(out.glob("rpud_*.whl")):
        print(f"{wheel}  {wheel.stat().st_size / 1e6:.1f} MB")
    return 0


def _obstacle() -> str:
    """Return why no wheels can be built, or an empty text."""
    if not (Path(sys.prefix) / "share" / "rclpy").is_dir():
        return "needs ROS 2 Jazzy as wheels: make distclean, then make dist ROS_PREFIX="
    if not BUILT.is_dir():
        return "the messages are not built: run 'make setup' first"
    if shutil.which("readelf") is None:
        return "needs readelf and strip: sudo apt install binutils"
    return ""


def _build_wheel(source: Path, out: Path, *options: str) -> None:
    """Build a wheel with what is installed here: no package is downloaded.

    Two builds give the same bytes: every file has the time of the commit.
    """
    subprocess.run(
        [
            *(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-index"),
            *("--no-build-isolation", "--disable-pip-version-check", "--wheel-dir", out),
            *options,
            source,
        ],
        check=True,
        env={"SOURCE_DATE_EPOCH": _commit_time(), **os.environ},
    )


def _commit_time() -> str:
    """Return the time of the commit; outside of git, the first day that a zip file can store."""
    git = ["git", "-C", ROOT, "log", "-1", "--format=%ct"]
    done = subprocess.run(git, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "315532800"


if __name__ == "__main__":
    sys.exit(main())
