"""Inputs of the slow processes: what percussion and faults did since the last step."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple


class Pulses(NamedTuple):
    """Equal pulses of force on the rock, half sines, immutable: means over ``FORCE_WINDOW``."""

    rate: float = 0.0  # [1/s]
    impulse: float = 0.0  # impulse of each [N s]
    duration: float = 0.0  # duration of each [s]


NO_PULSES = Pulses()


class Percussion(NamedTuple):
    """Percussion during one step, immutable."""

    # energy that each impact left in drill tool and rock [J], if it ended in the step
    energies: tuple[float, ...] = ()
    # amplitude of the vibration over its nominal value, at the end of the step
    amplitude_ratio: float = 0.0
    in_rock: bool = False  # whether the drill tool was in the rock at the end of the step
    reacting_force: float = 0.0  # mean force on the mount, away from the rock [N]
    # force on the rock, mean over ``FORCE_WINDOW`` [N]; zero while the tool is not in the rock
    rock_force: float = 0.0
    pulses: Pulses = NO_PULSES  # pulses of impacts, in which most of that force acts
    load_damping: float = 0.0  # c_1 of the load spring [N s/m]
    reach: float = -math.inf  # how far the tip comes until the next step, at most [m]


@dataclasses.dataclass(frozen=True)
class Disturbances:
    """Faults of the slow processes, immutable; by default there are none."""

    hardness: float = 1.0  # factor on the specific energy of the rock
    progress: float = 1.0  # factor on the progress into the rock, 0 to 1
    clearing: float = 1.0  # factor on the transport of cuttings, 0 to 1; the progress follows
    clogged: float = 0.0  # share of the free space in the flutes that cuttings clog, 0 to 1
    # strength of a stone below the bit that is harder than the layer [Pa]; 0 for none
    inclusion_strength: float = 0.0
    extra_torque: float = 0.0  # torque that resists rotation in the flutes [N m]
    feed_stalled: bool = False  # whether the drive of the feed is stopped
    arm_slip_rate: float = 0.0  # rate at which the host slips away from the rock [m/s]
    side_walk: float = 0.0  # rate at which the bit walks sideways at the start of a hole [m/s]
    worn_factor: float = 1.0  # factor on the area of the wear flats of the bit
    # torque of rock in the flutes, along which the tool screws itself in [N m]
    screw_torque: float = 0.0


UNDISTURBED = Disturbances()
