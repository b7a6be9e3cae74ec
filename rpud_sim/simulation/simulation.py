"""The drill under commands and faults: advance to a time, take what happened, change what acts."""

from __future__ import annotations

import dataclasses
import heapq
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.drill import derive
from rpud_sim.model.engine import Engine
from rpud_sim.model.parameters import Parameters
from rpud_sim.model.records import join
from rpud_sim.model.segment import IMPACT, SEGMENT
from rpud_sim.simulation.actuator import Actuator
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.commands import Applied, Drive, WeightOnBit
from rpud_sim.simulation.conditions import conditions
from rpud_sim.simulation.configuration import Configuration, to_values
from rpud_sim.simulation.faults import Fault, FaultError, check_honoured, honoured_kinds
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.ledger import FaultRecord, Faults
from rpud_sim.simulation.rock import Progress
from rpud_sim.simulation.scenario import Scenario, ScheduledFault

# Refusals that are kept until somebody takes them.
_MOST_REFUSALS = 100


class Simulation:
    """One drill, from simulation time zero on.

    What changes it comes between two calls of ``advance_to``, or is scheduled: faults begin and
    end, and the actuator's amplitude changes, at their exact instants, however the simulation is
    advanced. Times are integer nanoseconds of simulation time.

    Args:
        configuration: of the drill, or its parameters alone; its weight on bit and nominal drive
            apply until the first command.
        initial_phase: phase of the vibration at time zero [cycles].
        scenario: faults that come by themselves.
        journal: told of each change from outside; what is scheduled follows from these.

    Raises:
        FaultError: if a fault of the scenario cannot be honoured.
    """

    def __init__(
        self,
        configuration: Configuration | Parameters,
        initial_phase: float = 0.0,
        scenario: Scenario | None = None,
        journal: Journal | None = None,
    ) -> None:
        if isinstance(configuration, Parameters):
            configuration = Configuration(configuration)
        parameters = configuration.parameters
        drive = Drive(
            configuration.drive_enabled,
            configuration.actuator.nominal_voltage,
            parameters.vibration_frequency,
        )
        self._configuration = configuration
        self._journal = journal
        self._hardness = 1.0
        self._time = 0
        self._applied = Applied(WeightOnBit(parameters.weight_on_bit), 0, drive, 0)
        self._actuator = Actuator(configuration.actuator, parameters.vibration_amplitude, drive)
        self._progress = Progress(configuration.rock)
        self._faults = Faults()
        self._refusals: deque[str] = deque(maxlen=_MOST_REFUSALS)
        self._schedule: list[tuple[int, bool, int, Callable[[], None]]] = []
        self._scheduled = 0
        self._segments: list[np.ndarray] = []
        self._impacts: list[np.ndarray] = []
        self._engine = Engine(parameters, initial_phase, self._actuator.amplitude > 0.0)
        self._conditions = conditions(parameters, ())
        self._drill = derive(parameters)
        self._in_force = (self._drill, self._commands())
        for scheduled in scenario.faults if scenario else ():
            try:
                check_honoured(scheduled.fault, **self._abilities())
            except FaultError as error:
                raise FaultError(f"{scheduled.place}{error}") from None
            self._plan(scheduled)

    @property
    def configuration(self) -> Configuration:
        """The configuration in force, without faults."""
        return self._configuration

    @property
    def parameters(self) -> Parameters:
        """The parameters in force, without faults."""
        return self._configuration.parameters

    @property
    def time(self) -> int:
        """Simulation time [ns]."""
        return self._time

    @property
    def applied(self) -> Applied:
        """The commands in force."""
        return self._applied

    @property
    def impact_count(self) -> int:
        """Impacts on the drill tool that have begun so far."""
        return self._engine.impact_count

    @property
    def actuator(self) -> Actuator:
        """The actuator, to be read."""
        return self._actuator

    @property
    def faults(self) -> Faults:
        """The ledger of faults, to be read."""
        return self._faults

    @property
    def depth(self) -> float:
        """Depth of the hole [m]; NaN without a rock model."""
        return self._progress.depth

    @property
    def penetration_rate(self) -> float:
        """Mean rate over the last second [m/s]; NaN without a rock model."""
        return self._progress.penetration_rate(self._time)

    def take_refusals(self) -> list[str]:
        """Return why scheduled faults did not begin, since the last call."""
        refusals = list(self._refusals)
        self._refusals.clear()
        return refusals

    def advance_to(self, time: int) -> Block:
        """Advance to a time [ns] and return what happened since the last call.

        Raises:
            ValueError: if the time is before the present one.
        """
        if time < self._time:
            raise ValueError(f"time {time} ns is before the present {self._time} ns")
        start = self._time
        while (stop := self._next_stop()) <= time:
            self._go_on_to(stop)
            while self._schedule and self._schedule[0][0] <= stop:
                heapq.heappop(self._schedule)[-1]()
        self._go_on_to(time)
        covering, impacts = self._engine.take_covering()
        self._make_progress(impacts)
        if self._segments:
            covering = join([*self._segments, covering], SEGMENT)
            impacts = join([*self._impacts, impacts], IMPACT)
            self._segments.clear()
            self._impacts.clear()
        return Block(start, time, covering, impacts)

    def apply(self, command: WeightOnBit | Drive) -> None:
        """Put a command into force at the present time.

        The nodal plane's position and velocity and the phase of the vibration stay continuous; a
        new amplitude is taken when the vibration next passes through zero displacement. A command
        that changes nothing leaves the trajectory as it is.

        Raises:
            ParameterError: if the drive would give an amplitude outside its range; nothing changes
                then.
        """
        before = self._applied
        if isinstance(command, WeightOnBit):
            self._applied = dataclasses.replace(
                before, weight_on_bit=command, weight_on_bit_time=self._time
            )
            kind = "weight_on_bit"
        else:
            drive = command.after(before.drive)
            self._actuator.drive(self._time, drive)
            self._applied = dataclasses.replace(before, drive=drive, drive_time=self._time)
            kind = "drive"
        self._note(kind, **dataclasses.asdict(command))

    def configure(self, configuration: Configuration) -> None:
        """Put other parameters into force at the present time; positions and velocities go on.

        Args:
            configuration: with the same actuator, and the same rock but for its specific energy.
                Weight on bit and nominal vibration change by command alone.
        """
        first = self._configuration.rock.rock_specific_energy / self._hardness
        self._collect()
        self._hardness = configuration.rock.rock_specific_energy / first
        self._configuration = configuration
        self._change_conditions()
        self._note("configure", parameters=to_values(configuration))

    def inject(self, fault: Fault, duration: int = 0) -> int:
        """Let a fault begin at the present time and return its number.

        Args:
            fault: what fails.
            duration: after which it ends by itself [ns]; 0 for never.

        Raises:
            FaultError: if it cannot be honoured, or is already there.
        """
        number = self._inject(fault, duration)
        self._note("inject", fault=dataclasses.asdict(fault), duration=duration)
        return number

    def clear(self, number: int) -> FaultRecord:
        """Let a fault end at the present time and return its record.

        Raises:
            FaultError: if there is no such fault.
        """
        record = self._clear(number)
        self._note("clear", number=number)
        return record

    def clear_all(self) -> None:
        """Let all faults end at the present time."""
        self._faults.clear_all(self._time)
        self._change_conditions()
        self._note("clear_all")

    def honoured_kinds(self) -> tuple[str, ...]:
        """Return the kinds of faults that this drill, as it is configured, can honour."""
        return honoured_kinds(**self._abilities())

    def _note(self, kind: str, **content: Any) -> None:
        if self._journal is not None:
            self._journal.note(self._time, kind, **content)

    def _inject(self, fault: Fault, duration: int) -> int:
        check_honoured(fault, **self._abilities())
        number = self._faults.inject(self._time, fault)
        if duration:
            self._at(self._time + duration, False, lambda: self._end(number))
        self._change_conditions()
        return number

    def _clear(self, number: int) -> FaultRecord:
        record = self._faults.clear(self._time, number)
        self._change_conditions()
        return record

    def _at(self, time: int, begins: bool, action: Callable[[], None]) -> None:
        # At one instant ends come before beginnings, each in the order in which it was planned.
        heapq.heappush(self._schedule, (time, begins, self._scheduled, action))
        self._scheduled += 1

    def _plan(self, scheduled: ScheduledFault) -> None:
        def begin() -> None:
            duration = 0 if scheduled.clear is None else scheduled.clear - scheduled.onset
            try:
                self._inject(scheduled.fault, duration)
            except FaultError as error:
                self._refusals.append(f"scheduled fault refused: {scheduled.place}{error}")

        self._at(scheduled.onset, True, begin)

    def _end(self, number: int) -> None:
        if any(record.number == number for record in self._faults.active):
            self._clear(number)

    def _abilities(self) -> dict[str, Any]:
        configuration = self._configuration
        return {
            "regime": configuration.parameters.regime,
            "actuator_model": configuration.actuator.actuator_model,
            "resonance_frequency": configuration.actuator.resonance_frequency,
            "rock_model": configuration.rock.rock_model,
        }

    def _next_stop(self) -> int:
        step = self._actuator.next_step
        return min(step, self._schedule[0][0]) if self._schedule else step

    def _go_on_to(self, time: int) -> None:
        self._tell()
        self._engine.advance(*_split(time))
        self._actuator.advance_to(time)
        self._time = time

    def _collect(self) -> None:
        """Keep what the engine has, so that the progress is made under the conditions so far."""
        segments, impacts = self._engine.take()
        self._segments.append(segments)
        self._impacts.append(impacts)
        self._make_progress(impacts)

    def _make_progress(self, impacts: np.ndarray) -> None:
        if self._drill.in_rock:
            acting = self._conditions
            self._progress.add(
                impacts, self._hardness * acting.specific_energy_factor, acting.progress_factor
            )

    def _change_conditions(self) -> None:
        self._collect()
        active = [record.fault for record in self._faults.active]
        self._conditions = conditions(self._configuration.parameters, active)
        self._drill = derive(self._conditions.parameters, self._conditions.jammed)
        if self._conditions.resonance_offset or self._configuration.actuator.actuator_model == (
            "resonance"
        ):
            self._actuator.drift(self._time, self._conditions.resonance_offset)

    def _commands(self) -> tuple[float, float, float]:
        weight = self._applied.weight_on_bit.force * self._conditions.preload_factor
        return weight, self._actuator.amplitude, self._actuator.frequency

    def _tell(self) -> None:
        """Tell the engine what has changed; what has not leaves the trajectory as it is.

        It is told once for each instant, so that the order of changes there makes no difference.
        """
        in_force = (self._drill, self._commands())
        if in_force != self._in_force:
            self._in_force = in_force
            self._engine.change(*_split(self._time), *in_force)


def _split(time: int) -> tuple[int, float]:
    seconds, rest = divmod(time, SECOND)
    return seconds, rest / SECOND
