"""Commands to the drill, checked when they are made."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from rpud_sim.drilling.mount import Feed as Feed
from rpud_sim.drilling.mount import Motion as Motion
from rpud_sim.drilling.mount import MountMotion as MountMotion
from rpud_sim.foundation.quantities import Flag, Quantity
from rpud_sim.model.parameters import QUANTITIES

VOLTAGE = Quantity("V", "amplitude of the voltage on the piezoelectric stack", 0.0, 1e3)


@dataclasses.dataclass(frozen=True)
class WeightOnBit:
    """Constant force with which the preloaded load spring pushes the drill toward the rock."""

    force: float  # W [N]

    def __post_init__(self) -> None:
        force = QUANTITIES["weight_on_bit"].check("weight_on_bit", self.force)
        object.__setattr__(self, "force", force)


@dataclasses.dataclass(frozen=True)
class Drive:
    """Sinusoidal voltage on the piezoelectric stack.

    A drive that is not enabled may leave voltage and frequency at zero, which keeps the current
    ones.
    """

    enabled: bool  # whether the actuator is driven
    voltage: float  # amplitude [V]
    frequency: float  # [Hz]

    def __post_init__(self) -> None:
        Flag("").check("drive enabled", self.enabled)
        object.__setattr__(self, "voltage", VOLTAGE.check("drive voltage", self.voltage))
        if not self.enabled and self.frequency == 0.0:
            object.__setattr__(self, "frequency", 0.0)
            return
        frequency = QUANTITIES["vibration_frequency"].check("drive frequency", self.frequency)
        object.__setattr__(self, "frequency", frequency)

    def after(self, before: Drive) -> Drive:
        """Return this drive, with the voltage and frequency of the one before where it has none."""
        voltage = self.voltage if self.enabled or self.voltage else before.voltage
        return Drive(self.enabled, voltage, self.frequency or before.frequency)


@dataclasses.dataclass(frozen=True)
class DriveChange:
    """Command to the drive that may leave voltage and frequency as they are."""

    enabled: bool  # whether the actuator is driven
    voltage: float | None = None  # amplitude [V]; None for the current one
    frequency: float | None = None  # [Hz]; None for the current one

    def on(self, present: Drive) -> Drive:
        return Drive(
            self.enabled,
            present.voltage if self.voltage is None else self.voltage,
            present.frequency if self.frequency is None else self.frequency,
        )


Command = WeightOnBit | Drive | Feed | MountMotion
COMMAND_NAMES: Mapping[type, str] = {  # names of topics, and kinds of entries in the journal
    WeightOnBit: "weight_on_bit",
    Drive: "drive",
    Feed: "feed",
    MountMotion: "mount",
}


def slot(command: Command) -> str:
    """Return the field of ``ActiveCommands`` that a command takes."""
    return "motion" if isinstance(command, Motion) else COMMAND_NAMES[type(command)]


@dataclasses.dataclass(frozen=True)
class ActiveCommands:
    """Commands active, and since when.

    Times are integer nanoseconds of simulation time. With a feed the weight on bit is none of them.
    """

    weight_on_bit: WeightOnBit
    weight_on_bit_time: int
    drive: Drive
    drive_time: int
    motion: Motion | None = None  # motion of the mount; None without a feed
    motion_time: int = 0
