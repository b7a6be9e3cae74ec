"""Run the steps of the Dockerfile of ``docs/ci.md`` without Docker; print their times and sizes.

The folders of the image lie in a temporary folder. The tests are those of the page of the plugin.
The time of processors says how long a machine takes that does nothing else.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "ci.md"
TESTS = ROOT / "docs" / "how-to" / "test-your-stack.md"

# What env.bash, colcon and an installed ROS leave in a shell.
_OF_ROS = ("AMENT_", "CMAKE_", "COLCON_", "FASTRTPS_", "LD_LIBRARY_", "PYTHON", "RMW_", "ROS_")
_OF_ROS += ("VIRTUAL_ENV", "_ROS_")


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of a page in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)


def instructions(dockerfile: str) -> list[tuple[str, str]]:
    """Return the instructions of a Dockerfile with their arguments, without comments."""
    joined = re.sub(r"\\\n\s*", "", dockerfile)
    lines = [line for line in joined.splitlines() if line and not line.startswith("#")]
    return [(word, rest.strip()) for word, _, rest in (line.partition(" ") for line in lines)]


def _processor_time() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _disk(folder: Path) -> float:
    """Return the disk space of a folder [MB]."""
    output = subprocess.check_output(["du", "-s", "--block-size=1000", folder], text=True)
    return int(output.split()[0]) / 1000.0


def run(folder: Path, wheels: Path, python: str) -> int:
    """Run the steps in a folder, and return the exit code of the first that fails.

    Args:
        folder: in place of the image.
        wheels: folder of the wheels.
        python: interpreter of the image.
    """
    mission, tools = folder / "mission", folder / "tools"
    (mission / "tests").mkdir(parents=True)
    for step in blocks(TESTS, "bash"):
        files = step.partition("\npython -m pytest")[0]  # the recipe itself runs the tests
        subprocess.run(["bash", "-euc", files], cwd=folder, check=True)
    for file in mission.glob("*.py"):
        file.rename(mission / "tests" / file.name)
    tools.mkdir()
    (tools / "python").symlink_to(shutil.which(python) or python)
    environment = {k: v for k, v in os.environ.items() if not k.startswith(_OF_ROS)}
    # The recipe itself is for pytest's own domains; ROS stays on loopback in any case.
    environment |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    environment["PATH"] = f"{tools}:{environment['PATH']}"
    stage = ""
    print(f"{'stage':13} {'elapsed':>9} {'processors':>11} {'disk':>9}  step")
    for word, argument in instructions(blocks(PAGE, "dockerfile")[0]):
        places = argument.replace("/venv", f"{folder}/venv").replace("/wheels", str(wheels))
        if word == "FROM":
            stage = argument.split(" AS ")[1]
        elif word == "ENV":
            environment["PATH"] = f"{folder}/venv/bin:{environment['PATH']}"
        elif word in ("RUN", "CMD"):
            command = places if word == "RUN" else shlex.join(_words(argument))
            begun, processors, before = time.monotonic(), _processor_time(), _disk(folder)
            done = subprocess.run(
                ["bash", "-euc", command], cwd=mission, env=environment, stdout=subprocess.DEVNULL
            )
            print(
                f"{stage:13} {time.monotonic() - begun:7.1f} s "
                f"{_processor_time() - processors:9.1f} s {_disk(folder) - before:6.0f} MB  "
                f"{argument if word == 'RUN' else shlex.join(_words(argument))}",
                flush=True,
            )
            if done.returncode:
                return done.returncode
    return 0


def _words(form: str) -> list[str]:
    """Return the words of the form ["program", "argument"]."""
    return re.findall(r'"([^"]*)"', form)


def main() -> int:
    """Run the recipe, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m toolchain.recipe", description=__doc__)
    parser.add_argument("--wheels", type=Path, default=ROOT / "dist", help="folder of the wheels")
    parser.add_argument("--python", default="python3", help="interpreter of the image")
    arguments = parser.parse_args()
    wheels = arguments.wheels.resolve()
    if not list(wheels.glob("rpud_sim-*.whl")):
        print(f"recipe: {wheels} holds no wheel of rpud_sim: make dist", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory(prefix="rpud_sim_recipe_") as folder:
        return run(Path(folder), wheels, arguments.python)


if __name__ == "__main__":
    sys.exit(main())
