"""What .ci/run asks of make: a browser, and both tiers of tests."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def ci_run(tmp_path):
    """Run .ci/run in a folder where programs note how they were called; return what it printed."""
    (tmp_path / ".ci").mkdir()
    shutil.copy(ROOT / ".ci" / "run", tmp_path / ".ci")
    (tmp_path / "toolchain").symlink_to(ROOT / "toolchain")
    programs = tmp_path / "bin"
    programs.mkdir()
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    (tmp_path / ".venv" / "bin" / "python").symlink_to(sys.executable)
    for name in ("bash", "dirname", "grep", "cat"):
        (programs / name).symlink_to(shutil.which(name))

    def program(name, text):
        (programs / name).write_text(f"#!/bin/bash\n{text}\n")
        (programs / name).chmod(0o755)

    program("make", 'echo "make $* RPUD_BROWSER=${RPUD_BROWSER:-} $PYTEST_ARGS"')
    program("id", "echo 0")

    def run(**made):
        for name, text in made.items():
            program(name.replace("_", "-"), text)
        environment = {"PATH": str(programs), "PYTEST_ARGS": "-x"}
        done = subprocess.run(
            [tmp_path / ".ci" / "run"], env=environment, capture_output=True, text=True
        )
        return done.stdout, done.stderr, done.returncode

    return run


def test_a_browser_that_is_there_is_required(ci_run, tmp_path):
    printed, errors, code = ci_run(chromium="", npm="", apt_get="touch asked")
    assert "make test RPUD_BROWSER=required -x" in printed
    assert "make test-all SEED=0 RPUD_BROWSER=required" in printed
    assert not (tmp_path / "asked").exists()
    assert (errors, code) == ("", 0)


@pytest.mark.parametrize("made", [{"id": "echo 1000"}, {"apt_get": "false"}])
def test_elsewhere_one_line_says_what_is_missing(ci_run, made):
    printed, errors, code = ci_run(**made)
    assert "make test RPUD_BROWSER= -x" in printed
    assert errors.count("\n") == 1
    assert "no Chromium" in errors
    assert code == 0
