"""Rotor: rotation of the drill tool, driven by friction from the piezoelectric stack."""

from __future__ import annotations

import dataclasses

from rpud_sim.drilling.inputs import Disturbances
from rpud_sim.foundation.parameters import ParameterGroup, choice


@dataclasses.dataclass(frozen=True)
class RotationParameters(ParameterGroup):
    """Parameters of the rotation, in SI units.

    Raises:
        ParameterError: if a value is outside its range.
    """

    rotation_model: str = choice(
        "none",
        ("none", "friction_drive"),
        "none: the tool does not rotate; friction_drive: the stack drives the rotor by friction",
    )


@dataclasses.dataclass(frozen=True)
class Resistance:
    """Torque against the rotation of the drill tool, immutable.

    Args:
        torque: on the bit in the rock [N m].
        flutes: of cuttings in the flutes [N m].
    """

    torque: float = 0.0
    flutes: float = 0.0


@dataclasses.dataclass(frozen=True)
class RotorState:
    """State of the rotor at one time, immutable.

    Args:
        angle: since time zero [rad].
        rate: of rotation [rad/s].
        torque: on the bit [N m].
        drive_torque: of the friction drive [N m].
        stalled: whether the drive cannot turn the tool.
        slipping: whether the drive slips.
    """

    angle: float = 0.0
    rate: float = 0.0
    torque: float = 0.0
    drive_torque: float = 0.0
    stalled: bool = False
    slipping: bool = False


class Rotor:
    """Rotation of the drill tool.

    Attributes:
        state: at the last step.

    Args:
        parameters: of the rotation.
    """

    def __init__(self, parameters: RotationParameters) -> None:
        self._parameters = parameters
        self.state = RotorState()

    def step(
        self,
        interval: float,
        amplitude_ratio: float,
        resistance: Resistance,
        disturbances: Disturbances,
    ) -> RotorState:
        """Turn for one step and return the state at its end.

        Args:
            interval: length of the step [s].
            amplitude_ratio: amplitude of the vibration over its nominal value.
            resistance: torque against the rotation.
            disturbances: faults in force.
        """
        return self.state
