"""What a sweep's files depend on, beside its specification."""

from __future__ import annotations

from rpud_sim.simulation.versions import engine_versions, version_of


def all_versions() -> dict[str, str]:
    """Return ``engine_versions`` with what draws the design and writes the files."""
    return engine_versions() | {name: version_of(name) for name in ("scipy", "pyarrow")}
