"""The drill node's ROS parameters: checked, and read into immutable settings."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from rpud_sim.simulation import (
    CONTACT_MODELS,
    NAMES,
    QUANTITIES,
    REGIMES,
    ParameterError,
    Quantity,
    shown,
)
from rpud_sim.simulation.actuator import ACTUATOR_MODELS, ACTUATOR_QUANTITIES
from rpud_sim.simulation.configuration import (
    ACTUATOR_NAMES,
    NODE_NAMES,
    ROCK_NAMES,
    Configuration,
    check_flag,
    to_configuration,
)
from rpud_sim.simulation.rock import ROCK_MODELS, ROCK_QUANTITIES
from rpud_sim.simulation.scenario import Scenario, read_scenario
from rpud_sim.simulation.watchdog import COMMAND_LOSS_RAMP, COMMAND_TIMEOUT

TELEMETRY_RATE = Quantity("Hz", "rate of the telemetry topics, a whole number", 1.0, 1000.0)
SAMPLE_RATE = Quantity("Hz", "rate of the waveform's samples, a whole number", 1.0, 1e6)
BLOCK_DURATION = Quantity("s", "length of a block of waveform and trajectory", 1e-3, 1.0)
REAL_TIME_FACTOR = Quantity(
    "", "simulated over elapsed time; 0 is as fast as possible, otherwise at least 0.01", 0.0, 1e3
)
LEAST_REAL_TIME_FACTOR = 0.01
THREAD_PRIORITY = Quantity(
    "", "real-time priority in real time or slower, where permitted; 0 for none; whole", 0.0, 99.0
)
SEED = Quantity("", "seed of initial vibration phase, scenario and noise; whole", 0.0, 2.0**32 - 1)

ALL_NAMES = (*NAMES, *ACTUATOR_NAMES, *ROCK_NAMES, *NODE_NAMES)
CHOICES = {
    "contact_model": ("how the contact with the drill tool is modelled", CONTACT_MODELS),
    "regime": ("free is before drilling, drilling is in the rock", REGIMES),
    "actuator_model": (
        "gain: the amplitude is proportional to the voltage at once; "
        "resonance: by resonance, with ring-up and power",
        ACTUATOR_MODELS,
    ),
    "rock_model": ("whether the hole gets deeper by the impacts' energy", ROCK_MODELS),
}
FLAGS = {
    "heating": "whether the actuator warms up and its resonance drifts",
    "drive_enabled": "whether the actuator is driven from the start",
    "autostart": "whether the node configures and activates itself",
    "start_paused": "whether the simulation waits for a step, or to be played",
    "publish_clock": "whether the node is the source of /clock, simulation time starting at zero",
}
NUMBERS = {
    "real_time_factor": REAL_TIME_FACTOR,
    "thread_priority": THREAD_PRIORITY,
    "command_timeout": COMMAND_TIMEOUT,
    "command_loss_ramp": COMMAND_LOSS_RAMP,
    "telemetry_rate": TELEMETRY_RATE,
    "sample_rate": SAMPLE_RATE,
    "block_duration": BLOCK_DURATION,
    "seed": SEED,
}
WHOLE = ("thread_priority", "telemetry_rate", "sample_rate", "seed")
TEXTS = {"scenario": "file of the faults that come by themselves; none if empty"}
ALL_QUANTITIES = {**QUANTITIES, **ACTUATOR_QUANTITIES, **ROCK_QUANTITIES, **NUMBERS}

# May change while the drill runs; the others are read-only.
CHANGEABLE = (
    "regime",
    "rpud_damping_ratio",
    "load_spring_rate",
    "drill_tool_damping_ratio",
    "restoring_spring_rate",
    "actuator_restitution",
    "drill_tool_restitution",
    "gravity",
    "rock_specific_energy",
    "real_time_factor",
    "command_timeout",
    "command_loss_ramp",
)


@dataclasses.dataclass(frozen=True)
class Settings:
    """What the drill node runs with.

    Args:
        configuration: of the drill.
        autostart: whether the node configures and activates itself.
        start_paused: whether the simulation waits to be stepped or played.
        publish_clock: whether the node is the source of ``/clock``.
        real_time_factor: simulated over elapsed time; 0 is as fast as possible.
        thread_priority: of the pacing thread in real time or slower; 0 for none.
        command_timeout: without a command, after which the drill is made safe [s]; 0 for never.
        command_loss_ramp: in which it is made safe [s].
        telemetry_rate: blocks, and samples on the telemetry topics, per second [Hz].
        sample_rate: of the waveform [Hz].
        block_duration: of waveform and trajectory [s].
        scenario: file of the faults that come by themselves, empty for none.
        seed: of everything that is drawn.
    """

    configuration: Configuration = dataclasses.field(default_factory=Configuration)
    autostart: bool = True
    start_paused: bool = False
    publish_clock: bool = False
    real_time_factor: float = 1.0
    thread_priority: int = 10
    command_timeout: float = 0.0
    command_loss_ramp: float = 0.5
    telemetry_rate: int = 100
    sample_rate: int = 50_000
    block_duration: float = 0.05
    scenario: str = ""
    seed: int = 0

    def value(self, name: str) -> Any:
        """The value of a parameter."""
        configuration = self.configuration
        for owner in (
            self,
            configuration,
            configuration.parameters,
            configuration.actuator,
            configuration.rock,
        ):
            if hasattr(owner, name):
                return getattr(owner, name)
        raise KeyError(name)

    def values(self) -> dict[str, Any]:
        """The values of all parameters by name."""
        return {name: self.value(name) for name in ALL_NAMES}

    def replace(self, changes: Mapping[str, Any]) -> Settings:
        """Return settings with some values changed.

        Raises:
            ParameterError: if a value cannot be used.
        """
        return check_settings({**self.values(), **changes})

    def read_scenario(self, seed: int | None = None) -> Scenario | None:
        """Read the scenario, if there is one; a seed of zero leaves it its own.

        Raises:
            ParameterError: if its file cannot be used.
        """
        if not self.scenario:
            return None
        return read_scenario(self.scenario, seed or self.seed or None)


def check_settings(values: Mapping[str, Any]) -> Settings:
    """Return the settings for parameter values by name; what is not given has its default.

    Raises:
        ParameterError: if a name is unknown or a value cannot be used.
    """
    configuration = to_configuration(values)
    checked: dict[str, Any] = {}
    for name in NODE_NAMES:
        if name not in values or name == "drive_enabled":
            continue
        if name in FLAGS:
            checked[name] = check_flag(name, values[name])
        elif name in NUMBERS:
            checked[name] = NUMBERS[name].check(name, values[name])
        elif not isinstance(values[name], str):
            raise ParameterError(f"{name} = {shown(values[name])} is not a text")
        else:
            checked[name] = values[name]
    for name in WHOLE:
        if name in checked:
            if checked[name] % 1.0:
                unit = f" {NUMBERS[name].unit}".rstrip()
                raise ParameterError(f"{name} = {checked[name]:g}{unit} is not a whole number")
            checked[name] = int(checked[name])
    settings = Settings(configuration, **checked)
    if 0.0 < settings.real_time_factor < LEAST_REAL_TIME_FACTOR:
        raise ParameterError(
            f"real_time_factor = {settings.real_time_factor:g} is neither 0, as fast as possible, "
            f"nor at least {LEAST_REAL_TIME_FACTOR:g}"
        )
    if settings.block_duration * settings.telemetry_rate < 1.0:
        raise ParameterError(
            f"block_duration = {settings.block_duration:g} s is shorter than one period of "
            f"telemetry_rate = {settings.telemetry_rate} Hz"
        )
    settings.read_scenario()
    return settings
