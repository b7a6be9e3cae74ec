"""Values around the rotor: torques against it, its state, and its energies."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple


class Resistance(NamedTuple):
    """Torque against the rotation of the drill tool, immutable and not negative [N m].

    Args:
        cutting: that cuts the rock.
        friction: of the wear flat on the rock.
        flutes: of cuttings in the flutes.
        faults: of binding and of rock that protrudes into the flutes.
        in_hole: whether the wall of a hole surrounds the tool.
    """

    cutting: float = 0.0
    friction: float = 0.0
    flutes: float = 0.0
    faults: float = 0.0
    in_hole: bool = False

    @property
    def total(self) -> float:
        """Sum of all parts [N m]."""
        return self.cutting + self.friction + self.flutes + self.faults


NO_RESISTANCE = Resistance()


@dataclasses.dataclass(frozen=True)
class RotorWork:
    """Work of the rotation since time zero, immutable [J].

    The work of the drive is the sum of cutting, friction, flutes, faults and kinetic energy.

    Args:
        drive: of the drive on the rotor.
        slip: lost in the sliding contact between stack and rotor; the stack gives it in addition.
        cutting: that cut the rock.
        friction: of the wear flat on the rock.
        flutes: on cuttings in the flutes.
        faults: against binding, gravel and rock that protrudes into the flutes.
        kinetic: energy of the rotation now.
    """

    drive: float = 0.0
    slip: float = 0.0
    cutting: float = 0.0
    friction: float = 0.0
    flutes: float = 0.0
    faults: float = 0.0
    kinetic: float = 0.0

    def to_dict(self) -> dict[str, float]:
        """Return the terms and the residual by name, ready for JSON [J]."""
        return {**dataclasses.asdict(self), "residual": self.residual}

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
    """State of the rotor at one time, immutable.

    Args:
        angle: since time zero [rad].
        rate: of rotation, never negative [rad/s].
        torque: of rock and cuttings on the drill tool, against the rotation [N m].
        drive_torque: of the drive on the rotor [N m].
        stalled: whether the tool stands still although the drive is on.
        slipping: whether the preload of the rotor limits the torque of the drive.
        turned: angle of the last step [rad].
        work: since time zero.
    """

    angle: float = 0.0
    rate: float = 0.0
    torque: float = 0.0
    drive_torque: float = 0.0
    stalled: bool = False
    slipping: bool = False
    turned: float = 0.0
    work: RotorWork = RotorWork()


class Turned(NamedTuple):
    """Rotation in one step as the borehole sees it, immutable.

    Args:
        angle: of the step [rad].
        torque: of rock and cuttings on the drill tool, against the rotation [N m].
        friction: work of the wear flat on the rock since time zero [J].
        resisted: work against everything that resists the rotation since time zero [J].
    """

    angle: float = 0.0
    torque: float = 0.0
    friction: float = 0.0
    resisted: float = 0.0


NOT_TURNED = Turned()
