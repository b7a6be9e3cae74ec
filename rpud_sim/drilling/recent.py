"""Recent drilling: penetration rate and specific energy over the last second."""

from __future__ import annotations

import math

import numpy as np

# Steps that the means go over: one second of steps of a millisecond.
STEPS = 1000


class RecentDrilling:
    """Depth and energy after each of the last steps, from which means over a second follow."""

    def __init__(self) -> None:
        # A ring of time [s], depth [m] and energy [J]; an array, so that copies are cheap.
        self._ring = np.zeros((STEPS + 1, 3))
        self._steps = 0

    def add(self, interval: float, depth: float, energy: float) -> None:
        """Add a step.

        Args:
            interval: its length [s].
            depth: of the hole at its end [m].
            energy: spent on drilling up to then [J].
        """
        time = self._ring[self._steps % (STEPS + 1), 0] + interval
        self._steps += 1
        self._ring[self._steps % (STEPS + 1)] = time, depth, energy

    def _change(self) -> tuple[float, float, float]:
        now = self._steps % (STEPS + 1)
        first = (self._steps + 1) % (STEPS + 1) if self._steps >= STEPS else 0
        time, deeper, energy = (self._ring[now] - self._ring[first]).tolist()
        return time, deeper, energy

    @property
    def penetration_rate(self) -> float:
        """Mean rate of penetration [m/s]."""
        time, deeper, _ = self._change()
        return deeper / time if time > 0.0 else 0.0

    def specific_energy(self, area: float) -> float:
        """Return energy over volume [J/m^3], after Teale (1965); NaN if there was no progress.

        e = F / A + 2 pi N T / (A u), to which the energy of the impacts is added: the mean of force
        times way, torque times angle and energy of impacts, over the volume of the hole.

        Args:
            area: of the hole [m^2].
        """
        _, deeper, energy = self._change()
        return energy / (area * deeper) if deeper > 0.0 else math.nan
