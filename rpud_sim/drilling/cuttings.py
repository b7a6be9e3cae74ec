"""Cuttings: how they collect in the flutes, are carried out, and resist the rotation."""

from __future__ import annotations

import math

from rpud_sim.drilling.bit import BitParameters
from rpud_sim.model.elementary import exponential_minus_one


class Cuttings:
    """Volume of cuttings in the flutes of the tool.

    The flutes along the tool in the hole hold their area times its depth. Cuttings come in at the
    bottom at a rate q and rise at a speed v, which rotation and impacts give and friction on the
    wall lowers with depth. They leave at the top:

        dV/dt = q - V v / depth

    with the closed form of an exponential during a step. So the flutes fill up with depth, and
    empty with the rate of rotation. A tool that is drawn back takes with it what its flutes hold
    outside the hole.
    """

    def __init__(self, bit: BitParameters) -> None:
        self._bit = bit
        self.volume = 0.0  # in the hole [m^3]

    def filling(self, depth: float, clogged: float = 0.0) -> float:
        """Return the share of the flutes that is full, from 0 to 1.

        Args:
            clogged: share of their free room that a fault clogs, 0 to 1.
        """
        if depth <= 0.0:
            return 0.0
        full = self.volume / (self._bit.flute_area * depth)
        if full > 1.0:
            full = 1.0
        return full + clogged * (1.0 - full)

    def clearance(self, depth: float, clogged: float = 0.0) -> float:
        """Return the factor on the progress: 1 up to the choke, falling to 0 with full flutes."""
        choke = self._bit.cuttings_choke
        free = (1.0 - self.filling(depth, clogged)) / (1.0 - choke)
        return free if free < 1.0 else 1.0

    def torque(self, depth: float, clogged: float = 0.0) -> float:
        """Return the torque that resists the rotation [N m].

        It is proportional to the depth of the tool in the hole [m] and to the filling (assumed).
        """
        return self._bit.flute_torque * depth * self.filling(depth, clogged)

    def step(
        self,
        produced: float,
        turned: float,
        impacts: float,
        depth: float,
        clearing: float,
    ) -> None:
        """Let cuttings come in and leave during an impact or a part of a turn.

        Args:
            produced: volume of the rock that they come from [m^3].
            clearing: factor on the speed at which cuttings rise, 0 to 1.
        """
        bit = self._bit
        if depth <= 0.0:
            self.volume = 0.0
            return
        turns = turned / (2.0 * math.pi)
        risen = bit.flute_efficiency * bit.flute_pitch * turns + bit.cuttings_lift * impacts
        risen *= clearing / (1.0 + depth / bit.flute_transport_depth)
        came = bit.cuttings_bulking * produced
        share = risen / depth  # V v / depth over the step, in units of V
        if share > 0.0:
            left = -exponential_minus_one(-share)
            self.volume += (came / share - self.volume) * left
        else:
            self.volume += came
        # The flutes hold no more; what is beyond is pressed into the wall.
        most = bit.flute_area * depth
        if self.volume > most:
            self.volume = most

    def withdraw(self, before: float, after: float) -> None:
        """Take out what the flutes hold along the way when the tool is drawn back."""
        self.volume *= after / before if before > 0.0 else 0.0
