"""The model under commands: advance to a time, take what happened, change what acts."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from rpud_sim.model.drill import Drill, derive
from rpud_sim.model.engine import Engine
from rpud_sim.model.parameters import Parameters
from rpud_sim.model.records import join
from rpud_sim.model.segment import IMPACT, SEGMENT
from rpud_sim.simulation.commands import (
    NOMINAL_VOLTAGE,
    Applied,
    Drive,
    WeightOnBit,
    vibration_amplitude,
)
from rpud_sim.simulation.sampling import NANOSECONDS, Samples, Times, sample

DEFAULT_NOMINAL_VOLTAGE = 100.0  # assumed; the paper gives the amplitude alone [V]


@dataclasses.dataclass(frozen=True)
class Block:
    """What happened between two times, immutable.

    Times are integer nanoseconds of simulation time.

    Args:
        start: beginning of the block.
        end: its end.
        covering: the ``SEGMENT`` records that cover the block, in order, without a gap. The last
            one is open: its duration is what it will be unless a command comes.
        impacts: the ``IMPACT`` records of the impacts on the drill tool that ended in it, in order.
    """

    start: int
    end: int
    covering: np.ndarray
    impacts: np.ndarray

    @property
    def segments(self) -> np.ndarray:
        """The segments that ended in the block."""
        return self.covering[:-1]

    @property
    def open_segment(self) -> np.ndarray:
        """The segment that was in progress at its end, shape (1,)."""
        return self.covering[-1:]

    def grid(self, rate: int) -> range:
        """Numbers of the samples at a whole rate [Hz] from the block's start on and before its end.

        Blocks that follow each other have every sample once.
        """
        return range(
            -(-self.start * rate // NANOSECONDS),
            -(-self.end * rate // NANOSECONDS),
        )

    def sample(self, times: Times) -> Samples:
        """Sample all channels at ascending times from the block's start to its end."""
        return sample(self.covering, times)


def join_blocks(blocks: Sequence[Block]) -> Block:
    """Return one block for at least one that follow each other."""
    last = blocks[-1]
    return Block(
        blocks[0].start,
        last.end,
        join([*(block.segments for block in blocks), last.open_segment], SEGMENT),
        join([block.impacts for block in blocks], IMPACT),
    )


class Simulation:
    """One drill, from simulation time zero on.

    Args:
        parameters: of the drill; its weight on bit and vibration apply until the first command.
        initial_phase: phase of the vibration at time zero [cycles].
        drive_enabled: whether the actuator is driven from the start.
        nominal_voltage: voltage that gives the parameters' vibration amplitude [V].

    Raises:
        ParameterError: if the nominal voltage is outside its range.
    """

    def __init__(
        self,
        parameters: Parameters,
        initial_phase: float = 0.0,
        drive_enabled: bool = True,
        nominal_voltage: float = DEFAULT_NOMINAL_VOLTAGE,
    ) -> None:
        self._parameters = parameters
        self._nominal_voltage = NOMINAL_VOLTAGE.check("nominal_voltage", nominal_voltage)
        self._drill = derive(parameters)
        self._engine = Engine(parameters, initial_phase, drive_enabled)
        self._time = 0
        self._applied = Applied(
            WeightOnBit(parameters.weight_on_bit),
            0,
            Drive(drive_enabled, self._nominal_voltage, parameters.vibration_frequency),
            0,
        )

    @property
    def parameters(self) -> Parameters:
        """The parameters it was made with."""
        return self._parameters

    @property
    def drill(self) -> Drill:
        """Constants derived from the parameters."""
        return self._drill

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

    def advance_to(self, time: int) -> Block:
        """Advance to a time [ns] and return what happened since the last call.

        Raises:
            ValueError: if the time is before the present one.
        """
        if time < self._time:
            raise ValueError(f"time {time} ns is before the present {self._time} ns")
        seconds, rest = divmod(time, NANOSECONDS)
        self._engine.advance(seconds, rest / NANOSECONDS)
        covering, impacts = self._engine.take_covering()
        block = Block(self._time, time, covering, impacts)
        self._time = time
        return block

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
            after = dataclasses.replace(
                before, weight_on_bit=command, weight_on_bit_time=self._time
            )
        else:
            drive = Drive(
                command.enabled,
                command.voltage if command.enabled or command.voltage else before.drive.voltage,
                command.frequency or before.drive.frequency,
            )
            after = dataclasses.replace(before, drive=drive, drive_time=self._time)
        amplitude = vibration_amplitude(after.drive, self._parameters, self._nominal_voltage)
        self._applied = after
        unchanged = (before.weight_on_bit, before.drive) == (after.weight_on_bit, after.drive)
        if not unchanged:
            seconds, rest = divmod(self._time, NANOSECONDS)
            self._engine.change(
                seconds,
                rest / NANOSECONDS,
                self._drill,
                (after.weight_on_bit.force, amplitude, after.drive.frequency),
            )
