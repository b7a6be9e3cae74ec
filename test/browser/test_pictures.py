"""The pictures of the docs need a browser."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("playwright")

pytestmark = pytest.mark.extended


def test_make_picture_says_in_one_line_what_is_missing(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "toolchain.pictures", tmp_path, "screen"],
        env={**os.environ, "PATH": str(tmp_path), "CHROMIUM": ""},
        cwd=Path(__file__).resolve().parents[2],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("pictures: no Chromium")
    assert done.stderr.count("\n") == 1
