"""A cached kernel that is older than the model is compiled again, in whichever package it is."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import rpud_sim

PACKAGE = Path(rpud_sim.__file__).parent


@pytest.fixture
def copy(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "rpud_sim", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


@pytest.mark.parametrize("folder", ["model", "simulation"])
def test_kernels_older_than_the_model_are_dropped_and_newer_ones_kept(copy, folder):
    sources = (copy / "rpud_sim" / "model").glob("*.py")
    newest = max(source.stat().st_mtime_ns for source in sources)
    cache = copy / "rpud_sim" / folder / "__pycache__"
    cache.mkdir()
    for name, time in (("older.nbi", newest - 1), ("newer.nbi", newest + 1)):
        (cache / name).touch()
        os.utime(cache / name, ns=(time, time))
    subprocess.run(
        [sys.executable, "-c", "import rpud_sim.model.compile"],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        timeout=60,
        check=True,
    )
    assert [index.name for index in cache.glob("*.nbi")] == ["newer.nbi"]
