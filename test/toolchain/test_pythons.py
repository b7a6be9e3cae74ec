"""Which CPythons the messages are compiled for."""

import sys
import sysconfig
from pathlib import Path

import pytest

from toolchain.dist.pythons import find_pythons

OWN = "{}.{}".format(*sys.version_info)

pytestmark = pytest.mark.skipif(
    not Path(sysconfig.get_path("include"), "Python.h").exists(), reason="has no headers"
)


def program(folder, name, text):
    """Make a program that prints a text."""
    file = folder / name
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(0o755)
    return str(file)


def test_one_of_each_version_is_taken_and_names_its_real_file():
    (python,) = find_pythons([sys.executable, sys.executable])
    assert (python.version, python.tag) == (OWN, "cp" + OWN.replace(".", ""))
    assert python.executable == str(Path(sys.executable).resolve())


@pytest.mark.parametrize(
    "text",
    [
        "exit 127",  # pyenv's name of a version that it hides
        """echo '{"executable": "/x", "version": "3.9", "usable": true}'""",
        """echo '{"executable": "/x", "version": "3.12", "usable": false}'""",  # without headers
    ],
)
def test_a_python_that_cannot_be_used_is_passed(tmp_path, text):
    assert find_pythons([program(tmp_path, "python3", text), str(tmp_path / "absent")]) == []
