"""Borehole: depth, cuttings, wear of the bit and temperatures, by percussion and rotation."""

from __future__ import annotations

import dataclasses
import math

from rpud_sim.drilling.inputs import Disturbances, Percussion
from rpud_sim.drilling.rock import RockParameters
from rpud_sim.drilling.rotor import Resistance, RotorState
from rpud_sim.drilling.strata import StrataParameters
from rpud_sim.foundation.parameters import ParameterGroup


@dataclasses.dataclass(frozen=True)
class BitParameters(ParameterGroup):
    """Parameters of the bit, in SI units.

    Raises:
        ParameterError: if a value is outside its range.
    """


@dataclasses.dataclass(frozen=True)
class BoreholeState:
    """State of the borehole at one time, immutable.

    Args:
        depth: of the hole [m]; infinite once the bit has broken through.
        penetration_rate: mean over the last second [m/s].
        layer: name of the layer at the bottom.
        specific_energy: energy for one unit of volume over the last second, after Teale [J/m^3].
        packed_cuttings: volume of cuttings that stay in the hole [m^3].
        bit_wear: 0 for a new bit, 1 for a blunt one.
        bit_temperature: [K].
        rock_temperature: at the bottom [K].
    """

    depth: float = 0.0
    penetration_rate: float = 0.0
    layer: str = ""
    specific_energy: float = math.nan
    packed_cuttings: float = 0.0
    bit_wear: float = 0.0
    bit_temperature: float = math.nan
    rock_temperature: float = math.nan


class Borehole:
    """Borehole in strata.

    Attributes:
        state: at the last step.

    Args:
        bit: its parameters.
        strata: the layers.
        rock: area of the hole, and share of an impact's energy that breaks the rock.
    """

    def __init__(self, bit: BitParameters, strata: StrataParameters, rock: RockParameters) -> None:
        self._bit = bit
        self.state = BoreholeState()

    def resistance(
        self, weight_on_bit: float, in_rock: bool, disturbances: Disturbances
    ) -> Resistance:
        """Return the torque against the rotation of the drill tool.

        Args:
            weight_on_bit: force on the bit [N].
            in_rock: whether the drill tool is in the rock.
            disturbances: faults in force.
        """
        return Resistance()

    def step(
        self,
        interval: float,
        percussion: Percussion,
        rotor: RotorState | None,
        weight_on_bit: float,
        mount_position: float | None,
        disturbances: Disturbances,
    ) -> BoreholeState:
        """Drill for one step and return the state at its end.

        Args:
            interval: length of the step [s].
            percussion: during the step.
            rotor: its state at the end of the step; None without rotation.
            weight_on_bit: force on the bit in the step [N].
            mount_position: at the end of the step, as of ``MountState``; None without a feed.
            disturbances: faults in force.
        """
        return self.state
