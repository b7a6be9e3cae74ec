"""Faults of the drill and of its signals, checked when they are made.

A physical fault changes the drill, so that every channel shows its effect through the physics. A
signal fault changes the messages of one channel of a healthy drill. ``docs/reference/faults.md``
explains the kinds and says where the effect of a magnitude is assumed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, Quantity, shown, suggestion
from rpud_sim.simulation.channels import CHANNELS, GROUND_TRUTH


class FaultError(ParameterError):
    """Unusable fault; the text says why, in one line."""


@dataclasses.dataclass(frozen=True)
class Kind:
    """Kind of fault."""

    physical: bool  # whether it changes the drill; otherwise it changes the messages of a channel
    description: str  # one phrase
    # meaning of its magnitude, None if it has none; without unit if the unit is the channel's
    magnitude: Quantity | None = None
    # magnitude that NaN stands for; a factor on the channel's scale if the unit is the
    # channel's
    default: float = 0.0
    # magnitude inside the range that would change nothing and is rejected
    unchanging: float | None = None
    # whether the magnitude has the unit of the channel's main quantity
    in_channel_unit: bool = False

    def quantity_on(self, channel: str) -> Quantity | None:
        """Return the meaning of the magnitude on a channel; None if the kind has none."""
        if self.magnitude is None or not self.in_channel_unit:
            return self.magnitude
        return dataclasses.replace(self.magnitude, unit=CHANNELS[channel].unit)

    @property
    def takes_zero(self) -> bool:
        """Whether zero is a magnitude with an effect, not only a way to leave it open."""
        if self.magnitude is None or self.unchanging == 0.0:
            return False
        return not self.magnitude.exclusive and self.magnitude.minimum <= 0.0

    def default_on(self, channel: str) -> float:
        """Return the magnitude that NaN stands for on a channel."""
        return self.default * CHANNELS[channel].scale if self.in_channel_unit else self.default


def _share(description: str) -> Quantity:
    return Quantity("", description, 0.0, 1.0, exclusive=True)


def _above_zero(unit: str, description: str, greatest: float) -> Quantity:
    return Quantity(unit, description, 0.0, greatest, exclusive=True)


def _binding(description: str) -> Quantity:
    return Quantity("", description, 1.0, 1e3, exclusive=True)


KINDS: Mapping[str, Kind] = {
    "free_mass_jammed": Kind(
        True, "the free mass is wedged to the drill tool and strikes it no more"
    ),
    "lost_preload": Kind(
        True,
        "the load spring pushes less than commanded",
        _share("share of the weight on bit that is lost"),
        0.5,
    ),
    "load_spring_binding": Kind(
        True,
        "the RPUD binds in its linear guide",
        _binding("factor on the rate of the load spring"),
        5.0,
    ),
    "drill_tool_binding": Kind(
        True,
        "the bit binds in its hole",
        _binding("factor on the rate of the restoring spring, divisor of the progress"),
        5.0,
    ),
    "choking": Kind(
        True,
        "cuttings clog the hole",
        _share("share lost of the progress and of the drill tool's restitution"),
        0.8,
    ),
    "hard_rock": Kind(
        True,
        "the bit meets harder rock",
        Quantity("", "factor on the specific energy of the rock", 1.0, 1e3, exclusive=True),
        3.0,
    ),
    "resonance_drift": Kind(
        True,
        "the resonance of the actuator has moved",
        Quantity("Hz", "offset of the resonance frequency", -1e4, 1e4),
        -200.0,
        unchanging=0.0,
    ),
    "restitution_loss": Kind(
        True,
        "the impacts are less elastic",
        Quantity("", "factor on both coefficients of restitution", 0.0, 1.0, below=True),
        0.5,
    ),
    "generator_lock_loss": Kind(
        True, "the generator tracks no more and runs at the commanded frequency"
    ),
    "binding": Kind(
        True,
        "friction along the tool in its hole resists the rotation",
        _above_zero("N m", "torque of the friction", 100.0),
        0.05,
    ),
    "hard_inclusion": Kind(
        True,
        "the bit meets a stone that is harder than its layer",
        _above_zero("Pa", "strength of the stone", 1e9),
        2e8,
    ),
    "corkscrewing": Kind(
        True,
        "rock protrudes into the flutes, along which the tool screws itself in",
        _above_zero("N m", "torque of the rock that protrudes", 100.0),
        0.02,
    ),
    "bit_walk": Kind(
        True,
        "the bit walks sideways until its hole guides it",
        _above_zero("m/s", "rate at which the bit walks", 0.1),
        5e-4,
    ),
    "feed_stall": Kind(True, "the drive of the feed stands still"),
    "arm_slip": Kind(
        True,
        "the host of the arm slips away from the rock",
        _above_zero("m/s", "rate at which the host slips", 0.1),
        2e-4,
    ),
    "worn_bit": Kind(
        True,
        "the bit is worn",
        Quantity("", "factor on the area of its wear flats", 1.0, 1e4, exclusive=True),
        3.0,
    ),
    "off": Kind(False, "nothing is published"),
    "stuck": Kind(False, "the values last published are repeated with new stamps"),
    "garbage": Kind(False, "random bit patterns in place of every value"),
    "wrong": Kind(
        False,
        "plausible values that are consistently wrong",
        Quantity("", "factor on every measured number", -10.0, 10.0),
        0.5,
        unchanging=1.0,
    ),
    "slow": Kind(
        False,
        "messages go out at a lower rate",
        Quantity("s", "period in which at most one message goes out", 0.0, 1e3, exclusive=True),
        0.5,
    ),
    "delayed": Kind(
        False,
        "every message comes late",
        Quantity("s", "time by which a message is late", 0.0, 10.0, exclusive=True),
        0.5,
    ),
    "intermittent": Kind(
        False,
        "messages are lost at random",
        Quantity("", "probability that a message is lost", 0.0, 1.0, exclusive=True),
        0.5,
    ),
    "noise": Kind(
        False,
        "Gaussian noise on the main quantity",
        Quantity("", "standard deviation", 0.0, 1e6, exclusive=True),
        1.0,
        in_channel_unit=True,
    ),
    "bias": Kind(
        False,
        "a constant offset on the main quantity",
        Quantity("", "offset", -1e6, 1e6),
        1.0,
        unchanging=0.0,
        in_channel_unit=True,
    ),
}


def number_of(value: Any) -> float | None:
    """Return a value as a float, infinite if it is too large; None if it is no number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def check_kind(kind: Any, possible: Iterable[str]) -> None:
    """Raise a FaultError for a kind that does not exist, with the nearest and the possible ones."""
    if not (isinstance(kind, str) and kind in KINDS):
        raise FaultError(
            f"fault kind = {shown(kind)} is unknown{suggestion(kind, KINDS)}; "
            f"possible are {', '.join(possible)}"
        )


