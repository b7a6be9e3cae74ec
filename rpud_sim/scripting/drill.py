"""Drill in this process: it is stepped and commanded by a script, without ROS."""

from __future__ import annotations

import copy
import math
import os
import warnings
from types import SimpleNamespace
from typing import Any

from rpud_sim.drilling.mount import POSITION, RATE
from rpud_sim.foundation.quantities import Flag, ParameterError, Quantity, did_you_mean, short_repr
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.verbs import DeclaredAttributes, verb
from rpud_sim.scripting.runs import DrillRun, Faults, GrowingColumns, beginning_of
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.changes import Clear, Inject, parameter_changes
from rpud_sim.simulation.commands import Command, Drive, DriveChange, Feed, MountMotion, WeightOnBit
from rpud_sim.simulation.control import HOLD
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.metrics import Metrics
from rpud_sim.simulation.plan import Beginning, Journal, JournalEntry, Plan
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.scenario_file import DURATION

_LOST = "the drill is put into the safe state, and a moving mount is held"
_STEP = Quantity("s", "a simulation time", 1e-9, 1e6)


class _KeptJournal(Journal):
    def __init__(self) -> None:
        super().__init__()
        self.entries: list[JournalEntry] = []  # all that were drained

    def drain(self) -> list[JournalEntry]:
        drained = super().drain()
        self.entries += drained
        return drained


