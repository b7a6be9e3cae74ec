"""Rocks: properties of those that strata may name, with the published ranges that they lie in.

The sources are listed in docs/explanation/drilling.md under these numbers:

1. X. Li et al., the paper: its sandstone has 2360 kg/m^3 and 75 MPa.
2. R. Teale, Int. J. Rock Mech. Min. Sci. 2 (1965) 57-73: the least specific energy of drilling is
   very roughly the crushing strength.
3. T. Richard et al., Engineering Geology 147-148 (2012) 91-100: the specific energy of a sharp
   cutter is the compressive strength, for several hundred rocks.
4. M. J. Selby, Hillslope Materials and Processes, 1993, Table 5.3: strength by class of rock.
5. P. B. Attewell, I. W. Farmer, Principles of Engineering Geology, 1976: strength by rock.
6. X. Zeng et al., J. Aerospace Eng. 23 (2010) 111-116: densities of the simulant JSC-1A.
7. H. Käsling, K. Thuro, Determining abrasivity of rock and soil in the laboratory, 2010: classes of
   the CERCHAR abrasiveness index. Which class a rock belongs to is assumed.
8. M. T. Mellon et al., in The Martian Surface, 2008, Table 18.1: densities of rocks.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping


@dataclasses.dataclass(frozen=True)
class Rock:
    """Properties of a rock, immutable."""

    properties: Mapping[str, float]  # values of the fields of ``Layer`` by name, without its place
    # least and greatest published value by name; a property without one is assumed
    ranges: Mapping[str, tuple[float, float]]
    sources: Mapping[str, tuple[int, ...]]  # numbers of the sources, by property


def _rock(
    strength: float,
    density: float,
    abrasiveness: float,
    friction: float,
    threshold_energy: float,
    ranges: Mapping[str, tuple[float, float]],
    sources: Mapping[str, tuple[int, ...]],
    specific_energy: float | None = None,
) -> Rock:
    """Return a rock whose specific energy is its strength, unless another one is given."""
    least = strength if specific_energy is None else specific_energy
    properties = {
        "specific_energy": least,
        "strength": strength,
        "threshold_energy": threshold_energy,
        "abrasiveness": abrasiveness,
        "density": density,
        "friction": friction,
    }
    return Rock(properties, ranges, sources)


ROCKS: Mapping[str, Rock] = {
    # Compacted JSC-1A. Strength and specific energy are assumed: a granular soil has no compressive
    # strength of its own; a compacted one bears some 0.1 MPa under a small bit.
    "regolith": _rock(
        strength=1e5,
        specific_energy=5e6,
        density=1800.0,
        abrasiveness=1.0,
        friction=0.6,
        threshold_energy=0.0,
        ranges={"density": (1566.0, 2027.0)},
        sources={"density": (6,)},
    ),
    "chalk": _rock(
        strength=10e6,
        density=1900.0,
        abrasiveness=0.3,
        friction=0.4,
        threshold_energy=0.002,
        ranges={
            "strength": (1e6, 25e6),
            "specific_energy": (1e6, 25e6),
            "abrasiveness": (0.1, 0.4),
        },
        sources={"strength": (4,), "specific_energy": (2, 3), "abrasiveness": (7,)},
    ),
    "limestone": _rock(
        strength=50e6,
        density=2300.0,
        abrasiveness=1.0,
        friction=0.5,
        threshold_energy=0.01,
        ranges={
            "strength": (30e6, 250e6),
            "specific_energy": (30e6, 250e6),
            "abrasiveness": (1.0, 1.9),
        },
        sources={"strength": (5,), "specific_energy": (2, 3), "abrasiveness": (7,)},
    ),
    "sandstone": _rock(
        strength=75e6,
        density=2360.0,
        abrasiveness=2.0,
        friction=0.5,
        threshold_energy=0.02,
        ranges={
            "strength": (20e6, 170e6),
            "specific_energy": (20e6, 170e6),
            "density": (2310.0, 2360.0),
            "abrasiveness": (2.0, 3.9),
        },
        sources={
            "strength": (1, 4, 5),
            "specific_energy": (1, 2, 3),
            "density": (1, 8),
            "abrasiveness": (7,),
        },
    ),
    "basalt": _rock(
        strength=200e6,
        density=2900.0,
        abrasiveness=3.0,
        friction=0.5,
        threshold_energy=0.05,
        ranges={
            "strength": (100e6, 300e6),
            "specific_energy": (100e6, 300e6),
            "density": (2900.0, 2900.0),
            "abrasiveness": (2.0, 3.9),
        },
        sources={
            "strength": (4, 5),
            "specific_energy": (2, 3),
            "density": (8,),
            "abrasiveness": (7,),
        },
    ),
}
