"""Configuration of the drill, its actuator, its mount and its rock, and settings of a run."""

from __future__ import annotations

import dataclasses
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rpud_sim.drilling.borehole import BitParameters
from rpud_sim.drilling.mount import MountParameters
from rpud_sim.drilling.process import STIFFEST
from rpud_sim.drilling.rock import RockParameters, Strata, StrataParameters, uniform_strata
from rpud_sim.drilling.rotor import RotationParameters
from rpud_sim.foundation.options import NAMESPACE, NO_SEED, SEED
from rpud_sim.foundation.quantities import (
    Declaration,
    Flag,
    ParameterError,
    ParameterGroup,
    check_names,
    declarations,
    flag,
    joined,
    number,
    short_name,
    short_repr,
    text,
)
from rpud_sim.foundation.schema import read
from rpud_sim.foundation.shown_quantities import quantity_in
from rpud_sim.foundation.yaml_files import YamlNode, open_yaml, parse_yaml, truth_value
from rpud_sim.model.parameters import QUANTITIES, Parameters, preset
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.commands import COMMAND_NAMES, Command, Drive, Feed, Motion

_LEAST_REAL_TIME_FACTOR = 0.01
_FRAME_PREFIX = re.compile(r"([A-Za-z][\w/-]*)?", re.ASCII)


# A resonant vibration needs at least this modal mass, as a multiple of the free mass: blows would
# turn a lighter one about, for which the model has no contact.
LEAST_MASS_RATIO = 2.0


@dataclasses.dataclass(frozen=True)
class Configuration(ParameterGroup):
    """Drill with its actuator, its rotor, its mount and its rock."""

    # impact dynamics
    parameters: Parameters = dataclasses.field(default_factory=Parameters)
    # voltage to amplitude
    actuator: ActuatorParameters = dataclasses.field(default_factory=ActuatorParameters)
    # impacts to depth
    rock: RockParameters = dataclasses.field(default_factory=RockParameters)
    # whether the actuator is driven from the start
    drive_enabled: bool = flag(True, "whether the actuator is driven from the start")
    # rotation of the drill tool
    rotation: RotationParameters = dataclasses.field(default_factory=RotationParameters)
    mount: MountParameters = dataclasses.field(default_factory=MountParameters)  # feed and arm
    # layers of the rock
    strata: StrataParameters = dataclasses.field(default_factory=StrataParameters)
    # bit at the end of the drill tool
    bit: BitParameters = dataclasses.field(default_factory=BitParameters)

    def __post_init__(self) -> None:
        super().__post_init__()
        free_mass = self.parameters.free_mass
        modal_mass = self.actuator.modal_mass(self.parameters.vibration_amplitude)
        if modal_mass < LEAST_MASS_RATIO * free_mass:
            raise ParameterError(
                f"free_mass = {free_mass:g} kg is more than 1/{LEAST_MASS_RATIO:g} of the "
                f"actuator's modal mass {modal_mass:g} kg, which vibration_amplitude, "
                "nominal_voltage, resonance_frequency, quality_factor and motional_resistance give"
            )

        if self.has_feed:
            self._check_load_spring()

    def _check_load_spring(self) -> None:
        mass, rate = self.parameters.rpud_mass, self.parameters.load_spring_rate
        quantity = QUANTITIES["load_spring_rate"]
        most = min(STIFFEST * mass, quantity.maximum)
        if rate > most:
            raise ParameterError(
                f"load_spring_rate = {rate:g} N/m is outside its range [{quantity.minimum:g}, "
                f"{most:g}] N/m with feed_model = {self.mount.feed_model} and "
                f"rpud_mass = {mass:g} kg"
            )

    @property
    def layers(self) -> Strata | None:
        """Strata in which a bit is stepped; None without rock, or with percussion in one rock.

        A tool that rotates in the rock of the parameters ``rock_*`` is stepped as well.
        """
        if self.strata.found is not None:
            return self.strata.found
        if self.rotates and self.rock.rock_model != "none":
            return uniform_strata(self.rock.rock_specific_energy)
        return None

    @property
    def rotates(self) -> bool:
        return self.rotation.rotation_model != "none"

    @property
    def nominal_drive(self) -> Drive:
        """Drive that is active until the first command."""
        frequency = self.parameters.vibration_frequency
        return Drive(self.drive_enabled, self.actuator.nominal_voltage, frequency)

    @property
    def has_feed(self) -> bool:
        """Whether a feed or the mount's motion is commanded, and the weight on bit follows."""
        return self.mount.command_type is not None

    def check(self, command: Command) -> None:
        """Check that the drill can take a command; of a drive, one that leaves nothing open.

        The greatest amplitude of a drive, that on resonance, is proportional to the voltage. The
        resonance model stays below it at every frequency and temperature, also while ringing up.
        """
        if isinstance(command, Drive):
            if command.enabled:
                # The ratio first: for the nominal drive it is exactly one.
                ratio = command.voltage / self.actuator.nominal_voltage
                QUANTITIES["vibration_amplitude"].check(
                    f"vibration_amplitude at drive voltage {command.voltage:g} V",
                    self.parameters.vibration_amplitude * ratio,
                )
            return
        command_type, model = self.mount.command_type, f"with feed_model = {self.mount.feed_model}"
        if isinstance(command, Motion):
            if not (command_type and isinstance(command, command_type)):
                what = "a feed" if isinstance(command, Feed) else "the motion of the mount"
                raise ParameterError(f"{what} cannot be commanded {model}")
            command.check(self.mount.limits)
        elif command_type:
            follows = f"it follows from the {COMMAND_NAMES[command_type]}"
            raise ParameterError(f"weight_on_bit cannot be commanded {model}: {follows}")


