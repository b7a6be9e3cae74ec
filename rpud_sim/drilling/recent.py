"""Recent drilling: penetration rate and specific energy over the last second."""

from __future__ import annotations

import math
from array import array

# The means go over this time [s].
WINDOW = 1.0


class RecentDrilling:
    """Depth and energy after each of the last steps, from which means over a second follow."""

    def __init__(self) -> None:
        # Rings of time [s], depth [m] and energy [J]; arrays, so that copies are cheap.
        self._times, self._depths, self._energies = (array("d", bytes(8)) for _ in range(3))
        self._now = 0

    def add(self, interval: float, depth: float, energy: float) -> None:
        """Add a step.

        Args:
            depth: of the hole at its end [m].
            energy: spent on drilling up to then [J].
        """
        time = self._times[self._now] + interval
        steps = len(self._times)
        if (steps - 0.5) * interval < WINDOW:
            self._now += 1
            self._times.append(time)
            self._depths.append(depth)
            self._energies.append(energy)
            return
        self._now = (self._now + 1) % steps
        self._times[self._now] = time
        self._depths[self._now] = depth
        self._energies[self._now] = energy

    def _change_of(self, ring: array[float]) -> float:
        return ring[self._now] - ring[(self._now + 1) % len(ring)]

    @property
    def penetration_rate(self) -> float:
        """Mean rate of penetration [m/s]."""
        time = self._change_of(self._times)
        return self._change_of(self._depths) / time if time > 0.0 else 0.0

    def specific_energy(self, area: float) -> float:
        """Return energy over volume [J/m^3], after Teale (1965); NaN if there was no progress.

        e = F / A + 2 pi N T / (A u), to which the energy of the impacts is added: the mean of force
        times way, torque times angle and energy of impacts, over the volume of the hole.
        """
        deeper = self._change_of(self._depths)
        return self._change_of(self._energies) / (area * deeper) if deeper > 0.0 else math.nan
