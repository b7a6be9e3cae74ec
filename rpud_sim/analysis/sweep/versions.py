"""What the bits of a sweep's results depend on, beside its specification."""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import rpud_sim


@cache
def engine_versions() -> dict[str, str]:
    """Return the versions of what runs the simulations, which every worker must share."""
    return {
        "rpud_sim": _version("rpud_sim"),
        "sources": source_digest(),
        "python": platform.python_version(),
        **{name: _version(name) for name in ("numpy", "numba", "llvmlite")},
        "machine": platform.machine(),
    }


def all_versions() -> dict[str, str]:
    """Return ``engine_versions`` with what draws the design and writes the files."""
    return engine_versions() | {name: _version(name) for name in ("scipy", "pyarrow")}


def source_digest() -> str:
    """Return a digest of the sources that the results come from, whose version may stand still."""
    package = Path(rpud_sim.__file__).parent
    digest = hashlib.sha256()
    for folder in ("model", "simulation"):
        for source in sorted((package / folder).glob("**/*.py")):
            digest.update(source.relative_to(package).as_posix().encode() + b"\0")
            digest.update(hashlib.sha256(source.read_bytes()).digest())
    return digest.hexdigest()[:16]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # linked into the search path, without metadata
        return "unknown"
