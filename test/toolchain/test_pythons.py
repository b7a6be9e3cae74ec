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


def test_one_of_each_version_is_taken_and_names_its_real_file():
    (python,) = find_pythons([sys.executable, sys.executable])
    assert (python.version, python.tag) == (OWN, "cp" + OWN.replace(".", ""))
    assert python.executable == str(Path(sys.executable).resolve())
