"""Allowed values, each with its check: numbers with unit and range, choices, flags and texts.

A frozen dataclass that inherits from ``ParameterGroup`` declares each parameter by one field:

    free_mass: float = number(5e-3, "kg", "mass of the free mass, m_fm", 0.0, 10.0, exclusive=True)

Checks, parameter files, ROS descriptors and ``--set`` derive from it.

``QUANTITIES`` is the table of what people see: screens, pages and lines in a terminal show a
quantity in this one form.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import reprlib
from collections.abc import Iterable, Mapping
from functools import cache
from numbers import Real
from types import MappingProxyType
from typing import Any


class ParameterError(ValueError):
    """Unusable parameter; the text names parameter, value, unit and allowed range."""


_MOST_LISTED = 30  # names in a message


class ExpectedError(Exception):
    """Failure that ends a command with its text as one line."""

    code = 1  # that the command then exits with; 2 for a wrong call


class ExpectedWarning(UserWarning):
    """What a user should know of a result that is whole, as one line."""


def shown(value: Any) -> str:
    """Return any value as short text on one line."""
    try:
        return reprlib.repr(value)
    except ValueError:  # an integer with more digits than Python writes
        return "a number too long to show"


# Characters of a name, and of a text that says something: longer ones are refused or cut off, for
# whoever reaches the drill could fill its memory with them.
LONGEST_NAME = 256
LONGEST_TEXT = 4096


def cut(text: str, most: int = LONGEST_TEXT) -> str:
    """Return a text whose end is left out if it has more characters."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def shown_name(name: Any) -> str:
    """Return a user's name as short text on one line, in quotes unless it is a plain name."""
    plain = isinstance(name, str) and name.isprintable() and len(name) <= 60
    return name if plain else shown(name)


def listed(names: Iterable[str]) -> str:
    """Return names in one line, with at most 30 of them and 80 characters of each."""
    found = sorted(names)
    more = f" and {len(found) - _MOST_LISTED} more" if len(found) > _MOST_LISTED else ""
    return ", ".join(f"{name:.80}" for name in found[:_MOST_LISTED]) + more or "none"


def suggestion(name: Any, known: Iterable[str]) -> str:
    """Return `` (did you mean x?)`` with the nearest known name; empty if none is near.

    It is for messages that list the known names anyway, and stricter than `did_you_mean`: names of
    topics begin alike.
    """
    close = _close(name, known, 0.8)
    return f" (did you mean {close[0]}?)" if close else ""


_MOST_NAMES = 30  # that a hint lists


def did_you_mean(name: Any, known: Iterable[str]) -> str:
    """Return a hint for an unknown name: the nearest known one, or all of them if they are few."""
    known = list(known)
    close = _close(name, known, 0.6)
    if not close and len(known) > _MOST_NAMES:
        near = difflib.get_close_matches(f"{name!s:.80}", known, n=3, cutoff=0.0)
        return f"the nearest of {len(known)} are {', '.join(near)}"
    return f"did you mean {close[0]}?" if close else f"known are {', '.join(known)}"


def _close(name: Any, known: Iterable[str], cutoff: float) -> list[str]:
    if not isinstance(name, str) or len(name) > LONGEST_NAME:  # a long one takes seconds
        return []
    return difflib.get_close_matches(name, known, n=1, cutoff=cutoff)


def check_names(names: Iterable[Any], known: Iterable[str], what: str = "parameter") -> None:
    known = tuple(known)
    for name in names:
        if name not in known:
            raise ParameterError(f"{shown_name(name)} is not a {what}; {did_you_mean(name, known)}")


