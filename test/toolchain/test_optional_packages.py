"""Packages of optional.lock: no test is skipped because they cannot be installed."""

import os
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_make_fails_where_optional_packages_cannot_be_installed(tmp_path):
    shutil.copy(ROOT / "Makefile", tmp_path)
    locks = [f"toolchain/requirements/{name}.lock" for name in ("installer", "wheels", "optional")]
    for name in (*locks, ".venv/.installed", ".venv/bin/python"):  # from the oldest on
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    python = tmp_path / ".venv/bin/python"
    python.write_text("#!/bin/sh\necho no such package >&2; exit 1\n")
    python.chmod(0o755)
    # Without what the make of this test run has passed on.
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS"))}
    done = subprocess.run(
        ["make", "ROS_PREFIX=", ".venv/.optional"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert "no such package" in done.stderr
    assert not (tmp_path / ".venv/.optional").exists()
