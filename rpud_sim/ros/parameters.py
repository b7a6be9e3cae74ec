"""The drill node's ROS parameters: declared, checked, and read into immutable settings."""

from __future__ import annotations

import dataclasses
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpud_sim.simulation import (
    CONTACT_MODELS,
    NAMES,
    QUANTITIES,
    REGIMES,
    ParameterError,
    Parameters,
    Quantity,
)
from rpud_sim.simulation.commands import NOMINAL_VOLTAGE, Drive, vibration_amplitude
from rpud_sim.simulation.configuration import NODE_NAMES, to_parameters
from rpud_sim.simulation.simulation import DEFAULT_NOMINAL_VOLTAGE

TELEMETRY_RATE = Quantity("Hz", "rate of the telemetry topics, a whole number", 1.0, 1000.0)
SAMPLE_RATE = Quantity("Hz", "rate of the waveform's samples, a whole number", 1.0, 1e6)
BLOCK_DURATION = Quantity("s", "length of a block of waveform and trajectory", 1e-3, 1.0)

CHOICES = {
    "contact_model": ("how the contact with the drill tool is modelled", CONTACT_MODELS),
    "regime": ("free is before drilling, drilling is in the rock", REGIMES),
}
FLAGS = {
    "drive_enabled": "whether the actuator is driven from the start",
    "publish_clock": "whether the node is the source of /clock, simulation time starting at zero",
}
NUMBERS = {
    "nominal_voltage": NOMINAL_VOLTAGE,
    "telemetry_rate": TELEMETRY_RATE,
    "sample_rate": SAMPLE_RATE,
    "block_duration": BLOCK_DURATION,
}


@dataclasses.dataclass(frozen=True)
class Settings:
    """What the drill node runs with.

    Args:
        parameters: of the model.
        drive_enabled: whether the actuator is driven from the start.
        nominal_voltage: voltage that gives the nominal vibration amplitude [V].
        telemetry_rate: blocks, and samples on the telemetry topics, per second [Hz].
        sample_rate: of the waveform [Hz].
        block_duration: of waveform and trajectory [s].
        publish_clock: whether the node is the source of ``/clock``.
    """

    parameters: Parameters
    drive_enabled: bool = True
    nominal_voltage: float = DEFAULT_NOMINAL_VOLTAGE
    telemetry_rate: int = 100
    sample_rate: int = 50_000
    block_duration: float = 0.05
    publish_clock: bool = False


def check_settings(values: dict[str, Any]) -> Settings:
    """Return the settings for parameter values by name; what is not given has its default.

    Raises:
        ParameterError: if a name is unknown or a value cannot be used.
    """
    parameters = to_parameters(values)
    checked: dict[str, Any] = {}
    for name in FLAGS:
        if name in values:
            if not isinstance(values[name], bool):
                raise ParameterError(f"{name} = {values[name]!r} is not true or false")
            checked[name] = values[name]
    for name, quantity in NUMBERS.items():
        if name in values:
            checked[name] = quantity.check(name, values[name])
    for name in ("telemetry_rate", "sample_rate"):
        if name in checked:
            if checked[name] % 1.0:
                raise ParameterError(f"{name} = {checked[name]:g} Hz is not a whole number")
            checked[name] = int(checked[name])
    settings = Settings(parameters, **checked)
    # At the gate, so that the nominal drive cannot be refused later.
    nominal = Drive(True, settings.nominal_voltage, parameters.vibration_frequency)
    vibration_amplitude(nominal, parameters, settings.nominal_voltage)
    if settings.block_duration * settings.telemetry_rate < 1.0:
        raise ParameterError(
            f"block_duration = {settings.block_duration:g} s is shorter than one period of "
            f"telemetry_rate = {settings.telemetry_rate} Hz"
        )
    return settings


def declare_settings(node: Node) -> Settings:
    """Declare all parameters on the node and return the settings that they hold.

    A whole number is taken where a number is meant, as in ``weight_on_bit: 20``. All are read-only
    once the node runs; weight on bit and drive change by command.

    Raises:
        ParameterError: if a value cannot be used.
    """
    values: dict[str, Any] = {"regime": _declare(node, "regime", "drilling")}
    defaults = check_settings(dict(values))
    for name in (*NAMES, *NODE_NAMES):
        if name not in values:
            default = getattr(defaults.parameters if name in NAMES else defaults, name)
            values[name] = _declare(node, name, default)
    settings = check_settings(values)
    for name, quantity in {**QUANTITIES, **NUMBERS}.items():
        _describe(
            node,
            name,
            float(values[name]),
            f"{quantity.description} [{quantity.unit or '1'}]",
            f"in {quantity.range}",
            FloatingPointRange(from_value=quantity.minimum, to_value=quantity.maximum),
        )
    for name, (description, choices) in CHOICES.items():
        _describe(node, name, values[name], description, f"one of {', '.join(choices)}")
    for name, description in FLAGS.items():
        _describe(node, name, values[name], description)
    return settings


def _declare(node: Node, name: str, default: Any) -> Any:
    """Declare a parameter of any type, so that a wrong one gets our error; return its value."""
    if isinstance(default, int) and not isinstance(default, bool):
        default = float(default)
    return node.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True)).value


def _describe(
    node: Node,
    name: str,
    value: Any,
    description: str,
    constraints: str = "",
    allowed: FloatingPointRange | None = None,
) -> None:
    """Give a declared parameter its checked value and its final, read-only descriptor."""
    parameter = Parameter(name, value=value)
    node.set_parameters([parameter])
    node.set_descriptor(
        name,
        ParameterDescriptor(
            name=name,
            type=parameter.type_.value,
            description=description,
            additional_constraints=constraints,
            read_only=True,
            floating_point_range=[allowed] if allowed else [],
        ),
    )
