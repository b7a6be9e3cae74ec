"""Process of drilling: rotation, feed and borehole, one step each millisecond."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from rpud_sim.drilling.borehole import BitParameters, Borehole, BoreholeState
from rpud_sim.drilling.inputs import Disturbances, Percussion
from rpud_sim.drilling.mount import Mount, MountParameters, MountState
from rpud_sim.drilling.rock import RockParameters, Strata, StrataParameters, uniform_strata
from rpud_sim.drilling.rotor import NO_RESISTANCE, NOT_TURNED, RotationParameters, Rotor, RotorState
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.foundation.values import Shared


@dataclasses.dataclass(frozen=True)
class DrillingParameters:
    """Parameters of the slow processes, by part."""

    # of the drill tool
    rotation: RotationParameters = dataclasses.field(default_factory=RotationParameters)
    mount: MountParameters = dataclasses.field(default_factory=MountParameters)  # feed and arm
    # layers of the rock
    strata: StrataParameters = dataclasses.field(default_factory=StrataParameters)
    # at the end of the drill tool
    bit: BitParameters = dataclasses.field(default_factory=BitParameters)
    # where there are no strata; area of the hole
    rock: RockParameters = dataclasses.field(default_factory=RockParameters)
    tool_length: float = math.inf  # of the drill tool, which no hole exceeds in depth [m]

    @property
    def layers(self) -> Strata | None:
        """Strata in which a bit is stepped; None without rock, or with percussion in one rock.

        A tool that rotates in the rock of the parameters ``rock_*`` is stepped as well.
        """
        if self.strata.found is not None:
            return self.strata.found
        if self.rotation.rotation_model != "none" and self.rock.rock_model != "none":
            return uniform_strata(self.rock.rock_specific_energy)
        return None

    @property
    def active(self) -> bool:
        rotates = self.rotation.rotation_model != "none"
        return rotates or self.mount.feed_model != "none" or bool(self.strata.strata)


class Surroundings(NamedTuple):
    """What a step needs of the drill besides its percussion, immutable."""

    load_spring_rate: float  # k_1 [N/m]
    has_rock: bool  # whether there is rock; otherwise the tool never touches any
    depth: float = 0.0  # of the hole by percussion alone [m], where there are no strata
    # factor on ``rock_specific_energy`` since time zero, by changes of the parameter
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

    def __init__(self, parameters: DrillingParameters, surroundings: Surroundings) -> None:
        self._next_step = self.interval if parameters.active else NEVER
        rotates = parameters.rotation.rotation_model != "none"
        self._rotor = Rotor(parameters.rotation) if rotates else None
        self._mount: Mount | None = None
        if parameters.mount.feed_model != "none":
            rate = surroundings.load_spring_rate
            self._mount = Mount(parameters.mount, rate, surroundings.has_rock)
        self._borehole: Borehole | None = None
        if (layers := parameters.layers) is not None:
            bit, rock = parameters.bit, parameters.rock
            self._borehole = Borehole(bit, layers, rock, parameters.tool_length)
        self._follows_rock = parameters.strata.found is None
        self._time = 0  # of the last step [ns]

    @property
    def state(self) -> ProcessState:
        return ProcessState(
            self._time,
            self._rotor.state if self._rotor else None,
            self._mount.state if self._mount else None,
            self._borehole.state if self._borehole else None,
        )

    @property
    def next_step(self) -> int:
        return self._next_step

    @property
    def mount(self) -> Mount | None:
        """None without a feed: weight on bit and regime are commanded."""
        return self._mount

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
        mount, borehole = self._mount, self._borehole
        if self._follows_rock and surroundings.hardness != 1.0:
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
        self._time = self._next_step
        self._next_step += self.interval
