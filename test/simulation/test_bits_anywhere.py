"""The same drills have the same bits with another processor, C library, NumPy and without Numba.

Each environment is a process of `same_bits.py` with a copy of the package, whose folder takes the
kernels that are compiled for other processors.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import llvmlite.binding as llvm
import pytest
from numba.core.codegen import get_host_cpu_features
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
from same_bits import KEPT, all_digests

import rpud_sim
from rpud_sim.simulation.versions import ENGINE

PACKAGE = Path(rpud_sim.__file__).parent
SCRIPT = Path(__file__).parents[1] / "helpers" / "same_bits.py"
LIBRARIES = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4,-AVX",
    "NPY_DISABLE_CPU_FEATURES": " ".join(
        name for name in __cpu_dispatch__ if __cpu_features__.get(name)
    ),
}
# The kernels are made for x86-64-v3, unless a processor lacks a part of it.
PLAIN = {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": ""}
NATIVE = {
    "NUMBA_CPU_NAME": llvm.get_host_cpu_name(),
    "NUMBA_CPU_FEATURES": get_host_cpu_features().replace("+sahf", "-sahf"),
}


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """Folder with a copy of the package."""
    folder = tmp_path_factory.mktemp("copy")
    ignored = shutil.ignore_patterns("__pycache__", ".*")  # files that others still write
    shutil.copytree(PACKAGE, folder / "rpud_sim", ignore=ignored)
    return folder


def check(package: Path, folder: Path, shorter: float, environment: dict[str, str]) -> None:
    paths = os.pathsep.join(filter(None, (str(package), os.environ.get("PYTHONPATH"))))
    there = subprocess.Popen(
        [sys.executable, SCRIPT, str(shorter)],
        env={**os.environ, "PYTHONPATH": paths, **environment},
        stdout=subprocess.PIPE,
    )
    try:
        expected = all_digests(shorter, folder)
        output, _ = there.communicate()
    finally:
        there.kill()
    assert there.returncode == 0
    assert json.loads(output) == expected


def test_the_bits_are_those_of_the_engine_version(tmp_path):
    """If this fails, raise ENGINE for a change that is meant, and run `same_bits.py --keep`."""
    assert json.loads(KEPT.read_text()) == {"engine": ENGINE, **all_digests(1.0, tmp_path)}


@pytest.mark.extended
@pytest.mark.parametrize(
    ("environment", "shorter"),
    [
        (LIBRARIES, 0.1),
        (PLAIN, 0.2),
        (NATIVE, 0.2),
        ({"NUMBA_DISABLE_JIT": "1"}, 5.0),
        ({"NUMBA_DISABLE_JIT": "1", **LIBRARIES}, 5.0),
    ],
    ids=["libraries", "plain", "native", "python", "python_libraries"],
)
def test_no_environment_changes_a_bit(package, tmp_path, environment, shorter):
    check(package, tmp_path, shorter, environment)
