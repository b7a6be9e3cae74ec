"""Process of drilling: rotation, feed and borehole, one step each millisecond or more."""

from __future__ import annotations

import dataclasses
import math

from rpud_sim.drilling.borehole import Borehole, BoreholeState
from rpud_sim.drilling.inputs import Disturbances, Percussion
from rpud_sim.drilling.mount import Mount, MountState
from rpud_sim.drilling.rotor import NO_RESISTANCE, NOT_TURNED, Rotor, RotorState
from rpud_sim.foundation.time import NEVER, SECOND


@dataclasses.dataclass(frozen=True)
class ProcessState:
    """State of the slow processes at their last step, immutable."""

    time: int = 0  # time of that step [ns]
    rotation: RotorState | None = None  # state of the rotor; None without rotation
    mount: MountState | None = None  # state of feed and mount; None without a feed
    # state of the hole; None without strata, and without rotation in a rock
    borehole: BoreholeState | None = None


# State where there is nothing to step.
AT_REST = ProcessState()


# Greatest rate of the load spring of an arm, over the RPUD's mass [1/s^2].
STIFFEST = 500.0**2
# The same of an arm with steps of the whole interval.
_SOFT = 62.5**2


def parts_of(stiffness: float) -> int:
    """Return into how many steps the interval is divided: 1, 2, 4 or 8.

    The stiffness is the rate of an arm's load spring over the RPUD's mass [1/s^2], 0 without an
    arm. In a step the RPUD on its load spring turns by at most a sixteenth of a radian.
    """
    parts = 1
    while parts < 8 and stiffness > _SOFT * parts * parts:
        parts *= 2
    return parts


class Process:
    """Slow processes around the percussion, from time zero on.

    Times are integer nanoseconds of simulation time.
    """

    # A step is at each whole multiple of this, or of its half, quarter or eighth [ns], so that
    # steps do not depend on how the simulation is advanced.
    interval = 1_000_000

    def __init__(
        self,
        rotor: Rotor | None,
        mount: Mount | None,
        borehole: Borehole | None,
        stiffness: float = 0.0,
    ) -> None:
        self._rotor, self._borehole = rotor, borehole
        self.mount = mount  # None without a feed: weight on bit and regime are commanded
        self._parts = parts_of(stiffness)  # parts of the interval
        self.next_step = NEVER  # [ns]
        self._time = 0  # time of the last step [ns]
        if rotor or mount or borehole:
            self.next_step = self.interval // self._parts

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

    @property
    def length(self) -> float:
        """Duration of the step that comes next [s]."""
        return (self.next_step - self._time) / SECOND

    def end_step(self, time: int) -> bool:
        """Let the current step end at a time [ns]; return whether it has begun before."""
        if time <= self._time:
            return False
        self.next_step = time
        return True

    def set_spring_stiffness(self, stiffness: float) -> None:
        """Step from the next step on as a load spring needs; its rate over the RPUD's mass."""
        self._parts = parts_of(stiffness)

    def step(
        self, percussion: Percussion, disturbances: Disturbances, spring_rate: float, bottom: float
    ) -> None:
        """Make one step, with a load spring of a rate [N/m].

        ``bottom`` is of the hole by percussion alone [m], where there are no strata; infinite
        without rock.
        """
        interval = self.length
        mount, borehole = self.mount, self._borehole
        turned = NOT_TURNED
        if self._rotor:
            resistance = NO_RESISTANCE
            if borehole:
                resistance = borehole.resistance(percussion, disturbances)
            turned = self._rotor.step(interval, percussion.amplitude_ratio, resistance)
        if borehole:
            position = mount.position if mount else None
            borehole.step(interval, percussion, turned, position, disturbances)
            if bottom < math.inf:
                bottom = borehole.bottom
        if mount:
            mount.step(self.next_step, interval, bottom, percussion, spring_rate, disturbances)
        self._time = self.next_step
        interval = self.interval // self._parts
        self.next_step += interval - self.next_step % interval