class Drill(DeclaredAttributes):
    """Drill that a script steps: it has the words of the pytest fixture and of ``DrillClient``.

    ::

        drill = rpud_sim.Drill(weight_on_bit=8)
        drill.press(20)
        drill.step(0.1)
        drill.run["reacting_force"]["force"]

    It has the arguments of ``simulate``. A command takes effect immediately; an invalid value
    raises a ParameterError and changes nothing.
    """

    def __init__(
        self,
        *,
        config: str | os.PathLike[str] | None = None,
        seed: int | None = None,
        faults: Faults | None = None,
        **parameters: Any,
    ) -> None:
        self._begun = (parameters, config, faults)
        self._begin(beginning_of(parameters, config, seed, faults))

    def _begin(self, beginning: Beginning) -> None:
        compile_kernels(beginning.settings.configuration)
        self._journal = _KeptJournal()
        self._block: Block | None = None  # the latest one
        self._blocks: list[Block] = []  # of the latest step
        self._swings = False  # whether a mount that swings was warned of
        self._seen: tuple[int, int] = (-1, 0)
        self._growing = GrowingColumns()
        self._run = Run(Plan(beginning), self._journal, wanted=None, on_block=self._keep)
        self._run.begin(0)
        self._run.take_over()

    @property
    def time(self) -> float:
        """Simulation time [s]."""
        return self._run.time / SECOND

    @property
    def status(self) -> SimpleNamespace:
        """Status now, with the fields of ``rpud_msgs/Status``."""
        return SimpleNamespace(**self._run.status("paused").fields)

    @property
    def run(self) -> DrillRun:
        """The run so far: metrics, topics, waveforms, plots."""
        self._journal.drain()
        seen = (self._run.time, self._journal.count)
        if seen != self._seen:
            self._seen = seen
            plan = Plan.of(self._journal.entries)
            self._so_far = DrillRun(plan, self._run.time, growing=self._growing)
        return self._so_far

    def now(self) -> dict[str, float]:
        """Return positions [m], velocities [m/s] and forces [N] at the current time, by channel.

        They are from the end of the latest step; before the first one there are none.
        """
        if self._block is None:
            return {}
        samples = self._block.sample_ends()
        return {name: float(values[-1]) for name, values in vars(samples).items()}

    @property
    def reacting_force(self) -> float:
        """Mean force on the mount in the latest step, away from the rock [N]; NaN before it."""
        metrics = Metrics()
        for block in self._blocks:
            metrics.add(block)
        found = metrics.values()["reacting_force_mean"]
        return math.nan if found is None else found

    @property
    def torque(self) -> float:
        """Torque of the rotation on the mount, about the axis toward the rock [N m]; 0 without."""
        rotation = self._run.simulation.process.rotation
        return 0.0 if rotation is None else -rotation.drive_torque

    @property
    def mount_impedance(self) -> tuple[float, float]:
        """Stiffness [N/m] and damping [N s/m] of the drill at a given mount; NaN without.

        Within a step the force on the mount grows by them with its distance toward the rock and
        its velocity. A simulator that takes the force implicitly stays stable with a light mount.
        """
        mount = self._run.simulation.process.mount
        return (math.nan, math.nan) if mount is None else (mount.stiffness, mount.damping)

    def step(self, seconds: float) -> float:
        """Advance, and return the simulation time that is reached [s]."""
        until = self._run.time + round(_STEP.check("step", seconds) * SECOND)
        self._blocks.clear()
        lost = self._run.commands_lost
        self._run.finish(until)
        self._run.watch()
        if self._run.commands_lost and not lost:
            after = self._run.settings.command_timeout or HOLD / SECOND
            warnings.warn(f"no command for {after:g} s: {_LOST}", stacklevel=2)
        return self.time

    def reset(self, seed: int | None = None) -> None:
        """Begin again at time zero, as at the start; None for the current seed."""
        parameters, config, faults = self._begun
        seed = self._run.settings.seed_or_none if seed is None else seed
        self._begin(beginning_of(parameters, config, seed, faults))

    # Commands: they act from now on.

    @verb
    def press(self, force: float) -> None:
        self._command(WeightOnBit(force))

    @verb
    def drive(
        self, enabled: bool = True, voltage: float | None = None, frequency: float | None = None
    ) -> None:
        if Flag("").check("drive enabled", enabled):
            self._command(DriveChange(True, voltage, frequency))
        else:
            self._command(Drive(False, voltage or 0.0, frequency or 0.0))

    @verb
    def feed(self, rate: float | None = None, position: float | None = None) -> None:
        if (rate is None) == (position is None):
            raise ParameterError("feed takes a rate or a position")
        if rate is not None:
            self._command(Feed(RATE, rate))
        elif position is not None:
            self._command(Feed(POSITION, position))

    @verb
    def move(self, position: float, velocity: float = 0.0) -> None:
        self._command(MountMotion(position, velocity))
        mount = self._run.simulation.process.mount
        if mount is not None and mount.swings and not self._swings:
            self._swings = True
            warnings.warn(
                "the mount swings: its velocity changes sign with each step; take a "
                "shorter step, or mount_impedance implicitly",
                stacklevel=2,
            )

    @verb
    def engage(self, on: bool = True) -> None:
        self.set_parameters(regime="drilling" if Flag("").check("engage", on) else "free")

    def set_parameters(self, **values: Any) -> None:
        """Set parameters that may change during a run, all of them or none."""
        for change in parameter_changes(values).changes:
            self._run.apply(change.action)

    # Faults.

    @verb
    def inject(
        self,
        kind: str,
        channel: str = "",
        magnitude: float | None = None,
        duration: float | None = None,
    ) -> int:
        size = math.nan if magnitude is None else magnitude
        length = 0 if duration is None else round(DURATION.check("duration", duration) * SECOND)
        return self._run.apply(Inject(Fault(kind, channel, size), length))[0]

    @verb
    def clear(self, which: int | str = "all") -> list[int]:
        faults = self._run.simulation.faults.active
        active = {record.number: record.fault.kind for record in faults}
        numbers = [n for n, kind in active.items() if which in ("all", n, kind)]
        if not numbers and which != "all":
            hint = did_you_mean(str(which), sorted({*active.values()})) if active else "; none is"
            raise ParameterError(f"no fault {short_repr(which)} is active{hint}")
        for number in numbers:
            self._run.apply(Clear(number))
        return numbers

    def __deepcopy__(self, memo: dict[int, Any]) -> Drill:
        memo[id(self)] = twin = object.__new__(type(self))
        vars(twin).update(copy.deepcopy(vars(self), memo))
        return twin

    def __copy__(self) -> Drill:
        return copy.deepcopy(self)

    def __reduce__(self) -> Any:
        raise TypeError(
            "a Drill cannot be pickled: copy.deepcopy copies it in this process, drill.run can be "
            "pickled and saved as a bag, and rpud fork continues a bag"
        )

    def __repr__(self) -> str:
        return f"<Drill at {self.time:g} s, seed {self._run.beginning.seed}>"

    def _command(self, command: Command | DriveChange) -> None:
        self._run.apply(command)
        self._run.watch()

    def _keep(self, block: Block) -> None:
        self._block = block
        self._blocks.append(block)
