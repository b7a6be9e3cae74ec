"""Versions of the engine, and of what a simulation is computed with."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

# Version of the engine. A release that changes any bit of a message has the next one, for a rerun
# proves nothing about the bags of another engine. Release 0.1.0 has 1, 0.2.0 3, and 0.3.0 6.
ENGINE = 7


def engine_of(beginning: Any) -> Any:
    """Return the engine version that a journal's entry ``begin`` names; 0 if it names none."""
    return beginning.get("engine", 0) if isinstance(beginning, Mapping) else 0


def other_engine(beginning: Any) -> str:
    """Return in one line which release reads a run of another engine; empty for this one."""
    if engine_of(beginning) == ENGINE:
        return ""
    made_by = beginning.get("made_by") if isinstance(beginning, Mapping) else None
    release = made_by.get("rpud_sim") if isinstance(made_by, Mapping) else None
    release = f"rpud_sim {release or 'of an unknown version'!s:.40}"
    return f"made by {release}, not by engine {ENGINE}: {release} reads it"


@cache
def engine_versions() -> dict[str, str]:
    """Return the versions of the package, its sources, Python, its libraries and the machine.

    They inform: the engine version alone decides the bits of a message.
    """
    return {
        "rpud_sim": version_of("rpud_sim"),
        "sources": source_digest(),
        "python": platform.python_version(),
        **{name: version_of(name) for name in ("numpy", "numba", "llvmlite")},
        "machine": platform.machine(),
    }


def source_digest() -> str:
    """Return a digest of the sources of the results; it changes between versions as well."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for folder in ("foundation", "model", "drilling", "simulation"):
        for source in sorted((package / folder).glob("**/*.py")):
            digest.update(source.relative_to(package).as_posix().encode() + b"\0")
            digest.update(hashlib.sha256(source.read_bytes()).digest())
    return digest.hexdigest()[:16]


def version_of(name: str) -> str:
    """Return the version of an installed package; ``unknown`` where it has no metadata."""
    try:
        return version(name)
    except PackageNotFoundError:  # linked into the search path, without metadata
        return "unknown"
