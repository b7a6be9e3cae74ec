"""Configuration files: ROS parameter files in YAML, read without ROS."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from rpud_sim.model.parameters import NAMES, ParameterError, Parameters, preset
from rpud_sim.simulation.actuator import ActuatorParameters, check_drive
from rpud_sim.simulation.commands import Drive
from rpud_sim.simulation.rock import RockParameters

ACTUATOR_NAMES = tuple(field.name for field in dataclasses.fields(ActuatorParameters))
ROCK_NAMES = tuple(field.name for field in dataclasses.fields(RockParameters))

# Parameters of the drill node that are not the drill's; they may stand in the same file.
NODE_NAMES = (
    "drive_enabled",
    "autostart",
    "start_paused",
    "publish_clock",
    "real_time_factor",
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
        raise ParameterError(f"{name} = {value!r} is not true or false")
    return value


class _Loader(yaml.SafeLoader):
    """YAML in which 1e-3 and 1.96e11 are numbers, as in YAML 1.2 and for ROS."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


def read_parameter_file(path: str | Path) -> dict[str, Any]:
    """Return the parameters of a ROS parameter file: those below ``/**``, then those of its nodes.

    Raises:
        ParameterError: if the file cannot be read or is no parameter file.
    """
    try:
        content = yaml.load(Path(path).read_text(encoding="utf-8"), _Loader)
    except OSError as error:
        raise ParameterError(f"{path}: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ParameterError(f"{path} is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(content, Mapping):
        raise ParameterError(f"{path} is not a ROS parameter file: it holds no mapping")
    found: dict[str, Any] = {}
    for node, section in sorted(content.items(), key=lambda item: str(item[0]) != "/**"):
        values = section.get("ros__parameters") if isinstance(section, Mapping) else None
        if not isinstance(values, Mapping):
            raise ParameterError(f"{path}: {node} has no mapping named ros__parameters")
        found.update({str(name): value for name, value in values.items()})
    return found


def parse_assignment(text: str) -> tuple[str, Any]:
    """Return name and value of ``name=value``; the value is read as YAML does.

    Raises:
        ParameterError: if the text has another form.
    """
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise ParameterError(f"{text!r} is not of the form name=value")
    try:
        parsed = yaml.load(value, _Loader)
    except yaml.YAMLError:
        parsed = value
    return name, parsed


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
            raise ParameterError(f"{name} is not a parameter; known are {', '.join(known)}")

    def chosen(names: tuple[str, ...]) -> dict[str, Any]:
        return {name: values[name] for name in names if name in values}

    drill = chosen(NAMES)
    return Configuration(
        preset(drill.pop("regime", "drilling")).replace(**drill),
        ActuatorParameters(**chosen(ACTUATOR_NAMES)),
        RockParameters(**chosen(ROCK_NAMES)),
        **chosen(("drive_enabled",)),
    )


def to_parameters(values: Mapping[str, Any]) -> Parameters:
    """Return the parameters of the impact dynamics, as ``to_configuration`` does."""
    return to_configuration(values).parameters
