"""The choice of a Python, and the one clear line where there is none."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "toolchain" / "find_python.sh"


def find_python(**variables: str) -> subprocess.CompletedProcess:
    """Run the script."""
    environment = {**os.environ, "ROS_PREFIX": "", "PYTHON": sys.executable, **variables}
    return subprocess.run([SCRIPT], env=environment, capture_output=True, text=True)


def command(folder: Path, name: str, script: str) -> str:
    """Write a command of our own and return a PATH on which it comes first."""
    (folder / name).write_text(f"#!/bin/sh\n{script}\n")
    (folder / name).chmod(0o755)
    return f"{folder}{os.pathsep}{os.environ['PATH']}"


def assert_python_outside(result: subprocess.CompletedProcess) -> None:
    """Check that what was found is the Python that this one's virtual environment was made from."""
    script = "import sys; print(sys.prefix, *sys.version_info)"
    output = subprocess.check_output([result.stdout.strip(), "-I", "-c", script], text=True)
    assert output.split() == [sys.base_prefix, *map(str, sys.version_info)]


def test_finds_the_python_outside_the_virtual_environment():
    result = find_python()
    assert result.returncode == 0
    assert sys.prefix not in result.stdout
    assert_python_outside(result)


@pytest.mark.parametrize("name", ["my drill", "a;b", "it's", "tab\there"])
def test_a_path_that_cmake_cannot_build_in_is_refused_in_one_line(tmp_path, name):
    (tmp_path / name).mkdir()
    result = subprocess.run([SCRIPT], cwd=tmp_path / name, capture_output=True, text=True)
    assert (result.returncode, result.stdout) == (1, "")
    [line] = result.stderr.splitlines()
    assert f"cannot build in '{tmp_path / name}': move the clone to a path without spaces" in line


def test_goes_on_to_the_next_candidate(tmp_path):
    path = command(tmp_path, "python-broken", "exit 127")
    result = find_python(PATH=path, PYTHON=f"python-none python-broken {sys.executable}")
    assert_python_outside(result)


@pytest.mark.parametrize(
    ("program", "script", "variables", "said"),
    [
        ("uname", "echo Linux aarch64", {}, "needs Linux on x86-64, this is Linux aarch64"),
        ("uname", "echo Darwin arm64", {}, "needs Linux on x86-64, this is Darwin arm64"),
        ("python-own", "exit 10", {"PYTHON": "python-own"}, "needs CPython 3.10 to 3.13"),
        ("python-own", "exit 20", {"PYTHON": "python-own"}, "python3-dev python3-venv"),
        ("other", "", {"CXX": "no-compiler"}, "sudo apt install g++"),
        (
            *("python-own", "exit 10", {"PYTHON": "python-own", "ROS_PREFIX": "/opt/ros/jazzy"}),
            "needs CPython 3.12, as /opt/ros/jazzy does",
        ),
    ],
)
def test_what_is_missing_is_one_line(tmp_path, program, script, variables, said):
    result = find_python(PATH=command(tmp_path, program, script), **variables)
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr.startswith("rpud_sim: ")
    assert result.stderr.count("\n") == 1
    assert said in result.stderr
