"""Fixtures of the command line."""

import os
import subprocess
import sys
from functools import partial

import pytest
from support import called

# The command line where some modules are missing: a name that is None cannot be imported.
_LACKING = """
import importlib, sys
sys.modules.update(dict.fromkeys(sys.argv.pop(1).split(",")))
module, name = sys.argv.pop(1).split(":")
getattr(importlib.import_module(module), name)()
"""


@pytest.fixture
def rpud(capsys):
    """Call the command line in this process; give exit code, output and errors."""
    return partial(called, capsys)


@pytest.fixture(scope="session")
def lacking(tmp_path_factory):
    """Run `rpud` where modules are missing, in a folder of its own."""
    folder = tmp_path_factory.mktemp("lacking")

    def run(modules, *words, program="rpud_sim.cli.main:main"):
        return subprocess.run(
            [sys.executable, "-c", _LACKING, ",".join(modules), program, *map(str, words)],
            cwd=folder,
            env={**os.environ, "RPUD_TRACEBACK": ""},
            capture_output=True,
            text=True,
            check=False,
        )

    return run
