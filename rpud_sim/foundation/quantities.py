"""Allowed values, each with its check: numbers with unit and range, choices, flags and texts.

A frozen dataclass that inherits from ``ParameterGroup`` declares each parameter by one field:

    free_mass: float = number(5e-3, "kg", "mass of the free mass, m_fm", 0.0, 10.0, exclusive=True)

Checks, parameter files, ROS descriptors and ``--set`` derive from it.
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

_MOST_LISTED = 30  # names in a message
_MOST_CLOSE = 3  # names that end with an unknown one


class ExpectedError(Exception):
    """Base of the errors of this package: failure that ends a command with its text as one line.

    ``code`` is the exit code of the command, by default the one of the class.
    """

    code = 1  # 2 for a usage error

    def __init__(self, reason: object = "", code: int | None = None) -> None:
        super().__init__(str(reason))
        self.code = type(self).code if code is None else code


class ParameterError(ExpectedError, ValueError):
    """Unusable parameter; the text names parameter, value, unit and allowed range."""

    code = 2


class ExpectedWarning(UserWarning):
    """What a user should know of a result that is whole, as one line."""


def short_repr(value: Any) -> str:
    """Return any value as short text on one line."""
    try:
        return reprlib.repr(value)
    except ValueError:  # an integer with more digits than Python writes
        return "a number too long to show"


# Characters of a name, and of an explaining text: longer ones are rejected or cut off, for any
# node that reaches the drill could fill its memory with them.
LONGEST_NAME = 256
LONGEST_TEXT = 4096


def truncated(text: str, most: int = LONGEST_TEXT) -> str:
    """Return a text whose end is left out if it has more characters."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def short_name(name: Any) -> str:
    """Return a user's name as short text on one line, in quotes unless it is a plain name."""
    plain = isinstance(name, str) and name.isprintable() and len(name) <= 60
    return name if plain else short_repr(name)


def counted(count: int, noun: str) -> str:
    """Return a number of things, as ``1 impact`` or ``2 impacts``."""
    return f"{count} {noun}{'s' * (count != 1)}"


def joined(names: Iterable[str]) -> str:
    """Return names in one line, with at most 30 of them and 80 characters of each."""
    found = sorted(names)
    more = f" and {len(found) - _MOST_LISTED} more" if len(found) > _MOST_LISTED else ""
    return ", ".join(f"{name:.80}" for name in found[:_MOST_LISTED]) + more or "none"


def did_you_mean(name: Any, known: Iterable[str], others: bool = True) -> str:
    """Return a hint that continues an error: ``; did you mean x?`` with the nearest known name.

    If none is near, it lists the known names, or is empty without ``others``. A name without a
    slash is compared with the last parts of the known ones.
    """
    known = list(known)
    path = isinstance(name, str) and "/" in name
    parts = {each if path else each.rpartition("/")[2]: each for each in reversed(known)}
    close = [part for part in parts if part.endswith(f"_{name}")]
    if not 1 < len(close) <= _MOST_CLOSE:
        # Names of topics begin alike, and names of files end alike.
        cutoff = 0.8 if path or "." in str(name) else 0.6
        searched = isinstance(name, str) and len(name) <= LONGEST_NAME  # a long one takes seconds
        close = difflib.get_close_matches(name, parts, n=1, cutoff=cutoff) if searched else []
    if close:
        return f"; did you mean {joined(parts[part] for part in close)}?"
    if not others:
        return ""
    which = "valid ones"
    if len(known) > _MOST_LISTED:
        which = f"the nearest of {len(known)}"
        known = difflib.get_close_matches(f"{name!s:.80}", known, n=3, cutoff=0.0)
    return f"; {which} are {', '.join(f'{each:.80}' for each in known) or 'none'}"


def check_names(names: Iterable[Any], known: Iterable[str], what: str = "parameter") -> None:
    known = tuple(known)
    for name in names:
        if name not in known:
            raise ParameterError(f"{short_name(name)} is not a {what}{did_you_mean(name, known)}")


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
        """Return the value as a float, or an integer if it must be whole, or reject it."""
        # The usual case first: studies check millions of values.
        if type(value) is float and self.minimum < value < self.maximum and not self.whole:
            return value
        number = as_number(value)
        above = number > self.minimum if self.exclusive else number >= self.minimum
        under = number < self.maximum if self.below else number <= self.maximum
        unit = f" {self.unit}" if self.unit else ""
        is_number = isinstance(value, Real) and not isinstance(value, bool)
        if not is_number:
            raise ParameterError(
                f"{name} = {short_repr(value)} is not a number; its range is {self.range}"
            )
        if not (math.isfinite(number) and above and under):
            plain = isinstance(value, Real) and not isinstance(value, int)
            text = f"{number:g}" if plain else short_repr(value)
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
            raise ParameterError(f"{name} = {short_repr(value)} is not {self.range}")
        return value


@dataclasses.dataclass(frozen=True)
class Flag:
    """A truth value."""

    description: str  # one phrase
    range: str = dataclasses.field(default="true or false", init=False)

    def check(self, name: str, value: Any) -> bool:
        if not isinstance(value, bool):
            raise ParameterError(f"{name} = {short_repr(value)} is not true or false")
        return value


@dataclasses.dataclass(frozen=True)
class Text:
    """A text."""

    description: str  # one phrase
    range: str  # allowed texts, in words
    longest: int = LONGEST_TEXT  # characters

    def check(self, name: str, value: Any) -> str:
        if not isinstance(value, str):
            raise ParameterError(f"{name} = {short_repr(value)} is not a text")
        if len(value) > self.longest:
            raise ParameterError(
                f"{name} has {len(value)} characters; allowed are {self.longest} at most"
            )
        return value


Allowed = Quantity | Choice | Flag | Text


@dataclasses.dataclass(frozen=True)
class Declaration:
    """Declaration of a parameter."""

    name: str  # name of the parameter
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
    """Base of frozen dataclasses whose fields declare parameters; rejects what is not allowed."""

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
