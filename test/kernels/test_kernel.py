"""Kernels before Numba is imported: what a call gives, and who asks for Python in its place."""

import os
import subprocess
import sys

import pytest

IS_DISABLED = """
import sys
from rpud_sim.kernels.kernel import is_disabled
found = is_disabled()
assert "numba" not in sys.modules or ".numba_config.yaml" in sys.argv
from numba.core import config
assert found == bool(config.DISABLE_JIT), (found, config.DISABLE_JIT)
print(found)
"""


@pytest.mark.parametrize(
    ("value", "file", "expected"),
    [
        (None, "", "False"),
        ("0", "", "False"),
        ("1", "", "True"),
        ("yes", "", "False"),
        (None, "disable_jit: 1\n", "True"),
    ],
)
def test_whether_kernels_run_as_python_is_what_numba_says(tmp_path, value, file, expected):
    words = [sys.executable, "-W", "ignore", "-c", IS_DISABLED]
    if file:
        (tmp_path / ".numba_config.yaml").write_text(file)
        words.append(".numba_config.yaml")
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_DISABLE_JIT"}
    environment |= {"NUMBA_DISABLE_JIT": value} if value is not None else {}
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.stdout, done.returncode) == (f"{expected}\n", 0), done.stderr
