"""Configuration files: ROS parameter files in YAML, read without ROS."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpud_sim.model.parameters import NAMES, ParameterError, Parameters, preset, shown
from rpud_sim.simulation.actuator import ActuatorParameters, check_drive
from rpud_sim.simulation.commands import Drive
from rpud_sim.simulation.rock import RockParameters
from rpud_sim.simulation.yaml_files import parse_yaml, read_yaml

ACTUATOR_NAMES = tuple(field.name for field in dataclasses.fields(ActuatorParameters))
ROCK_NAMES = tuple(field.name for field in dataclasses.fields(RockParameters))

# Parameters of the drill node that are not the drill's; they may stand in the same file.
NODE_NAMES = (
    "drive_enabled",
    "autostart",
    "start_paused",
    "publish_clock",
    "real_time_factor",
    "thread_priority",
    "command_timeout",
    "command_loss_ramp",
    "telemetry_rate",
    "sample_rate",
    "block_duration",
    "scenario",
    "seed",
)


@dataclasses.dataclass(frozen=True)
class Configuration:
    """A drill with its actuator and its rock.

    Args:
        parameters: of the impact dynamics.
        actuator: from voltage to amplitude.
        rock: from impacts to depth.
        drive_enabled: whether the actuator is driven from the start.

    Raises:
        ParameterError: if the nominal drive would give an amplitude outside its range.
    """

    parameters: Parameters = dataclasses.field(default_factory=Parameters)
    actuator: ActuatorParameters = dataclasses.field(default_factory=ActuatorParameters)
    rock: RockParameters = dataclasses.field(default_factory=RockParameters)
    drive_enabled: bool = True

    def __post_init__(self) -> None:
        check_flag("drive_enabled", self.drive_enabled)
        voltage = self.actuator.nominal_voltage
        check_drive(
            Drive(True, voltage, self.parameters.vibration_frequency),
            self.parameters.vibration_amplitude,
            voltage,
        )


def check_flag(name: str, value: Any) -> bool:
    """Return the value if it is a truth value.

    Raises:
        ParameterError: if it is not.
    """
    if not isinstance(value, bool):
        raise ParameterError(f"{name} = {shown(value)} is not true or false")
    return value


def read_parameter_file(path: str | Path) -> dict[str, Any]:
    """Return the parameters of a ROS parameter file: those below ``/**``, then those of its nodes.

    Raises:
        ParameterError: if the file cannot be read or is no parameter file.
    """
    content = read_yaml(path)
    if not isinstance(content, Mapping):
        raise ParameterError(f"{path} is not a ROS parameter file: it holds no mapping")
    found: dict[str, Any] = {}
    for node, section in sorted(content.items(), key=lambda item: str(item[0]) != "/**"):
        values = section.get("ros__parameters") if isinstance(section, Mapping) else None
        if not isinstance(values, Mapping):
            raise ParameterError(f"{path}: {_named(node)} has no mapping named ros__parameters")
        found.update({str(name): value for name, value in values.items()})
    return found


def parse_assignment(text: str) -> tuple[str, Any]:
    """Return name and value of ``name=value``; the value is read as YAML does.

    Raises:
        ParameterError: if the text has another form.
    """
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise ParameterError(f"{shown(text)} is not of the form name=value")
    try:
        return name, parse_yaml(value)
    except ParameterError:
        return name, value


def to_configuration(values: Mapping[str, Any]) -> Configuration:
    """Return the configuration: the regime's preset with the given values.

    Args:
        values: by name; ``regime`` chooses the preset, drilling if it is not given. Those of the
            node that are not the drill's are passed over.

    Raises:
        ParameterError: if a name is unknown or a value is outside its range.
    """
    known = (*NAMES, *ACTUATOR_NAMES, *ROCK_NAMES, *NODE_NAMES)
    for name in values:
        if name not in known:
            nearest = difflib.get_close_matches(str(name), known, 1)
            hint = f"did you mean {nearest[0]}?" if nearest else f"known are {', '.join(known)}"
            raise ParameterError(f"{_named(name)} is not a parameter; {hint}")

    def chosen(names: tuple[str, ...]) -> dict[str, Any]:
        return {name: values[name] for name in names if name in values}

    drill = chosen(NAMES)
    return Configuration(
        preset(drill.pop("regime", "drilling")).replace(**drill),
        ActuatorParameters(**chosen(ACTUATOR_NAMES)),
        RockParameters(**chosen(ROCK_NAMES)),
        **chosen(("drive_enabled",)),
    )


def to_values(configuration: Configuration) -> dict[str, Any]:
    """Return the values of all parameters by name, of which ``to_configuration`` makes it again."""
    return {
        **dataclasses.asdict(configuration.parameters),
        **dataclasses.asdict(configuration.actuator),
        **dataclasses.asdict(configuration.rock),
        "drive_enabled": configuration.drive_enabled,
    }


def to_parameters(values: Mapping[str, Any]) -> Parameters:
    """Return the parameters of the impact dynamics, as ``to_configuration`` does."""
    return to_configuration(values).parameters


def _named(name: Any) -> str:
    """A name that somebody gave, as text that is short and one line."""
    plain = isinstance(name, str) and name.isprintable() and len(name) <= 60
    return name if plain else shown(name)
