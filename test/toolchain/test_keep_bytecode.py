"""Where Python may not keep what it compiles, set-up does it once for all starts."""

import os
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / "toolchain/keep_bytecode.py"


def test_what_was_compiled_is_kept_although_the_environment_forbids_it(tmp_path):
    inner = tmp_path / "package/inner"
    inner.mkdir(parents=True)
    for folder in (inner.parent, inner):
        (folder / "__init__.py").touch()
    (inner / "one.py").write_text("import other")
    (inner / "another.py").write_text("import one_that_is_not_installed")
    (tmp_path / "other.py").touch()
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(tmp_path)}
    subprocess.run([sys.executable, str(SCRIPT), "package"], check=True, env=environment)
    kept = {file.name.partition(".")[0] for file in tmp_path.rglob("*.pyc")}
    assert kept == {"__init__", "one", "another", "other"}