@dataclasses.dataclass(frozen=True)
class Fault:
    """Fault, immutable."""

    kind: str  # one of ``KINDS``
    channel: str = ""  # one of ``CHANNELS`` for a signal fault, empty for a physical one
    # in the unit of the kind; NaN stands for the kind's default. Kinds without a magnitude
    # take NaN or zero; it is kept as zero.
    magnitude: float = math.nan

    def __post_init__(self) -> None:
        check_kind(self.kind, KINDS)
        self._check_channel()
        object.__setattr__(self, "magnitude", self._checked_magnitude())

    def __str__(self) -> str:
        """The fault's name, as in ``noise on wrench``."""
        return f"{self.kind} on {self.channel}" if self.channel else self.kind

    @property
    def physical(self) -> bool:
        """Whether it changes the drill; otherwise it changes the messages of its channel."""
        return KINDS[self.kind].physical

    def _check_channel(self) -> None:
        if self.physical:
            if self.channel != "":
                raise FaultError(
                    f"{self.kind} is a fault of the drill and has no channel, "
                    f"given {shown(self.channel)}"
                )
        elif self.channel in GROUND_TRUTH:
            raise FaultError(
                f"{self.kind} on {self.channel} is refused: it is the ground truth; "
                f"channels that may fail are {', '.join(CHANNELS)}"
            )
        elif not (isinstance(self.channel, str) and self.channel in CHANNELS):
            raise FaultError(
                f"channel of {self.kind} = {shown(self.channel)} is not one of "
                f"{', '.join(CHANNELS)}{suggestion(self.channel, CHANNELS)}"
            )

    def _checked_magnitude(self) -> float:
        kind = KINDS[self.kind]
        quantity = kind.quantity_on(self.channel)
        number = number_of(self.magnitude)
        if number is None:
            raise FaultError(f"magnitude of {self} = {shown(self.magnitude)} is not a number")
        if quantity is None:
            if not (math.isnan(number) or number == 0.0):
                raise FaultError(f"{self} has no magnitude, given {number:g}")
            return 0.0
        default = kind.default_on(self.channel)
        if math.isnan(number):
            return default
        hint = f"NaN stands for the default {default:g} {quantity.unit}".rstrip()
        try:
            quantity.check(f"magnitude of {self}", number)
        except ParameterError as error:
            raise FaultError(f"{error}; {hint}") from None
        if number == kind.unchanging:
            raise FaultError(f"magnitude of {self} = {number:g} would change nothing; {hint}")
        return number
