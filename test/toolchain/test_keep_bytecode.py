"""Tests that bytecode is kept where Python is set to write none."""

import os
import subprocess
import sys
from pathlib import Path

TOOL = Path(__file__).parents[2] / "toolchain" / "keep_bytecode.py"


def test_all_modules_that_can_be_imported_are_kept_and_no_program_runs(tmp_path):
    for name, text in {
        "first/__init__.py": "",
        "first/inner.py": "import second.other\n",
        "first/lacking.py": "import a_package_that_nobody_has\n",
        "first/__main__.py": "raise SystemExit('it ran')\n",
        "second/__init__.py": "",
        "second/other.py": "",
        "third/__init__.py": "",
    }.items():
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(tmp_path)}
    environment.pop("PYTHONPYCACHEPREFIX", None)
    subprocess.run([sys.executable, TOOL, "first", "third"], env=environment, check=True)
    kept = {file.name.partition(".")[0] for file in tmp_path.glob("*/__pycache__/*.pyc")}
    assert kept == {"__init__", "inner", "lacking", "other"}
    assert len(list(tmp_path.glob("*/__pycache__/__init__*"))) == 3
