"""Changes of a fork: what differs from the recorded run, from the instant of the fork on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, shown
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.yaml_files import Cursor, open_yaml
from rpud_sim.simulation.commands import Command, Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import (
    CHANGEABLE,
    Configuration,
    Settings,
    check_names,
    parse_assignment,
)
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.scenario import ONSET, parse_scenario
from rpud_sim.simulation.simulation import Simulation

# Parameters that a fork changes by a command, for they hold only until the first command
COMMANDED = ("weight_on_bit", "drive_enabled")

_COMMAND_KEYS = ("time", "weight_on_bit", "drive", "feed")
_DRIVE_KEYS = ("enabled", "voltage", "frequency")


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


@dataclasses.dataclass(frozen=True)
class Planned:
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
            _in_order((*self.planned, *other.planned)),
            self.replaces_commands or other.replaces_commands,
        )


def _in_order(planned: Iterable[Planned]) -> tuple[Planned, ...]:
    return tuple(sorted(planned, key=lambda each: each.delay))


def parameter_changes(values: Mapping[str, Any], fixed: Sequence[str] = ()) -> Changes:
    """Return the changes of ``--set``, values by name; those of ``fixed`` may be given too.

    What a fork takes is checked later, with the other values of the run.
    """
    allowed = (*CHANGEABLE, *COMMANDED, *fixed)
    check_names(values)
    for name in values:
        if name not in allowed:
            raise ParameterError(
                f"{name} cannot change during a run; those that can are {', '.join(allowed)}"
            )
    return Changes(dict(values))


def parse_injections(texts: Sequence[str]) -> Changes:
    """Return the faults of ``--inject``: kinds with commas and keys of a scenario's entry.

    A text is such as ``noise,channel=wrench,magnitude=0.5``; without ``onset`` a fault begins at
    the instant of the fork.
    """
    entries = []
    for text in texts:
        kind, *rest = text.split(",")
        keys = [("kind", kind), *map(parse_assignment, rest)]
        if len(dict(keys)) < len(keys):
            raise ParameterError(f"--inject {shown(text)} gives a key twice")
        entries.append({"onset": 0.0, **dict(keys)})
    return Changes(planned=_injections({"faults": entries}, "--inject"))


def read_commands(path: str | Path) -> Changes:
    """Return the changes of a command file: a scenario that may hold commands as well.

    Times count from the instant of the fork.
    """
    top = open_yaml(path, truth_values=False)
    entries = top.file_mapping("a scenario")
    content = {key: entry.value for key, entry in entries.items() if key != "commands"}
    if "commands" not in entries:
        return Changes(planned=_injections(content, str(path)))
    faults = Changes(planned=_injections({"faults": [], **content}, str(path)))
    planned = parse_commands(entries["commands"].sequence("command {number}"))
    return Changes(planned=planned, replaces_commands=True) + faults


def parse_commands(entries: Iterable[Cursor]) -> tuple[Planned, ...]:
    """Return the commands of a list in YAML, in the order of their times."""
    planned: list[Planned] = []
    for entry in entries:
        with entry.errors():
            planned += _commands(entry)
    return _in_order(planned)


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


def _injections(content: Mapping[Any, Any], name: str) -> tuple[Planned, ...]:
    return tuple(
        Planned(scheduled.onset, Injection(scheduled.fault, scheduled.duration))
        for scheduled in parse_scenario(content, name).faults
    )


def _commands(entry: Cursor) -> list[Planned]:
    given = entry.mapping(_COMMAND_KEYS)
    if "time" not in given or len(given) == 1:
        raise entry.refusal("it needs a time, and weight_on_bit, drive or feed")
    delay = round(given["time"].check(ONSET) * SECOND)
    makers: Mapping[str, Callable[[Cursor], Change]] = {
        "weight_on_bit": lambda weight: WeightOnBit(weight.value),
        "drive": _drive,
        "feed": _feed,
    }
    return [Planned(delay, make(given[key])) for key, make in makers.items() if key in given]


def _feed(entry: Cursor) -> Feed:
    if not (isinstance(entry.value, Mapping) and len(entry.value) == 1):
        raise entry.refusal("feed = {shown} is neither {{rate: m/s}} nor {{position: m}}")
    [(mode, value)] = entry.value.items()
    return Feed(mode, value)


def _drive(entry: Cursor) -> DriveChange:
    values = entry.mapping(
        _DRIVE_KEYS,
        other="drive = {shown} is not a mapping",
        unknown="drive: {shown} is not one of {names}",
    )
    # The file is read without truth values, for off is a kind of fault.
    enabled = entry.get("enabled", "true")
    if enabled.value not in ("true", "false"):
        raise enabled.refusal("drive enabled = {shown} is not true or false")
    numbers = {key: each.value for key, each in values.items() if key != "enabled"}
    change = DriveChange(enabled.value == "true", **numbers)
    change.on(Drive(True, 1.0, 1e4))  # checks the numbers
    return change


def apply_parameters(run: Run, settings: Settings, values: Mapping[str, Any]) -> Settings:
    """Put other values into force on a run; return the settings with them."""
    if not values:
        return settings
    changed = settings.replace(values)
    lasting = settings.replace({n: v for n, v in values.items() if n not in COMMANDED})
    if lasting != settings:
        run.configure(lasting)
    if "weight_on_bit" in values:
        apply_change(run, WeightOnBit(changed.configuration.parameters.weight_on_bit))
    if "drive_enabled" in values:
        apply_change(run, DriveChange(changed.configuration.drive_enabled))
    return lasting


def apply_change(target: Run | Simulation, change: Change) -> None:
    """Put a change into force on a simulation, or on a run that takes commands."""
    simulation = target.simulation if isinstance(target, Run) else target
    if isinstance(change, Injection):
        simulation.inject(change.fault, change.duration)
        return
    command = _command(change, simulation.applied.drive)
    simulation.configuration.check(command)  # also where commands do not act now
    (target.control if isinstance(target, Run) else target).apply(command)


def _command(change: WeightOnBit | DriveChange | Feed, present: Drive) -> Command:
    return change.on(present) if isinstance(change, DriveChange) else change
