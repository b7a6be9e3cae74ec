"""Simulation of the drill: its plant, the commands active and the faults."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from rpud_sim.drilling.process import ProcessState
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.engine import Buffers
from rpud_sim.model.parameters import Parameters
from rpud_sim.simulation.actuator import ActuatorReading
from rpud_sim.simulation.block import Block, join_blocks
from rpud_sim.simulation.changes import Clear
from rpud_sim.simulation.commands import ActiveCommands, Command, Drive, Motion, WeightOnBit, slot
from rpud_sim.simulation.configuration import Configuration, with_defaults
from rpud_sim.simulation.energy_account import FeedAccount
from rpud_sim.simulation.faults import (
    Fault,
    FaultLedger,
    check_supported,
    effects_of,
    supported_kinds,
)
from rpud_sim.simulation.plant import Plant, rpud_constants


class Simulation:
    """One drill, from simulation time zero on; only a ``Run`` changes it.

    It can be read, and advanced where nothing changes. Times are integer nanoseconds of simulation
    time. Weight on bit and nominal drive of the configuration apply until the first command. With
    shared ``buffers`` a block is valid until the next advance of any simulation that has them.
    """

    def __init__(
        self,
        configuration: Configuration | Parameters,
        initial_phase: float = 0.0,
        buffers: Buffers | None = None,
    ) -> None:
        configuration = with_defaults(configuration)
        parameters = configuration.parameters
        drive = configuration.nominal_drive
        self.configuration = configuration  # active, without faults; read-only
        self._first_specific_energy = configuration.rock.rock_specific_energy
        # commands active, read-only
        rest = configuration.mount.rest if configuration.has_feed else None
        self.applied = ActiveCommands(WeightOnBit(parameters.weight_on_bit), 0, drive, 0, rest)
        self._plant = Plant(configuration, initial_phase, drive, buffers)
        self._rpud = rpud_constants(parameters, self._plant.actuator.resonance)
        self._block_start = 0  # end of the last block [ns]
        self._drawn = 0.0  # electrical energy up to the last block [J]
        # account up to the last block
        self._fed = FeedAccount() if configuration.has_feed else None
        self.faults = FaultLedger()  # read-only

    @property
    def parameters(self) -> Parameters:
        """Parameters active, without faults."""
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
        """State of the actuator at the current time, without commands since the last advance."""
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

    def move_to(self, time: int) -> None:
        """Advance to a time [ns] within the current block."""
        if time < self.time:
            raise ValueError(f"time {time} ns is before the current {self.time} ns")
        while (step := self._plant.next_step) <= time:
            self._plant.advance_to(step)
        if self.time < time:  # or changes at one instant would act one by one
            self._plant.advance_to(time)

    def advance_to(self, time: int) -> Block:
        """Advance to a time [ns], end the block, and return it."""
        self.move_to(time)
        self._plant.advance_to(time)
        reading = self._plant.reading
        drawn, self._drawn = reading.electrical_energy - self._drawn, reading.electrical_energy
        covering, impacts = self._plant.drain()
        feed, fed = self._plant.feed_account(covering[-1:]), self._fed
        if feed is not None and fed is not None:
            self._fed, feed = feed, feed - fed
        start, self._block_start = self._block_start, time
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
            self.depth,
        )

    def advance_through(self, ends: np.ndarray) -> Block:
        """Advance to times one after the other; the block has a part up to each of them.

        The result is as if ``advance_to`` were called for each of ``ends``, which ascend from after
        the current time [ns]. Without a step of the plant before the last one, it takes one call of
        the engine.
        """
        start = self._block_start
        if self._plant.next_step > ends[-1] and start == self.time:
            reached = self._plant.advance_through(ends)
            if reached is not None:
                # The actuator has no power here, and nothing changes what it reads.
                self._block_start = self.time
                covering, impacts = self._plant.drain()
                readings = (self._plant.reading,) * len(ends)
                return Block(
                    *(start, ends, covering, impacts, *reached, self._rpud, math.nan, readings),
                    depth=self.depth,
                )
        return join_blocks([self.advance_to(end) for end in ends.tolist()])

    def check(self, command: Command) -> None:
        """Check that the drill can take a command now; of a drive, one that leaves nothing open."""
        self.configuration.check(command)
        if isinstance(command, Motion):
            self._plant.check(command)

    def apply(self, command: Command) -> bool:
        """Apply a command at the current time; return whether it changes anything.

        The nodal plane's position and velocity and the phase of the vibration stay continuous; a
        new amplitude takes effect when the vibration next passes through zero displacement. A
        command that is active already changes nothing, and its time stays.
        """
        before = self.applied
        acting = command.after(before.drive) if isinstance(command, Drive) else command
        kind = slot(acting)
        if acting == getattr(before, kind):
            return False  # a controller may repeat it 100 times a second
        if isinstance(acting, WeightOnBit):
            self._plant.weight_on_bit = acting.force
        elif isinstance(acting, Motion):
            self._plant.move(acting)
        else:
            self._plant.actuator.drive(acting)
        changed: dict[str, Any] = {kind: acting, f"{kind}_time": self.time}
        self.applied = dataclasses.replace(before, **changed)
        return True

    def configure(self, configuration: Configuration) -> None:
        """Apply other parameters at the current time; positions and velocities continue.

        The actuator is the same, and the rock but for its specific energy. Weight on bit and
        nominal vibration change by command alone.
        """
        self.configuration = configuration
        self._change_effects()

    def inject(self, fault: Fault) -> int:
        """Let a fault begin now, and return its number."""
        check_supported(fault, self.configuration)
        number = self.faults.inject(self.time, fault)
        self._change_effects()
        return number

    def clear(self, which: Clear) -> Clear:
        """Let a fault end, by kind and channel or by its number, or all; return which it was."""
        number = which.number
        if which.kind:
            fault = Fault(which.kind, which.channel)
            own = [r for r in self.faults.active if str(r.fault) == str(fault)]
            if not own:
                raise ParameterError(f"there is no {fault} to clear")
            number = own[0].number
        if number:
            fault = self.faults.clear(self.time, number).fault
            which = Clear(number, fault.kind, fault.channel)
        else:
            self.faults.clear_all(self.time)
            which = Clear()
        self._change_effects()
        return which

    def supported_kinds(self) -> tuple[str, ...]:
        return supported_kinds(self.configuration)

    def _change_effects(self) -> None:
        active = [record.fault for record in self.faults.active]
        hardness = 1.0
        if self.configuration.strata.found is None:
            energy = self.configuration.rock.rock_specific_energy
            hardness = energy / self._first_specific_energy
        self._plant.change(effects_of(active, self.parameters, hardness))
