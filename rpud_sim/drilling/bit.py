"""Bit: its parameters, and the forces and torques with which it cuts rock."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from rpud_sim.drilling.strata import Layer
from rpud_sim.foundation.parameters import ParameterGroup, number
from rpud_sim.foundation.quantities import ParameterError


@dataclasses.dataclass(frozen=True)
class BitParameters(ParameterGroup):
    """Parameters of the bit and its flutes, in SI units.

    The paper names no bit: all values are assumed unless docs/explanation/drilling.md gives a
    source. The bit has the area of the hole, ``hole_area``.
    """

    bit_thrust_ratio: float = number(
        0.6, "", "thrust over torque force of a sharp cutting edge, zeta", 0.01, 10.0
    )
    bit_shape_factor: float = number(
        1.0, "", "spread of the wear flats over the radius of the bit, gamma", 0.5, 1.5
    )
    bit_wear_flat: float = number(1e-7, "m^2", "area of the wear flats of a new bit", 0.0, 1e-2)
    bit_blunt_flat: float = number(
        1e-6, "m^2", "area of the wear flats of a blunt bit, at which the wear is 1", 1e-12, 1e-2
    )
    bit_wear_rate: float = number(
        3e-7,
        "m/J",
        "growth of the wear flats' diameter by friction work in rock of abrasiveness 1",
        0.0,
        1.0,
    )
    bit_contact_depth: float = number(
        2e-5, "m", "depth of cut at which the wear flats bear on the rock as a whole", 1e-9, 1e-2
    )
    flute_area: float = number(
        8e-6, "m^2", "cross-sectional area of the flutes, which carry the cuttings", 1e-9, 1.0
    )
    flute_pitch: float = number(0.01, "m", "rise of the flutes in one turn", 1e-5, 1.0)
    flute_efficiency: float = number(
        0.3, "", "rise of the cuttings in one turn over the pitch, in a shallow hole", 0.0, 1.0
    )
    flute_transport_depth: float = number(
        0.1, "m", "depth at which friction on the wall halves the rise of the cuttings", 1e-4, 1e3
    )
    flute_torque: float = number(
        0.05, "N m/m", "torque of full flutes for each metre in the hole", 0.0, 1e4
    )
    cuttings_bulking: float = number(
        1.8, "", "volume of the cuttings over that of the rock they come from", 1.0, 5.0
    )
    cuttings_lift: float = number(
        2e-6, "m", "rise of the cuttings by one impact, in a shallow hole", 0.0, 1e-2
    )
    cuttings_choke: float = number(
        0.5, "", "filling of the flutes above which cuttings hold up the progress", 0.0, 0.95
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.bit_blunt_flat > self.bit_wear_flat:
            raise ParameterError(
                f"bit_blunt_flat = {self.bit_blunt_flat:g} m^2 is not above "
                f"bit_wear_flat = {self.bit_wear_flat:g} m^2"
            )


class Cut(NamedTuple):
    """Cut and torques of a bit on the bottom of its hole, immutable."""

    depth: float = 0.0  # of the cut in one turn, if the tool turns [m]
    cutting_torque: float = 0.0  # that cuts the rock [N m]
    friction_torque: float = 0.0  # of the wear flats on the rock [N m]


NO_CUT = Cut()


def cut(
    bit: BitParameters,
    layer: Layer,
    radius: float,
    weight_on_bit: float,
    wear_flat: float,
    hardness: float = 1.0,
) -> Cut:
    """Return how a bit cuts, after Detournay and Defourny (1992).

    With specific energy eps, strength sigma, radius a, depth of cut d, wear flat A_f, d_c the
    contact depth:

        W = zeta eps a d + F_f          T = eps a^2 d / 2 + mu gamma a F_f / 2
        F_f = sigma A_f min(d / d_c, 1)

    so that 2 T / (a^2 d) = (1 - mu gamma zeta) eps + mu gamma W / (a d), their equation for E and
    S. Up to d_c the wear flats come to bear (phase I of Detournay, Richard and Shepherd, 2008);
    beyond it more weight cuts deeper (II).

    Args:
        weight_on_bit: toward the rock [N]; without it there is no cut.
        hardness: factor on specific energy and strength of the rock.
    """
    if not weight_on_bit > 0.0:
        return NO_CUT
    edge = bit.bit_thrust_ratio * layer.specific_energy * hardness * radius  # N for 1 m of cut
    bearing = layer.strength * hardness * wear_flat
    depth = weight_on_bit / (edge + bearing / bit.bit_contact_depth)
    if depth > bit.bit_contact_depth:
        depth = (weight_on_bit - bearing) / edge
    cutting_force = edge * depth
    if cutting_force > weight_on_bit:
        cutting_force = weight_on_bit
    friction_force = weight_on_bit - cutting_force
    return Cut(
        depth,
        0.5 * layer.specific_energy * hardness * radius * radius * depth,
        0.5 * layer.friction * bit.bit_shape_factor * radius * friction_force,
    )


def radius_of(area: float) -> float:
    """Return the radius of a circle [m] of an area [m^2]."""
    return math.sqrt(area / math.pi)
