"""Plans: which faults and commands come at which time.

A scenario has faults that begin by themselves. A command file may hold commands as well. A fork
also changes parameters. A run without a plan has none of them.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from rpud_sim.foundation.quantities import ParameterError, check_names
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.simulation.commands import Command, Control, Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import (
    CHANGEABLE,
    PARAMETERS,
    Configuration,
    Settings,
)
from rpud_sim.simulation.faults import Fault

if TYPE_CHECKING:
    from rpud_sim.simulation.run import Run
    from rpud_sim.simulation.simulation import Simulation

Item = TypeVar("Item")


@dataclasses.dataclass(frozen=True)
class ScheduledFault:
    """Fault with its onset and its end."""

    onset: int  # simulation time at which it begins [ns]
    clear: int | None  # simulation time at which it ends, None if it does not end by itself [ns]
    fault: Fault  # that begins
    # file and line, with a colon; an error message begins with it
    place: str = dataclasses.field(default="", compare=False)

    @property
    def duration(self) -> int:
        """Time for which it lasts [ns]; 0 if it does not end by itself."""
        return 0 if self.clear is None else self.clear - self.onset


@dataclasses.dataclass(frozen=True)
class Scenario:
    """Faults of a scenario file, with all values drawn."""

    seed: int  # with which it was drawn
    # in the order of their onsets; those of one kind on one channel do not overlap. If one
    # ends at the instant at which another begins, it ends first.
    faults: tuple[ScheduledFault, ...]


# Parameters that a fork changes by a command, for they hold only until the first command
COMMANDED = ("weight_on_bit", "drive_enabled")


@dataclasses.dataclass(frozen=True)
class DriveChange:
    """Command to the drive; what it leaves open stays as it is."""

    enabled: bool  # whether the actuator is driven
    voltage: float | None = None  # amplitude [V]; None for the present one
    frequency: float | None = None  # [Hz]; None for the present one

    def on(self, present: Drive) -> Drive:
        return Drive(
            self.enabled,
            present.voltage if self.voltage is None else self.voltage,
            present.frequency if self.frequency is None else self.frequency,
        )


@dataclasses.dataclass(frozen=True)
class Injection:
    """Fault to inject."""

    fault: Fault  # that begins
    duration: int = 0  # after which it ends by itself [ns]; 0 for never


Change = WeightOnBit | DriveChange | Feed | Injection


class Planned(NamedTuple):
    """Change at a time."""

    delay: int  # from the instant of the fork [ns]
    change: Change  # the command or the fault


@dataclasses.dataclass(frozen=True)
class Changes:
    """What differs from the recorded run."""

    # values from the instant of the fork on, by name
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    planned: tuple[Planned, ...] = ()  # commands and faults, in the order of their times
    replaces_commands: bool = False  # whether the recorded commands after the fork are left out

    @property
    def empty(self) -> bool:
        return not (self.parameters or self.planned or self.replaces_commands)

    def __add__(self, other: Changes) -> Changes:
        """Return both; the other's values of parameters win."""
        return Changes(
            {**self.parameters, **other.parameters},
            in_order((*self.planned, *other.planned)),
            self.replaces_commands or other.replaces_commands,
        )


class Agenda(Generic[Item]):
    """What is still to come, each at its simulation time [ns], in the order of these."""

    def __init__(self, items: Iterable[tuple[int, Item]]) -> None:
        self._items = deque(items)

    @property
    def next(self) -> int:
        """Time of the next item; ``NEVER`` if nothing is left."""
        return self._items[0][0] if self._items else NEVER

    def due(self, time: int) -> Iterator[Item]:
        """Take what comes up to a time, one after the other."""
        while self.next <= time:
            yield self._items.popleft()[1]


def in_order(planned: Iterable[Planned]) -> tuple[Planned, ...]:
    return tuple(sorted(planned, key=lambda each: each.delay))


def parameter_changes(values: Mapping[str, Any], fixed: Sequence[str] = ()) -> Changes:
    """Return the changes of ``--set``, values by name; those of ``fixed`` may be given too.

    What a fork takes is checked later, with the other values of the run.
    """
    allowed = (*CHANGEABLE, *COMMANDED, *fixed)
    check_names(values, PARAMETERS)
    for name in values:
        if name not in allowed:
            raise ParameterError(
                f"{name} cannot change during a run; those that can are {', '.join(allowed)}"
            )
    return Changes(dict(values))


def check_commands(planned: Sequence[Planned], configuration: Configuration) -> None:
    """Check that a drill can take commands, one after the other, in the order of their times."""
    drive = configuration.nominal_drive
    for each in planned:
        if isinstance(each.change, Injection):
            continue
        try:
            command = _command(each.change, drive)
            configuration.check(command)
        except ParameterError as error:
            raise ParameterError(f"command at {each.delay / SECOND:g} s: {error}") from None
        drive = command if isinstance(command, Drive) else drive


def apply_parameters(run: Run, settings: Settings, values: Mapping[str, Any]) -> Settings:
    """Put other values into force on a run; return the settings with them."""
    if not values:
        return settings
    changed = settings.replace(values)
    lasting = settings.replace({n: v for n, v in values.items() if n not in COMMANDED})
    if lasting != settings:
        run.configure(lasting)
    if "weight_on_bit" in values:
        apply_change(run.control, WeightOnBit(changed.configuration.parameters.weight_on_bit))
    if "drive_enabled" in values:
        apply_change(run.control, DriveChange(changed.configuration.drive_enabled))
    return lasting


def apply_change(target: Control | Simulation, change: Change) -> None:
    """Put a change into force, at once or by the control of a run."""
    simulation = target.simulation if isinstance(target, Control) else target
    if isinstance(change, Injection):
        simulation.inject(change.fault, change.duration)
        return
    command = _command(change, simulation.applied.drive)
    simulation.configuration.check(command)  # also where commands do not act now
    target.apply(command)


def _command(change: WeightOnBit | DriveChange | Feed, present: Drive) -> Command:
    return change.on(present) if isinstance(change, DriveChange) else change
