"""Versions of everything, beside its inputs, that the bits of a simulation depend on."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import rpud_sim

# Revision of the physics, which is 1 where a journal has none. It grows when an error in the
# equations is mended or a law goes: runs that it touches cannot be computed again.
PHYSICS = 3


def mended_since(beginning: Mapping[str, Any]) -> str:
    """Return in one line what was mended since a run that touches it; empty if nothing was.

    Args:
        beginning: content of a journal's entry ``begin``.
    """
    if beginning.get("physics") == 2:
        return (
            "the run cannot be computed again, for it was made between versions 0.1.0 and 0.2.0: "
            "laws of rotation, cuttings, wear and heat have gone since, with their parameters"
        )
    parameters = beginning.get("parameters")
    model = parameters.get("actuator_model") if isinstance(parameters, dict) else None
    if "physics" not in beginning and model == "resonance":
        return (
            "the run cannot be computed again, for the physics was mended after version 0.1.0: "
            "with actuator_model = resonance impacts now take their energy from the vibration"
        )
    return ""


@cache
def engine_versions() -> dict[str, str]:
    """Return the versions of the package, its sources, Python, its libraries and the machine."""
    return {
        "rpud_sim": version_of("rpud_sim"),
        "sources": source_digest(),
        "python": platform.python_version(),
        **{name: version_of(name) for name in ("numpy", "numba", "llvmlite")},
        "machine": platform.machine(),
    }


@cache
def engine_and_processor() -> dict[str, str]:
    """Return ``engine_versions`` with processor and C library, which decide the bits of a sine."""
    from llvmlite import binding

    return {
        **engine_versions(),
        "processor": binding.get_host_cpu_name(),
        "c_library": " ".join(platform.libc_ver()),
    }


def source_digest() -> str:
    """Return a digest of the sources of the results; it changes between versions as well."""
    package = Path(rpud_sim.__file__).parent
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
