"""Compiled kernels for the wheel of ``rpud_sim``, so that an installation starts without compiling.

A kernel serves one CPython and the versions of Numba and llvmlite that it was compiled with.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from toolchain.dist.pythons import Python

_COMPILER = ("numba", "llvmlite")  # in the versions of this environment; of NumPy any will do


def compile_kernels(folder: Path, pythons: Sequence[Python], root: Path) -> list[str]:
    """Compile the kernels for each Python, and return a line for each that has none.

    Args:
        folder: of the kernels, replaced.
        pythons: to compile for; others than this one get an environment with Numba beside the folder.
        root: of the sources.
    """
    shutil.rmtree(folder, ignore_errors=True)
    missing = []
    for python in pythons:
        executable: str | Path = sys.executable
        try:
            if python.version != "{}.{}".format(*sys.version_info):
                executable = _with_numba(python, folder.parent / f"numba-{python.tag}")
            _run(executable, "-m", "toolchain.precompile", "--into", folder, root=root)
        except subprocess.CalledProcessError as error:
            lines = error.stderr.strip().splitlines() or [f"exit code {error.returncode}"]
            missing.append(f"no kernels for {python.tag}: {lines[-1]}")
    return missing


def _with_numba(python: Python, environment: Path) -> Path:
    """Return the Python of an environment with what compiling needs."""
    executable = environment / "bin" / "python"
    if not executable.exists():
        _run(python.executable, "-m", "venv", environment)
    names = [f"{name}=={metadata.version(name)}" for name in _COMPILER]
    _run(executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *names, "pyyaml")
    return executable


def _run(*command: str | Path, root: Path | None = None) -> None:
    # Another Python must see the sources, and no package that this one has installed.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    if root is not None:
        environment["PYTHONPATH"] = str(root)
    words = list(map(str, command))
    subprocess.run(words, check=True, env=environment, capture_output=True, text=True)
