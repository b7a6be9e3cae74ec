"""Simulation of the drill under commands and faults."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from rpud_sim.drilling.process import ProcessState
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.engine import Buffers
from rpud_sim.model.parameters import Parameters
from rpud_sim.simulation.actuator import ActuatorReading
from rpud_sim.simulation.block import Block, join_blocks
from rpud_sim.simulation.changes import Change, Clear, Inject, Schedule, journal_form
from rpud_sim.simulation.commands import (
    Applied,
    Command,
    Drive,
    DriveChange,
    Motion,
    MountMotion,
    WeightOnBit,
    slot,
)
from rpud_sim.simulation.configuration import Configuration, to_values, whole_configuration
from rpud_sim.simulation.energy_account import FeedAccount
from rpud_sim.simulation.faults import (
    Fault,
    FaultError,
    FaultLedger,
    check_supported,
    effects_of,
    supported_kinds,
)
from rpud_sim.simulation.plan import Journal
from rpud_sim.simulation.plant import Plant, rpud_constants

# Refusals that are kept until they are drained; the oldest are dropped.
_MOST_REFUSALS = 100


class Simulation:
    """One drill, from simulation time zero on.

    Changes come between two calls of ``advance_to``, or by themselves: ``planned`` faults and
    commands act, and faults end, at their exact instants, however the simulation is advanced. Times
    are integer nanoseconds of simulation time.

    Weight on bit and nominal drive of the configuration apply until the first command. The journal
    gets an entry for each change from outside; changes that come by themselves follow from these.
    With shared ``buffers`` a block is valid until the next advance of any simulation that has them.
    """

    def __init__(
        self,
        configuration: Configuration | Parameters,
        initial_phase: float = 0.0,
        planned: Sequence[Change] = (),
        journal: Journal | None = None,
        buffers: Buffers | None = None,
    ) -> None:
        configuration = whole_configuration(configuration)
        parameters = configuration.parameters
        drive = configuration.nominal_drive
        self.configuration = configuration  # in force, without faults; read-only
        self._journal = journal
        self._first_specific_energy = configuration.rock.rock_specific_energy
        # commands in force, read-only
        rest = configuration.mount.rest if configuration.has_feed else None
        self.applied = Applied(WeightOnBit(parameters.weight_on_bit), 0, drive, 0, rest)
        self._plant = Plant(configuration, initial_phase, drive, buffers)
        self._rpud = rpud_constants(parameters, self._plant.actuator.resonance)
        self._drawn = 0.0  # electrical energy up to the last block [J]
        self._fed = FeedAccount() if configuration.has_feed else None  # up to the last block
        self.faults = FaultLedger()  # read-only
        self._schedule = Schedule(planned)  # of changes that come by themselves
        self._refusals: deque[str] = deque(maxlen=_MOST_REFUSALS)
        for change in planned:
            if isinstance(change.action, Inject):
                try:
                    check_supported(change.action.fault, configuration)
                except FaultError as error:
                    raise FaultError(f"{change.place}{error}") from None

    @property
    def parameters(self) -> Parameters:
        """Parameters in force, without faults."""
        return self.configuration.parameters

    @property
    def time(self) -> int:
        return self._plant.time

    @property
    def impact_count(self) -> int:
        """Impacts on the drill tool that have begun."""
        return self._plant.engine.impact_count

    @property
    def actuator(self) -> ActuatorReading:
        """State of the actuator at the present time, without commands since the last advance."""
        return self._plant.reading

    @property
    def unloaded_amplitude(self) -> float:
        """Amplitude of a resonant vibration without load, on resonance [m]; 0 without one."""
        return self._plant.actuator.unloaded_amplitude

    @property
    def depth(self) -> float:
        """Depth of the hole [m]; NaN without strata and without a rock model."""
        depth = self._plant.process.depth
        return self._plant.progress.depth if depth is None else depth

    @property
    def at_tool_length(self) -> bool:
        """Whether the hole is as deep as the drill tool is long, and gets no deeper."""
        return self.depth >= self.parameters.tool_length

    @property
    def penetration_rate(self) -> float:
        """Mean rate over the last second [m/s]; NaN without strata and without a rock model."""
        if (borehole := self.process.borehole) is not None:
            return borehole.penetration_rate
        return self._plant.progress.penetration_rate(self.time)

    @property
    def process(self) -> ProcessState:
        """State of rotation, feed and borehole at their last step."""
        return self._plant.process.state

    @property
    def weight_on_bit(self) -> float:
        """Force of the load spring: commanded, or as it follows from the feed [N]."""
        mount = self._plant.process.mount
        return mount.weight_on_bit if mount else self.applied.weight_on_bit.force

    @property
    def next_scheduled(self) -> int:
        """Time of the next change that comes by itself [ns]; ``NEVER`` if none is left."""
        return self._schedule.next

    def drain_refusals(self) -> list[str]:
        """Return why planned changes did not come, since the last call."""
        refusals = list(self._refusals)
        self._refusals.clear()
        return refusals

    def advance_to(self, time: int) -> Block:
        """Advance to a time [ns] and return what happened since the last call."""
        start = self.time
        if time < start:
            raise ValueError(f"time {time} ns is before the present {start} ns")
        while (stop := min(self._plant.next_step, self.next_scheduled)) <= time:
            self._plant.advance_to(stop)
            if self.next_scheduled <= stop:
                self._carry_out_due()
        self._plant.advance_to(time)
        reading = self._plant.reading
        drawn, self._drawn = reading.electrical_energy - self._drawn, reading.electrical_energy
        covering, impacts = self._plant.drain()
        feed, fed = self._plant.feed_account(covering[-1:]), self._fed
        if feed is not None and fed is not None:
            self._fed, feed = feed, feed - fed
        return Block(
            start,
            np.array([time], np.int64),
            covering,
            impacts,
            np.array([len(covering) - 1], np.int64),
            np.array([len(impacts)], np.int64),
            self._rpud,
            drawn,
            (reading,),
            (self.process,),
            () if feed is None else (feed,),
        )

    def advance_through(self, ends: np.ndarray) -> Block:
        """Advance to times one after the other; the block has a part up to each of them.

        The result is that of ``advance_to`` for each of ``ends``, which ascend from after the
        present time [ns]. Without a scheduled change before the last one, it takes one call of the
        engine.
        """
        start = self.time
        if min(self._plant.next_step, self.next_scheduled) > ends[-1]:
            reached = self._plant.advance_through(ends)
            if reached is not None:
                # The actuator has no power here, and nothing changes what it reads.
                covering, impacts = self._plant.drain()
                readings = (self._plant.reading,) * len(ends)
                return Block(
                    start, ends, covering, impacts, *reached, self._rpud, math.nan, readings
                )
        return join_blocks([self.advance_to(end) for end in ends.tolist()])

    def apply(self, command: Command | DriveChange) -> None:
        """Put a command into force at the present time.

        The nodal plane's position and velocity and the phase of the vibration stay continuous; a
        new amplitude takes effect when the vibration next passes through zero displacement. A
        command that is in force already changes nothing: it has no entry in the journal, and its
        time stays.
        """
        before = self.applied
        if isinstance(command, DriveChange):
            command = command.on(before.drive)
        elif isinstance(command, MountMotion):
            command = command.acting(self.time)
        acting = command.after(before.drive) if isinstance(command, Drive) else command
        self.configuration.check(acting)
        kind = slot(acting)
        if acting == getattr(before, kind):
            return  # a controller may repeat it 100 times a second
        if isinstance(acting, WeightOnBit):
            self._plant.weight_on_bit = acting.force
        elif isinstance(acting, Motion):
            if (mount := self._plant.process.mount) is not None:
                mount.motion = acting
        else:
            self._plant.actuator.drive(acting)
        changed: dict[str, Any] = {kind: acting, f"{kind}_time": self.time}
        self.applied = dataclasses.replace(before, **changed)
        self.record(*journal_form(command))

    def configure(self, configuration: Configuration) -> None:
        """Put other parameters into force at the present time; positions and velocities go on.

        The actuator is the same, and the rock but for its specific energy. Weight on bit and
        nominal vibration change by command alone.
        """
        self.configuration = configuration
        self._change_effects()
        self.record("configure", {"parameters": to_values(configuration)})

    def inject(self, fault: Fault, duration: int = 0) -> int:
        """Let a fault begin now, end after a duration [ns], 0 for never, and return its number."""
        number = self._inject(fault, duration)
        self.record(*journal_form(Inject(fault, duration)))
        return number

    def clear(self, number: int = 0, kind: str = "", channel: str = "") -> None:
        """Let a fault end, by its number or by kind and channel; without any of them all."""
        if kind:
            own = [
                r for r in self.faults.active if (r.fault.kind, r.fault.channel) == (kind, channel)
            ]
            if not own:
                raise FaultError(f"there is no {Fault(kind, channel)} to clear")
            number = own[0].number
        if number:
            fault = self.faults.clear(self.time, number).fault
            ended = Clear(number, fault.kind, fault.channel)
        else:
            self.faults.clear_all(self.time)
            ended = Clear()
        self._change_effects()
        self.record(*journal_form(ended))

    def record(self, kind: str, content: Mapping[str, Any] = MappingProxyType({})) -> None:
        """Append an entry to the journal, if there is one."""
        if self._journal is not None:
            self._journal.record(self.time, kind, content)

    def supported_kinds(self) -> tuple[str, ...]:
        return supported_kinds(self.configuration)

    def _inject(self, fault: Fault, duration: int) -> int:
        check_supported(fault, self.configuration)
        number = self.faults.inject(self.time, fault)
        if duration:
            self._schedule.add(Change(self.time + duration, Clear(number)), first=True)
        self._change_effects()
        return number

    def _carry_out_due(self) -> None:
        for change in self._schedule.due(self.time):
            action = change.action
            try:
                if isinstance(action, Inject):
                    self._inject(action.fault, action.duration)
                elif isinstance(action, Clear):
                    if any(record.number == action.number for record in self.faults.active):
                        self.faults.clear(self.time, action.number)
                        self._change_effects()
                elif isinstance(action, Command | DriveChange):
                    self.apply(action)
            except ParameterError as error:
                self._refusals.append(f"planned change refused: {change.place}{error}")

    def _change_effects(self) -> None:
        active = [record.fault for record in self.faults.active]
        hardness = 1.0
        if self.configuration.strata.found is None:
            energy = self.configuration.rock.rock_specific_energy
            hardness = energy / self._first_specific_energy
        self._plant.change(effects_of(active, self.parameters, hardness))