def with_defaults(drill: Configuration | Parameters) -> Configuration:
    """Return a configuration as it is, and parameters with the default actuator and rock."""
    return drill if isinstance(drill, Configuration) else Configuration(drill)


@dataclasses.dataclass(frozen=True)
class Settings(ParameterGroup):
    """Settings of a run: all parameters."""

    configuration: Configuration = dataclasses.field(default_factory=Configuration)
    autostart: bool = flag(True, "whether the node configures and activates itself")
    start_paused: bool = flag(False, "whether the simulation waits for a step, or to be played")
    publish_clock: bool = flag(
        False, "whether the node is the source of /clock, simulation time starting at zero"
    )
    real_time_factor: float = number(
        1.0,
        "",
        "simulated over elapsed time; 0 is as fast as possible, otherwise at least 0.01",
        0.0,
        1e3,
        changeable=True,
    )
    thread_priority: int = number(
        10,
        "",
        "real-time priority in real time or slower, where permitted; 0 for none; whole",
        0.0,
        99.0,
        whole=True,
    )
    command_timeout: float = number(
        0.0,
        "s",
        "time without a command after which drive and weight on bit go to zero, 0 for never",
        0.0,
        3600.0,
        changeable=True,
    )
    command_loss_ramp: float = number(
        0.5,
        "s",
        "time in which drive and weight on bit go to zero when commands are lost",
        0.0,
        60.0,
        changeable=True,
    )
    telemetry_rate: int = number(
        100, "Hz", "rate of the telemetry topics, a whole number", 1.0, 1000.0, whole=True
    )
    sample_rate: int = number(
        50_000, "Hz", "rate of the waveform's samples, a whole number", 1.0, 1e6, whole=True
    )
    block_duration: float = number(
        0.05, "s", "length of a block of waveform and trajectory", 1e-3, 1.0
    )
    frame_prefix: str = text(
        "",
        "letters, digits, _ / -",
        "what names of frames and joints begin with, such as left_",
    )
    publish_robot_description: bool = flag(
        False, "whether the node publishes the URDF of the drill on robot_description"
    )
    scenario: str = text("", "a path", "file of the faults that begin by themselves; none if empty")
    seed: int = number(
        NO_SEED,
        "",
        "seed of initial vibration phase, scenario and noise; whole; -1 for none: phase zero",
        float(NO_SEED),
        float(SEED.maximum),
        whole=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0.0 < self.real_time_factor < _LEAST_REAL_TIME_FACTOR:
            raise ParameterError(
                f"real_time_factor = {self.real_time_factor:g} is neither 0, as fast as possible, "
                f"nor at least {_LEAST_REAL_TIME_FACTOR:g}"
            )
        if not _FRAME_PREFIX.fullmatch(self.frame_prefix):
            raise ParameterError(
                f"frame_prefix = {short_repr(self.frame_prefix)} cannot begin a frame name: "
                "letters, digits, _, / and -, a letter first"
            )
        if self.block_duration * self.telemetry_rate < 1.0:
            raise ParameterError(
                f"block_duration = {self.block_duration:g} s is shorter than one period of "
                f"telemetry_rate = {self.telemetry_rate} Hz"
            )

    @property
    def seed_or_none(self) -> int | None:
        return None if self.seed == NO_SEED else self.seed

    def value(self, name: str) -> Any:
        return self.values()[name]

    def values(self) -> dict[str, Any]:
        own = {name: getattr(self, name) for name in NODE_NAMES}
        return {**to_values(self.configuration), **own}

    def replace(self, changes: Mapping[str, Any]) -> Settings:
        """Return settings with some values changed; only their groups are checked again."""
        check_names(changes, PARAMETERS)
        configuration = self.configuration
        groups = {
            field: dataclasses.replace(getattr(configuration, field), **own)
            for field, group in _GROUPS.items()
            if (own := _those_of(group, changes))
        }
        if drill := {**groups, **_those_of(Configuration, changes)}:
            configuration = dataclasses.replace(configuration, **drill)
        own = _those_of(Settings, changes)
        return dataclasses.replace(self, configuration=configuration, **own)


# Groups of parameters by their field in ``Configuration``, and the groups of single values.
_GROUPS: Mapping[str, Any] = {
    field.name: field.default_factory
    for field in dataclasses.fields(Configuration)
    if field.default_factory is not dataclasses.MISSING
}
_ALL_GROUPS = (*_GROUPS.values(), Configuration, Settings)
_NAMES = {group: tuple(declarations(group)) for group in _ALL_GROUPS}
# Every parameter by its name, in the order in which the documentation lists them.
PARAMETERS: Mapping[str, Declaration] = {
    name: declaration for group in _NAMES for name, declaration in declarations(group).items()
}
CHANGEABLE = tuple(name for name, declaration in PARAMETERS.items() if declaration.changeable)
# Parameters of the run, not of the drill.
NODE_NAMES = _NAMES[Settings]


def to_configuration(values: Mapping[str, Any]) -> Configuration:
    """Return the configuration: the preset of ``regime``, drilling if not given, with these values.

    Parameters of the run are ignored.
    """
    check_names(values, PARAMETERS)
    given = {**vars(preset(values.get("regime", "drilling"))), **values}
    groups = {field: group(**_those_of(group, given)) for field, group in _GROUPS.items()}
    return Configuration(**groups, **_those_of(Configuration, values))


def to_settings(values: Mapping[str, Any]) -> Settings:
    """Return the settings for parameter values by name; missing ones have their defaults."""
    return Settings(to_configuration(values), **_those_of(Settings, values))


def to_values(configuration: Configuration) -> dict[str, Any]:
    """Return the values of all parameters by name, the inverse of ``to_configuration``."""
    groups = (*(getattr(configuration, field) for field in _GROUPS), configuration)
    return {name: getattr(group, name) for group in groups for name in _NAMES[type(group)]}


def parameter_rows(parameters: Mapping[str, Any]) -> list[list[str]]:
    """Return name, value and default of each parameter; first those with another value."""
    regime = "free" if parameters.get("regime") == "free" else "drilling"
    usual = {name: each.default for name, each in PARAMETERS.items()} | vars(preset(regime))
    rows = []
    for name, value in sorted(parameters.items()):
        unit = getattr(PARAMETERS[name].allowed, "unit", "") if name in PARAMETERS else ""
        default = "" if (other := usual.get(name, value)) == value else _value_text(other, unit)
        rows.append([name, _value_text(value, unit), default])
    return sorted(rows, key=lambda row: not row[2])


def _value_text(value: Any, unit: str) -> str:
    number = isinstance(value, float)
    return quantity_in(unit, abs(value)).text(value) if number else f"{value!s:.160}" or "none"


def _those_of(group: type, values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: values[name] for name in _NAMES[group] if name in values}


_PARAMETERS = {name: declaration.allowed for name, declaration in PARAMETERS.items()}


# Parameters that every ROS node may be started with, or beginnings of their names.
OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides.", "qos_overrides")


class ParameterFile:
    """Parameters that a ROS parameter file has for a node, by its full name.

    Sections are read as ROS reads them: a name, ``/**`` or names with ``*``, or nested namespaces.
    Of two that fit the node the later one counts. A section that comes twice is one, and a key that
    comes twice in it is a mistake only among the drill's own. One without a namespace fits the node
    in each. A section for several nodes may have parameters of others.
    """

    def __init__(self, path: str | Path, node: str) -> None:
        whole = open_yaml(path, merge=True)
        if whole.value is None:  # an empty file is one for no node, as for ROS
            whole = dataclasses.replace(whole, value={})
        sections: dict[str, list[YamlNode]] = {}  # by name: a name that comes again keeps its place
        for name, parameters in _sections(whole):
            sections.setdefault(name, []).append(parameters)
            for each in parameters.mapping().values():
                _check_types(each)
        self.values: dict[str, Any] = {}
        self.of_ros: list[str] = []  # names of given parameters that ROS itself declares
        self.foreign: list[str] = []  # names of other nodes' parameters
        own = [name for name in sections if _is_of(name, node)]
        others = ", ".join(map(short_name, sections)) or "no ros__parameters"
        # Error if nothing is for the node.
        self.missing = None if own else whole.error(f"nothing is for {node}: the file has {others}")
        for name in own:
            for each in sections[name]:
                self.values.update(read(self._of_drill(name, each), _PARAMETERS))

    def _of_drill(self, section: str, parameters: YamlNode) -> YamlNode:
        own, several = {}, "*" in section.rpartition("/")[2]
        for name, each in parameters.mapping().items():
            if str(name).startswith(OF_ROS):
                self.of_ros.append(str(name))
            elif several and name not in _PARAMETERS:
                self.foreign.extend(_names_in(str(name), each.value))
            elif each.place in each.repeated:  # ROS takes the later one, of a mistake
                raise each.error(f"{name} occurs twice in one section")
            else:
                own[name] = each.value
        return dataclasses.replace(parameters, value=own)


def read_parameter_file(
    path: str | Path,
    node: str = f"{NAMESPACE}/drill_node",
    passed: Callable[[str], object] = warnings.warn,
) -> dict[str, Any]:
    """Return what a ROS parameter file has for a node, by its full name.

    ``passed`` is called with a line that names parameters of ROS itself and of other nodes, which
    are left out. Raise ``ParameterError`` if no section is the node's.
    """
    file = ParameterFile(path, node)
    if file.missing:
        raise file.missing
    if left_out := [*file.foreign, *file.of_ros]:
        passed(f"{path}: {not_of_the_drill(left_out)}")
    return file.values


def not_of_the_drill(names: Iterable[str]) -> str:
    """Return the line of parameters that belong to ROS or to other nodes."""
    return f"left out, not parameters of the drill: {joined(set(names))}"


def _names_in(name: str, value: Any) -> Iterator[str]:
    """Yield the names that ROS gives the parameters in nested mappings."""
    if isinstance(value, Mapping):
        for key, each in value.items():
            yield from _names_in(f"{name}.{key}", each)
    else:
        yield name


def _sections(content: YamlNode, name: str = "") -> Iterator[tuple[str, YamlNode]]:
    """Name and parameters of each section of a ROS parameter file."""
    for key, each in content.mapping().items():
        if key == "ros__parameters":
            yield name, each
        else:
            separator = "" if not name or name.endswith("/") else "/"
            yield from _sections(each, f"{name}{separator}{key}")


def _check_types(parameters: YamlNode) -> None:
    """Reject what ROS rejects, for every node: a list of values of several types."""
    value = parameters.value
    if isinstance(value, list) and len({str if v is None else type(v) for v in value}) > 1:
        raise parameters.wrong("has values of several types")
    if isinstance(value, Mapping):
        for each in parameters.mapping().values():
            _check_types(each)


def _is_of(section: str, node: str) -> bool:
    words = {"**": r"(/\w+)*", "*": r"/\w+"}
    parts = section.removeprefix("/").split("/")
    pattern = "".join(words.get(word, f"/{re.escape(word)}") for word in parts)
    return bool(re.fullmatch(pattern, node)) or parts == [node.rpartition("/")[2]]


def parse_assignment(text: str) -> tuple[str, Any]:
    """Return name and value of ``name=value``; the value is read as YAML."""
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise ParameterError(f"{short_repr(text)} is not of the form name=value")
    flag = name in PARAMETERS and isinstance(PARAMETERS[name].allowed, Flag)
    try:
        return name, truth_value(parse_yaml(value)) if flag else parse_yaml(value)
    except ParameterError:
        return name, value
