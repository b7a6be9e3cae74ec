"""The profiler of nodes counts every thread, by file, since counting began."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BUSY = """
import threading
import time


def spend():
    end = time.thread_time() + 0.2
    while time.thread_time() < end:
        pass


def main():
    thread = threading.Thread(target=spend)
    thread.start()
    thread.join()
    spend()
    raise SystemExit(3)
"""


def test_the_threads_of_python_are_counted_by_file(tmp_path):
    (tmp_path / "busy.py").write_text(BUSY)
    out = tmp_path / "profile.json"
    words = [sys.executable, "-m", "bench.profiled", str(out), "0", "busy:main"]
    path = os.pathsep.join([str(ROOT), str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(words, env={**os.environ, "PYTHONPATH": path}, check=False)
    assert done.returncode == 3
    spent = json.loads(out.read_text())
    # Almost all of both threads: what came before the counting is left out.
    assert 0.2 < spent[str(tmp_path / "busy.py")] == pytest.approx(0.4, abs=0.15)
