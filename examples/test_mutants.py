"""Shows that the requirements catch mutants of the supervisor; `mutants.py` runs them all."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.extended

FILE = Path(__file__).parent / "mutants.py"


@pytest.fixture(scope="module")
def mutants():
    specification = importlib.util.spec_from_file_location("mutants", FILE)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def test_twenty_mutants_differ_from_the_supervisor_and_from_each_other(mutants, tmp_path):
    assert len(mutants.MUTANTS) == 20
    mutants.write_mutants(tmp_path, mutants.MUTANTS)
    texts = {path.read_text() for path in tmp_path.glob("*.py")}
    assert len(texts | {(FILE.parent / "supervisor.py").read_text()}) == 21
    for text in texts:
        compile(text, "mutant", "exec")


@pytest.mark.timeout(300)
def test_three_mutants_are_caught():
    names = ("never engages", "late reaction", "trusts a stuck sensor")
    command = [sys.executable, str(FILE), "--jobs", "1", "--first", *names]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 of 3 mutants caught" in done.stdout
    assert "REQ-10" in done.stdout.split("trusts a stuck sensor")[1]
