"""Inputs of the slow processes: what percussion and faults did since the last step."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple


class Percussion(NamedTuple):
    """Percussion during one step, immutable.

    Args:
        impacts: number of impacts on the drill tool that ended in the step.
        energy: that they left in drill tool and rock [J].
        amplitude_ratio: amplitude of the vibration over its nominal value, at the end of the step.
        in_rock: whether the drill tool was in the rock at the end of the step.
        reacting_force: mean force on the mount, away from the rock [N].
    """

    impacts: int = 0
    energy: float = 0.0
    amplitude_ratio: float = 0.0
    in_rock: bool = False
    reacting_force: float = 0.0


@dataclasses.dataclass(frozen=True)
class Disturbances:
    """Faults of the slow processes, immutable; by default there are none.

    Args:
        hardness: factor on the specific energy of the rock.
        progress: factor on the progress into the rock, 0 to 1.
        clearing: factor on the transport of cuttings, 0 to 1; the progress follows.
        clogged: share of the free room in the flutes that cuttings clog, 0 to 1.
        inclusion_strength: of a stone below the bit that is harder than the layer [Pa]; 0 for none.
        torque_factor: on the torque that resists rotation.
        extra_torque: that resists rotation in the flutes [N m].
        feed_stalled: whether the drive of the feed stands still.
        arm_slip_rate: at which the host slips away from the rock [m/s].
        side_walk: at which the bit walks sideways at the start of a hole [m/s].
        worn_factor: on the wear flat of the bit.
        gravel_torque: amplitude of the torque of gravel in the flutes [N m].
        gravel_period: of that torque, in turns of the tool [rad].
        protrusion: of rock into the flutes, along which the tool screws itself in [m].
        preload_factor: on the force of the load spring, 0 to 1.
    """

    hardness: float = 1.0
    progress: float = 1.0
    clearing: float = 1.0
    clogged: float = 0.0
    inclusion_strength: float = 0.0
    torque_factor: float = 1.0
    extra_torque: float = 0.0
    feed_stalled: bool = False
    arm_slip_rate: float = 0.0
    side_walk: float = 0.0
    worn_factor: float = 1.0
    gravel_torque: float = 0.0
    gravel_period: float = 2.0 * math.pi
    protrusion: float = 0.0
    preload_factor: float = 1.0


UNDISTURBED = Disturbances()
