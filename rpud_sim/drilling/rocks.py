"""Rocks: values of ``Layer`` by name for those that strata may name.

docs/explanation/drilling.md has the published ranges that they lie in, with their sources.
"""

from __future__ import annotations

from collections.abc import Mapping


def _rock(
    strength: float,
    abrasiveness: float,
    friction: float,
    threshold_energy: float,
    specific_energy: float | None = None,
) -> Mapping[str, float]:
    """Return a rock whose specific energy is its strength, unless another one is given."""
    return {
        "specific_energy": strength if specific_energy is None else specific_energy,
        "strength": strength,
        "threshold_energy": threshold_energy,
        "abrasiveness": abrasiveness,
        "friction": friction,
    }


ROCKS: Mapping[str, Mapping[str, float]] = {
    # Compacted JSC-1A. Strength and specific energy are assumed: a granular soil has no compressive
    # strength of its own; a compacted one bears some 0.1 MPa under a small bit.
    "regolith": _rock(1e5, 1.0, 0.6, 0.0, specific_energy=5e6),
    "chalk": _rock(10e6, 0.3, 0.4, 0.002),
    "limestone": _rock(50e6, 1.0, 0.5, 0.01),
    "sandstone": _rock(75e6, 2.0, 0.5, 0.02),
    "basalt": _rock(200e6, 3.0, 0.5, 0.05),
}
