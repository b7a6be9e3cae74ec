"""Values around the rotor: torques against it, its state, and its energies."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple


class Resistance(NamedTuple):
    """Torque against the rotation of the drill tool, immutable and not negative [N m]."""

    cutting: float = 0.0  # that cuts the rock
    friction: float = 0.0  # of the wear flat on the rock
    flutes: float = 0.0  # of cuttings in the flutes
    faults: float = 0.0  # of binding and of rock that protrudes into the flutes


NO_RESISTANCE = Resistance()


@dataclasses.dataclass(frozen=True)
class RotorWork:
    """Work of the rotation since time zero, immutable [J].

    The work of the drive is the sum of cutting, friction, flutes, faults and kinetic energy.
    """

    drawn: float = 0.0  # taken from the stack: what is above ``drive`` heats their friction
    drive: float = 0.0  # of the drive on the rotor
    cutting: float = 0.0  # that cut the rock
    friction: float = 0.0  # of the wear flat on the rock
    flutes: float = 0.0  # on cuttings in the flutes
    faults: float = 0.0  # against binding and rock that protrudes into the flutes
    kinetic: float = 0.0  # energy of the rotation now

    @property
    def resisted(self) -> float:
        """Work against everything that resists the rotation [J]."""
        return math.fsum((self.cutting, self.friction, self.flutes, self.faults))

    @property
    def residual(self) -> float:
        """Work of the drive less all that became of it [J]; rounding alone."""
        return math.fsum((self.drive, -self.resisted, -self.kinetic))


@dataclasses.dataclass(frozen=True)
class RotorState:
    """State of the rotor at one time, immutable."""

    angle: float = 0.0  # since time zero [rad]
    rate: float = 0.0  # of rotation, never negative [rad/s]
    torque: float = 0.0  # of rock and cuttings on the drill tool, against the rotation [N m]
    drive_torque: float = 0.0  # of the drive on the rotor [N m]
    stalled: bool = False  # whether the tool stands still although the drive is on
    work: RotorWork = RotorWork()  # since time zero


class Turned(NamedTuple):
    """Rotation in one step as the borehole sees it, immutable."""

    angle: float = 0.0  # of the step [rad]
    friction: float = 0.0  # work of the wear flat on the rock [J]
    resisted: float = 0.0  # work against everything that resists the rotation [J]


NOT_TURNED = Turned()