def as_number(value: Any) -> float:
    """Return a number of Python or NumPy as a float; NaN for anything else, also a truth value."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf


@dataclasses.dataclass(frozen=True)
class Quantity:
    """Number with its unit, meaning and allowed range."""

    unit: str  # SI unit, empty for a pure number
    description: str  # one phrase, with the paper's symbol
    minimum: float  # least allowed value
    maximum: float  # greatest allowed value
    exclusive: bool = False  # whether the minimum itself is forbidden
    below: bool = False  # whether the maximum itself is forbidden
    whole: bool = False  # whether only whole numbers are allowed

    @property
    def range(self) -> str:
        """Text, for example ``(0, 100] kg``."""
        left = "(" if self.exclusive else "["
        right = ")" if self.below else "]"
        return f"{left}{self.minimum:g}, {self.maximum:g}{right} {self.unit}".rstrip()

    def check(self, name: str, value: Any) -> Any:
        """Return the value as a float, or an integer if it must be whole, or refuse it."""
        # The usual case first: studies check millions of values.
        if type(value) is float and self.minimum < value < self.maximum and not self.whole:
            return value
        number = as_number(value)
        above = number > self.minimum if self.exclusive else number >= self.minimum
        under = number < self.maximum if self.below else number <= self.maximum
        unit = f" {self.unit}" if self.unit else ""
        if not (math.isfinite(number) and above and under):
            plain = isinstance(value, Real) and not isinstance(value, int)
            text = f"{number:g}" if plain else shown(value)
            raise ParameterError(f"{name} = {text}{unit} is outside its range {self.range}")
        if not self.whole:
            return number
        if not number.is_integer():
            raise ParameterError(f"{name} = {number:g}{unit} is not a whole number")
        return int(value)


@dataclasses.dataclass(frozen=True)
class Choice:
    """One of several words."""

    description: str  # one phrase
    choices: tuple[str, ...]  # the words

    @property
    def range(self) -> str:
        return f"one of {', '.join(self.choices)}"

    def check(self, name: str, value: Any) -> str:
        if not (isinstance(value, str) and value in self.choices):
            raise ParameterError(f"{name} = {shown(value)} is not {self.range}")
        return value


@dataclasses.dataclass(frozen=True)
class Flag:
    """A truth value."""

    description: str  # one phrase
    range: str = dataclasses.field(default="true or false", init=False)

    def check(self, name: str, value: Any) -> bool:
        if not isinstance(value, bool):
            raise ParameterError(f"{name} = {shown(value)} is not true or false")
        return value


@dataclasses.dataclass(frozen=True)
class Text:
    """A text."""

    description: str  # one phrase
    range: str  # which texts are allowed, in words
    longest: int = LONGEST_TEXT  # characters

    def check(self, name: str, value: Any) -> str:
        if not isinstance(value, str):
            raise ParameterError(f"{name} = {shown(value)} is not a text")
        if len(value) > self.longest:
            raise ParameterError(
                f"{name} has {len(value)} characters; allowed are {self.longest} at most"
            )
        return value


Allowed = Quantity | Choice | Flag | Text


@dataclasses.dataclass(frozen=True)
class Declaration:
    """Declaration of a parameter."""

    name: str  # of the parameter
    default: Any  # its value if none is given
    allowed: Allowed  # meaning and allowed values
    changeable: bool  # whether it may change while the drill runs


def number(
    default: float,
    unit: str,
    description: str,
    minimum: float,
    maximum: float,
    *,
    exclusive: bool = False,
    below: bool = False,
    whole: bool = False,
    changeable: bool = False,
) -> Any:
    allowed = Quantity(unit, description, minimum, maximum, exclusive, below, whole)
    return _field(default, allowed, changeable)


def choice(
    default: str, choices: tuple[str, ...], description: str, *, changeable: bool = False
) -> Any:
    return _field(default, Choice(description, choices), changeable)


def flag(default: bool, description: str) -> Any:
    return _field(default, Flag(description), False)


def text(default: str, range: str, description: str, longest: int = LONGEST_TEXT) -> Any:
    return _field(default, Text(description, range, longest), False)


def _field(default: Any, allowed: Allowed, changeable: bool) -> Any:
    return dataclasses.field(
        default=default, metadata={"allowed": allowed, "changeable": changeable}
    )


class ParameterGroup:
    """Base of frozen dataclasses whose fields declare parameters; refuses what is not allowed."""

    def __post_init__(self) -> None:
        group: Any = type(self)
        for name, declaration in declarations(group).items():
            given = getattr(self, name)
            if (value := declaration.allowed.check(name, given)) is not given:
                object.__setattr__(self, name, value)


@cache
def declarations(group: type) -> Mapping[str, Declaration]:
    """Return the declarations of a group by name, without fields that declare nothing."""
    fields = [field for field in dataclasses.fields(group) if field.metadata]
    return MappingProxyType(
        {field.name: Declaration(field.name, field.default, **field.metadata) for field in fields}
    )


def quantities(group: type) -> Mapping[str, Quantity]:
    return {
        name: declaration.allowed
        for name, declaration in declarations(group).items()
        if isinstance(declaration.allowed, Quantity)
    }


# Units in which quantities are shown, with the SI unit and the factor from it.
_UNITS = {
    "kN": ("N", 1e-3),
    "kHz": ("Hz", 1e-3),
    "mm": ("m", 1e3),
    "mm/s": ("m/s", 1e3),
    "ms": ("s", 1e3),
    "mJ": ("J", 1e3),
    "mN m": ("N m", 1e3),
    "mm/min": ("m/s", 6e4),
    "µm": ("m", 1e6),
    "µs": ("s", 1e6),
    "mm³": ("m^3", 1e9),
    "/s": ("1/s", 1.0),
    "°C": ("degC", 1.0),
}
NONE = "\N{EN DASH}"  # in place of a value that is not there
_PREFIXES = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}
# Units that are shown with a prefix; angles, and what has no unit, stay as they are.
_SCALED = ("m", "m/s", "N", "N s", "J", "W", "s", "V", "A", "Hz", "Pa", "C", "ohm", "F", "H")


@dataclasses.dataclass(frozen=True)
class ShownQuantity:
    """Quantity of a drill, and how it is shown; values are in SI units elsewhere."""

    name: str  # such as ``peak_force``
    label: str  # such as ``peak force``
    unit: str  # in which it is shown
    scale: float = 1.0  # from the SI unit to that one
    colour: str = "other"  # kind of quantity, which names its colour
    floor: float = 0.0  # SI; what is smaller reads 0
    types: str = ""  # of messages that have it, the best first; with the column of another name
    zero: bool = True  # whether its axis includes zero
    digits: int = 3  # significant ones
    symbol: str = ""  # of the paper

    @property
    def si(self) -> str:
        """SI unit; empty for a pure number."""
        return _UNITS.get(self.unit, (self.unit, 1.0))[0]

    @property
    def sources(self) -> list[str]:
        """``Type.column`` of messages that have it, the best first."""
        return [each if "." in each else f"{each}.{self.name}" for each in self.types.split()]

    def for_browser(self) -> dict[str, object]:
        """Return it as plain values, for the page's own script."""
        return {n: value for n, value in vars(self).items() if n not in ("types", "symbol")}

    def text(self, value: float | None, *, unit: bool = True, sign: bool = False) -> str:
        """Return a value, given in SI units, as people read it; a dash for none.

        ``sign`` shows that of a positive value too.
        """
        if value is None or not math.isfinite(value):
            return NONE
        number = number_text(0.0 if abs(value) < self.floor else value * self.scale, self.digits)
        number = f"+{number}" if sign and value > 0.0 and number != "0" else number
        return f"{number} {self.unit}" if unit and self.unit else number


