"""Plant: engine, actuator and rock, which advance together under commands and conditions."""

from __future__ import annotations

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.drill import derive
from rpud_sim.model.engine import Engine
from rpud_sim.model.segment import IMPACT, SEGMENT, join_records
from rpud_sim.simulation.actuator import Actuator
from rpud_sim.simulation.commands import Drive
from rpud_sim.simulation.conditions import Conditions
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.rock import Progress


class Plant:
    """Motion of the drill, amplitude of its actuator and depth of its hole, from time zero on.

    Times are integer nanoseconds of simulation time.

    Args:
        configuration: at time zero.
        initial_phase: phase of the vibration at time zero [cycles].
        drive: in force from time zero on.
    """

    def __init__(self, configuration: Configuration, initial_phase: float, drive: Drive) -> None:
        parameters = configuration.parameters
        self._time = 0
        self._weight_on_bit = parameters.weight_on_bit
        self._actuator = Actuator(configuration.actuator, parameters.vibration_amplitude, drive)
        self._engine = Engine(parameters, initial_phase, self._actuator.amplitude > 0.0)
        self._progress = Progress(configuration.rock)
        self._conditions = Conditions(parameters)
        self._hardness = 1.0
        self._drill = derive(parameters)
        self._in_force = (self._drill, self._commands())
        self._segments: list[np.ndarray] = []
        self._impacts: list[np.ndarray] = []

    @property
    def time(self) -> int:
        """Simulation time [ns]."""
        return self._time

    @property
    def next_step(self) -> int:
        """Time before which the amplitude stays the same [ns]; it must be stopped at."""
        return self._actuator.next_step

    @property
    def impact_count(self) -> int:
        """Impacts on the drill tool that have begun so far."""
        return self._engine.impact_count

    @property
    def actuator(self) -> Actuator:
        """The actuator, read-only."""
        return self._actuator

    @property
    def depth(self) -> float:
        """Depth of the hole [m]; NaN without a rock model."""
        return self._progress.depth

    @property
    def penetration_rate(self) -> float:
        """Mean rate over the last second [m/s]; NaN without a rock model."""
        return self._progress.penetration_rate(self._time)

    def advance_to(self, time: int) -> None:
        """Advance to a time [ns], not beyond the next step."""
        self._push_to_engine()
        self._engine.advance(*_split(time))
        self._actuator.advance_to(time)
        self._time = time

    def set_weight_on_bit(self, force: float) -> None:
        """Put a weight on bit [N] into force at the present time."""
        self._weight_on_bit = force

    def drive(self, drive: Drive) -> None:
        """Put a drive into force at the present time."""
        self._actuator.drive(self._time, drive)

    def change(self, conditions: Conditions, hardness: float) -> None:
        """Put conditions into force at the present time; positions and velocities go on.

        Args:
            conditions: from now on.
            hardness: factor on the specific energy of the rock at time zero, without faults.
        """
        # Impacts up to now deepen the hole under the conditions so far.
        segments, impacts = self._engine.drain()
        self._make_progress(impacts)
        self._segments.append(segments)
        self._impacts.append(impacts)
        if conditions.resonance_offset != self._conditions.resonance_offset:
            self._actuator.drift(self._time, conditions.resonance_offset)
        self._conditions = conditions
        self._hardness = hardness
        self._drill = derive(conditions.parameters, conditions.jammed)

    def drain(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the segments that cover the time since the last call, and the impacts.

        The last segment is the open one; the first one was open at the last call.
        """
        covering, impacts = self._engine.drain_covering()
        self._make_progress(impacts)
        if self._segments:
            covering = join_records([*self._segments, covering], SEGMENT)
            impacts = join_records([*self._impacts, impacts], IMPACT)
            self._segments.clear()
            self._impacts.clear()
        return covering, impacts

    def _make_progress(self, impacts: np.ndarray) -> None:
        if self._drill.in_rock:
            acting = self._conditions
            self._progress.add(
                impacts, self._hardness * acting.specific_energy_factor, acting.progress_factor
            )

    def _commands(self) -> tuple[float, float, float]:
        weight = self._weight_on_bit * self._conditions.preload_factor
        return weight, self._actuator.amplitude, self._actuator.frequency

    def _push_to_engine(self) -> None:
        """Push what has changed to the engine; no change leaves the trajectory as it is.

        It happens once for each instant, so that the order of changes there makes no difference.
        """
        in_force = (self._drill, self._commands())
        if in_force != self._in_force:
            self._in_force = in_force
            self._engine.change(*_split(self._time), *in_force)


def _split(time: int) -> tuple[int, float]:
    seconds, rest = divmod(time, SECOND)
    return seconds, rest / SECOND
