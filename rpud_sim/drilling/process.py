"""Process of drilling: rotation, feed and borehole, one step each millisecond."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from rpud_sim.drilling.borehole import Borehole, BoreholeState
from rpud_sim.drilling.inputs import Disturbances, Percussion
from rpud_sim.drilling.mount import Mount, MountState
from rpud_sim.drilling.rotor import NO_RESISTANCE, NOT_TURNED, Rotor, RotorState
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.foundation.values import Shared


class Surroundings(NamedTuple):
    """What a step needs of the drill besides its percussion, immutable."""

    load_spring_rate: float  # k_1 [N/m]
    has_rock: bool  # whether there is rock; otherwise the tool never touches any
    depth: float = 0.0  # of the hole by percussion alone [m], where there are no strata
    # factor on the specific energy of the rock since time zero, by changes of the parameter
    hardness: float = 1.0


@dataclasses.dataclass(frozen=True)
class ProcessState(Shared):
    """State of the slow processes at their last step, immutable."""

    time: int = 0  # of that step [ns]
    rotation: RotorState | None = None  # state of the rotor; None without rotation
    mount: MountState | None = None  # state of feed and mount; None without a feed
    # state of the hole; None without strata, and without rotation in a rock
    borehole: BoreholeState | None = None


# State where there is nothing to step.
AT_REST = ProcessState()


class Process:
    """Slow processes around the percussion, from time zero on.

    Times are integer nanoseconds of simulation time.
    """

    # A step is at each whole multiple of this [ns], so that steps do not depend on how the
    # simulation is advanced. It is short against the periods of load spring and arm.
    interval = 1_000_000

    def __init__(self, rotor: Rotor | None, mount: Mount | None, borehole: Borehole | None) -> None:
        self._rotor, self._borehole = rotor, borehole
        self.mount = mount  # None without a feed: weight on bit and regime are commanded
        self.next_step = self.interval if rotor or mount or borehole else NEVER  # [ns]
        self._time = 0  # of the last step [ns]

    @property
    def state(self) -> ProcessState:
        return ProcessState(
            self._time,
            self._rotor.state if self._rotor else None,
            self.mount.state if self.mount else None,
            self._borehole.state if self._borehole else None,
        )

    @property
    def depth(self) -> float | None:
        return self._borehole.depth if self._borehole else None

    @property
    def draw(self) -> tuple[float, float]:
        """Power that the rotation takes from the stack [W], and its energy since time zero [J]."""
        return self._rotor.draw if self._rotor else (0.0, 0.0)

    def step(
        self, percussion: Percussion, surroundings: Surroundings, disturbances: Disturbances
    ) -> None:
        interval = self.interval / SECOND
        mount, borehole = self.mount, self._borehole
        if surroundings.hardness != 1.0:
            harder = disturbances.hardness * surroundings.hardness
            disturbances = dataclasses.replace(disturbances, hardness=harder)
        turned = NOT_TURNED
        if self._rotor:
            resistance = NO_RESISTANCE
            if borehole:
                resistance = borehole.resistance(percussion, disturbances)
            turned = self._rotor.step(interval, percussion.amplitude_ratio, resistance)
        bottom = surroundings.depth
        if borehole:
            position = mount.position if mount else None
            borehole.step(interval, percussion, turned, position, disturbances)
            bottom = borehole.bottom
        if mount:
            bottom = bottom if surroundings.has_rock else math.inf
            spring_rate = surroundings.load_spring_rate
            mount.step(interval, bottom, percussion, spring_rate, disturbances)
        self._time = self.next_step
        self.next_step += self.interval