def _exponent(value: float) -> int:
    """Return the power of ten of a number's first digit."""
    return int(f"{value:e}".partition("e")[2])


def number_text(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, and with all of them before the point.

    One of more than nine digits before the point has an exponent.
    """
    if not math.isfinite(value):
        return NONE
    if not value:
        return "0"
    places = max(0, digits - 1 - _exponent(value))
    text = f"{value:.{places}f}" if places <= 9 and abs(value) < 1e9 else f"{value:.{digits - 1}e}"
    return text.rstrip("0").rstrip(".") if "." in text and "e" not in text else text


# Name, label, symbol of the paper, unit, colour, floor, whether any axis will do or one with zero,
# and messages that have it.
_TABLE = """\
impact_rate | impacts | | /s | force | 1e-3 | |
peak_force | peak force | | kN | force | 0.5 | | ContactForce
contact_force | contact force | | kN | force | 0.5 | |
reacting_force | reacting force | R | N | load | 1e-6 | | ReactingForce.force
weight_on_bit | weight on bit | W | N | command | 1e-6 | | Mount Status
nodal_plane | nodal plane | | mm | plane | 1e-8 | any | NodalPlane.position
actuator | actuator tip | | mm | plane | 1e-8 | any |
free_mass | free mass | | mm | mass | 1e-8 | any |
drill_tool | drill tool | | mm | tool | 1e-8 | any | DrillTool.displacement
electrical_power | electrical power | | W | power | 1e-6 | | ActuatorState Status
actuator_power | power of the vibration | | W | power | 1e-6 | | Power Status
absorbed_power | power into tool and rock | | W | depth | 1e-6 | | Power Status
power | power | | W | power | 1e-6 | |
depth | depth | | mm | depth | 1e-9 | | Borehole Status
penetration_rate | penetration rate | | mm/min | depth | 1e-10 | | Borehole Status
torque | torque of rock and cuttings | | mN m | torque | 1e-9 | | Rotation
drive_torque | torque of the drive | | mN m | power | 1e-9 | | Rotation
rotation_rate | rotation | | rad/s | torque | 1e-6 | | Rotation.rate
mount_force | force of the arm | | N | load | 1e-6 | | Mount.force
mount_position | mount | | mm | plane | 1e-9 | any | Mount.position
feed | feed | | mm | command | 1e-9 | any | Mount
vibration_amplitude | vibration | | µm | plane | 1e-12 | | Status ActuatorState.amplitude
current | current | | A | power | 1e-9 | | ActuatorState
drive_voltage | voltage | | V | command | 1e-6 | | Status ActuatorState.voltage
drive_frequency | drive frequency | | kHz | command | 1e-3 | any | Status ActuatorState.frequency
resonance_frequency | resonance | | kHz | plane | 1e-3 | any | Status ActuatorState
temperature | stack temperature | | °C | fault | 0 | any | Status.actuator_temperature ActuatorState
packed_cuttings | packed cuttings | | mm³ | depth | 1e-13 | | Borehole
bit_wear | wear of the bit | | | tool | 1e-9 | | Borehole
lateness | latest block | | ms | other | 1e-6 | | Timing.lateness_max Status.lateness_max
feed_rate | rate of the feed | | mm/s | command | 1e-9 | |
impact_interval | impact interval | | ms | force | 1e-9 | |
impact_velocity | impact velocity | | m/s | mass | 1e-6 | |
impact_energy | impact energy | | mJ | force | 1e-9 | |
contact_duration | contact duration | | µs | force | 1e-9 | |
impact_power | power of the impacts | | W | power | 1e-6 | |
weight_power | power of weight on bit and gravity | | W | power | 1e-6 | |
load_damper_power | power lost in the load damper | | W | power | 1e-6 | |
collision_power | power lost in collisions | | W | power | 1e-6 | |
"""


def _row(text: str) -> ShownQuantity:
    name, label, symbol, unit, colour, floor, axis, types = (w.strip() for w in text.split("|"))
    scale = _UNITS.get(unit, (unit, 1.0))[1]
    return ShownQuantity(
        *(name, label, unit, scale, colour, float(floor), types), zero=not axis, symbol=symbol
    )


QUANTITIES: Mapping[str, ShownQuantity] = {
    quantity.name: quantity for quantity in map(_row, _TABLE.splitlines())
}
# Quantity of each figure of a run.
_FIGURES = {
    "drill_tool_impact_rate": "impact_rate",
    "actuator_impact_rate": "impact_rate",
    "squeezed_impact_rate": "impact_rate",
    "impact_velocity_mean": "impact_velocity",
    "contact_force_mean": "peak_force",
    "contact_force_p99": "peak_force",
    "contact_force_max": "peak_force",
    "contact_duration_mean": "contact_duration",
    "kinetic_energy_rate": "power",
    "energy_transferred_rate": "power",
    "energy_absorbed_rate": "power",
    "reacting_force_mean": "reacting_force",
    "depth": "depth",
    "penetration_rate": "penetration_rate",
}


def figure_quantity(name: str) -> ShownQuantity:
    """Return how a figure of a run is shown, by its name; its label is that name in words."""
    known = QUANTITIES.get(_FIGURES.get(name, ""), ShownQuantity("", "", ""))
    return dataclasses.replace(known, name=name, label=name.replace("_", " "))


def quantity_in(unit: str, greatest: float, label: str = "") -> ShownQuantity:
    """Return how a quantity outside the table is shown, such as a parameter.

    ``unit`` is its SI unit. ``greatest`` is its greatest size: it gets one to three digits before
    the point.
    """
    if unit == "kg" and 0.0 < greatest < 1.0:
        return ShownQuantity("", label, "g", 1e3)
    if unit not in _SCALED or not math.isfinite(greatest) or greatest <= 0.0:
        return ShownQuantity("", label, "/s" if unit == "1/s" else unit)
    exponent = min(max(3 * (_exponent(greatest) // 3), -9), 9)
    exponent = min(exponent, 0) if unit == "s" else exponent
    return ShownQuantity("", label, _PREFIXES[exponent] + unit, float(f"1e{-exponent}"))


def for_browser() -> list[dict[str, object]]:
    """Return the table as plain values, for the page's own script."""
    return [quantity.for_browser() for quantity in QUANTITIES.values()]
