"""Rock: depth of the hole, from the impacts on the drill tool."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from rpud_sim.foundation.parameters import ParameterGroup, choice, number
from rpud_sim.foundation.time import SECOND

# Said of a hole at its greatest depth.
NO_DEEPER = "the hole is as deep as the drill tool is long: it gets no deeper"
# The penetration rate is the mean over this time [ns].
RATE_WINDOW = SECOND


@dataclasses.dataclass(frozen=True)
class RockParameters(ParameterGroup):
    """Parameters of the rock, in SI units; the defaults are the sandstone of Section V.

    The specific energy is the sandstone's compressive strength, 75 MPa: the least that drilling
    takes, very roughly, after Teale, "The concept of specific energy in rock drilling", Int. J.
    Rock Mech. Min. Sci. 2 (1965) 57-73. The hole has the area of part II of the drill tool. The
    share of the energy is assumed; docs/explanation/rock.md gives its reasons.
    """

    rock_model: str = choice(
        "none",
        ("none", "specific_energy"),
        "whether the hole gets deeper by the impacts' energy",
    )
    rock_specific_energy: float = number(
        75e6,
        "J/m^3",
        "energy that breaks one unit of volume of the rock",
        1e3,
        1e12,
        changeable=True,
    )
    rock_energy_transfer: float = number(
        0.01,
        "",
        "share of the energy that an impact leaves in drill tool and rock, which breaks the rock",
        0.0,
        1.0,
    )
    hole_area: float = number(2.0e-5, "m^2", "cross-sectional area of the hole", 1e-8, 1.0)


class Progress:
    """Depth of the hole, from the impacts on the drill tool while it is in the rock.

    Each impact deepens the hole by the energy that it leaves in drill tool and rock, times the
    share that breaks the rock, over specific energy and area. One after which the free mass has
    taken energy from the drill tool breaks nothing. Without a rock model depth and rate are NaN.

    Args:
        deepest: greatest depth of the hole, the length of the drill tool [m].
    """

    def __init__(self, parameters: RockParameters, deepest: float) -> None:
        self._modelled = parameters.rock_model != "none"
        self._metres_per_joule = parameters.rock_energy_transfer / (
            parameters.rock_specific_energy * parameters.hole_area
        )
        self._deepest = deepest
        self._depth = 0.0 if self._modelled else math.nan
        self._times = np.empty(0, np.int64)
        self._depths = np.empty(0)

    @property
    def depth(self) -> float:
        """Depth of the hole [m]; NaN without a rock model."""
        return self._depth

    def add(self, impacts: np.ndarray, hardness: float = 1.0, clearing: float = 1.0) -> None:
        """Deepen the hole by impacts; the result does not depend on how blocks divide them.

        Args:
            impacts: ``IMPACT`` records, in order, after those of the last call.
            hardness: factor on the specific energy, above 0; greater than 1 in hard rock.
            clearing: factor on the progress, from 0 to 1; less than 1 when cuttings choke the
                hole.
        """
        if not (self._modelled and len(impacts)):
            return
        deeper = np.maximum(impacts["energy_transferred"], 0.0)
        deeper *= self._metres_per_joule * clearing / hardness
        # One after the other: a sum in pairs would depend on the blocks.
        depths = np.add.accumulate(np.concatenate([[self._depth], deeper]))
        depths = np.minimum(depths, self._deepest)
        self._depth = float(depths[-1])
        fractions = np.rint(impacts["fraction"] * SECOND).astype(np.int64)
        self._times = np.concatenate([self._times, impacts["seconds"] * SECOND + fractions])
        self._depths = np.concatenate([self._depths, np.diff(depths)])
        recent = np.searchsorted(self._times, self._times[-1] - RATE_WINDOW, side="right")
        self._times, self._depths = self._times[recent:], self._depths[recent:]

    def penetration_rate(self, time: int) -> float:
        """Return the mean rate over the last second, or the time since zero if shorter [m/s].

        It is NaN without a rock model.

        Args:
            time: the end of that second [ns], not before the last impact.
        """
        if not self._modelled:
            return math.nan
        recent = np.searchsorted(self._times, time - RATE_WINDOW, side="right")
        window = min(time, RATE_WINDOW) / SECOND
        return math.fsum(self._depths[recent:]) / window if window > 0.0 else 0.0
