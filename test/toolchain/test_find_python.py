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
    return subprocess.run([SCRIPT], env=environment, capture_output=True, text=True, timeout=60)


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


def assert_one_line(result: subprocess.CompletedProcess, text: str) -> None:
    """Check that a failure is one line that has the text."""
    assert result.returncode == 1
    assert result.stdout == ""
    assert result.stderr.startswith("rpud_sim: ")
    assert result.stderr.count("\n") == 1
    assert text in result.stderr


def test_finds_the_python_outside_the_virtual_environment():
    result = find_python()
    assert result.returncode == 0
    assert sys.prefix not in result.stdout
    assert_python_outside(result)


def test_goes_on_to_the_next_candidate(tmp_path):
    path = command(tmp_path, "python-broken", "exit 127")
    result = find_python(PATH=path, PYTHON=f"python-none python-broken {sys.executable}")
    assert_python_outside(result)


@pytest.mark.parametrize("machine", ["Linux aarch64", "Darwin arm64"])
def test_refuses_another_machine(tmp_path, machine):
    path = command(tmp_path, "uname", f"echo {machine}")
    assert_one_line(find_python(PATH=path), f"needs Linux on x86-64, this is {machine}")


def test_refuses_another_python(tmp_path):
    path = command(tmp_path, "python-new", "exit 10")
    assert_one_line(find_python(PATH=path, PYTHON="python-new"), "needs CPython 3.10 to 3.13")


def test_names_the_debian_packages_that_an_incomplete_python_lacks(tmp_path):
    path = command(tmp_path, "python-bare", "exit 20")
    assert_one_line(find_python(PATH=path, PYTHON="python-bare"), "python3-dev python3-venv")


def test_names_the_compiler_that_is_missing():
    assert_one_line(find_python(CXX="no-compiler"), "sudo apt install g++")


def test_wants_the_python_of_an_installed_ros(tmp_path):
    path = command(tmp_path, "python-old", "exit 10")
    result = find_python(PATH=path, PYTHON="python-old", ROS_PREFIX="/opt/ros/jazzy")
    assert_one_line(result, "needs CPython 3.12, that of /opt/ros/jazzy")
