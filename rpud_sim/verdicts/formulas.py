"""Formulas of expectations: signals, events and time, and the words that write them in Python.

``docs/reference/expectations.md`` defines what each means. Times are integer nanoseconds.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from typing import Any

from rpud_sim.foundation.quantities import shown
from rpud_sim.simulation.faults import Fault
from rpud_sim.verdicts.units import ExpectationError, parse_duration, parse_quantity

OPERATORS = ("<", "<=", ">", ">=", "==", "!=")
_SIGNAL = re.compile(r"([A-Za-z/][\w/]*)\.(\S.*)")


@dataclasses.dataclass(frozen=True)
class Window:
    """Closed interval of time after an instant."""

    start: int = 0  # first nanosecond after the instant
    end: int | None = None  # last nanosecond after it; None for the end of the recording

    def __post_init__(self) -> None:
        if self.end is not None and self.end < self.start:
            raise ExpectationError(
                f"between {self.start / 1e9:g} s and {self.end / 1e9:g} s ends before it begins"
            )


WHOLE = Window()  # the rest of the recording


class Formula:
    """Base of all formulas; ``&``, ``|`` and ``~`` are and, or and not."""

    def __and__(self, other: Formula) -> And:
        return And((self, other))

    def __or__(self, other: Formula) -> Or:
        return Or((self, other))

    def __invert__(self) -> Not:
        return Not(self)

    def implies(self, other: Formula) -> Implies:
        """Return the formula that ``other`` holds whenever this one does."""
        return Implies(self, other)

    def children(self) -> tuple[Formula, ...]:
        """Return the formulas in this one."""
        values = (getattr(self, field.name) for field in dataclasses.fields(self))  # type: ignore[arg-type]
        parts = (part for each in values for part in (each if type(each) is tuple else (each,)))
        return tuple(part for part in parts if isinstance(part, Formula))

    def walk(self) -> Iterator[Formula]:
        """Yield this formula and all in it."""
        yield self
        for child in self.children():
            yield from child.walk()


class Event(Formula):
    """Base of formulas that hold at single nanoseconds."""


@dataclasses.dataclass(frozen=True)
class Signal:
    """Field of a topic over time. A message's value holds until the next message."""

    topic: str  # relative name of one of the drill's topics, or any absolute name
    field: str  # with dots and numbers in brackets, as in ``position[1]``
    hold: int | None = None  # longest time for which a value holds [ns]; None for that of the topic

    def __str__(self) -> str:
        return f"{self.topic}.{self.field}"

    def __lt__(self, value: str | float) -> Compare:
        return self.compare("<", value)

    def __le__(self, value: str | float) -> Compare:
        return self.compare("<=", value)

    def __gt__(self, value: str | float) -> Compare:
        return self.compare(">", value)

    def __ge__(self, value: str | float) -> Compare:
        return self.compare(">=", value)

    def compare(self, operator: str, value: str | float, tolerance: str | float = 0.0) -> Compare:
        """Return a comparison; texts are numbers with units, as ``45 N``."""
        return Compare(self, operator, to_number(value), to_number(tolerance))

    def equals(self, value: str | float, tolerance: str | float = 0.0) -> Compare:
        """Return the comparison for a value that differs by ``tolerance`` at most."""
        return self.compare("==", value, tolerance)

    def says(self, word: str | bool) -> Says:
        """Return the formula that a text or a truth value is ``word``."""
        flags = {"true": True, "false": False}
        return Says(self, flags.get(word, word) if isinstance(word, str) else word)


@dataclasses.dataclass(frozen=True)
class Number:
    """Number with a unit as it was written."""

    value: float
    unit: str = ""

    def __str__(self) -> str:
        text = f"{self.value:g}"
        return f"{text if float(text) == self.value else repr(self.value)} {self.unit}".rstrip()


def to_number(value: str | float) -> Number:
    """Return a number from a text such as ``45 N``, or from a number without a unit."""
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise ExpectationError(f"{shown(value)} is not a number with a unit, such as 45 N")
    return Number(*parse_quantity(value if isinstance(value, str) else repr(float(value))))


@dataclasses.dataclass(frozen=True)
class Compare(Formula):
    """A signal compared with a number."""

    signal: Signal  # of numbers
    operator: str  # one of ``OPERATORS``
    number: Number  # to compare with
    # greatest difference of equal numbers; only with ``==`` and ``!=``
    tolerance: Number = Number(0.0)

    def __post_init__(self) -> None:
        _check_operator(self.operator)
        if self.tolerance.value and self.operator not in ("==", "!="):
            raise ExpectationError(f"a tolerance goes with == and !=, not with {self.operator}")
        if self.tolerance.value < 0.0:
            raise ExpectationError(f"tolerance = {self.tolerance} is below zero")


@dataclasses.dataclass(frozen=True)
class Says(Formula):
    """A text or truth value of a signal is a certain one."""

    signal: Signal
    word: str | bool

    def __post_init__(self) -> None:
        word = self.word
        fits = isinstance(word, bool) or (isinstance(word, str) and word == word.strip() != "")
        if not fits or word in ("true", "false"):
            raise ExpectationError(f"{self.signal} is {shown(word)}: that is no word")


@dataclasses.dataclass(frozen=True)
class _OfFault:
    fault: str  # a kind, or ``KIND on CHANNEL``

    def __post_init__(self) -> None:
        if not isinstance(self.fault, str):
            raise ExpectationError(f"fault = {shown(self.fault)} is not a kind of fault")
        Fault(*self.kind_and_channel)

    @property
    def kind_and_channel(self) -> tuple[str, str]:
        kind, _, channel = self.fault.partition(" on ")
        return kind.strip(), channel.strip()


class Active(_OfFault, Formula):
    """A fault lasts: from its onset to just before its clearing."""


class Onset(_OfFault, Event):
    """A fault begins."""


class Cleared(_OfFault, Event):
    """A fault ends."""


@dataclasses.dataclass(frozen=True)
class Message(Event):
    """A message of a topic, at its stamp."""

    topic: str  # as in ``Signal``
    # comparison of a field of the same message; None for every message
    where: Compare | Says | None = None

    def __post_init__(self) -> None:
        if self.where is not None and self.where.signal.topic != self.topic:
            raise ExpectationError(
                f"a message of {self.topic} has no {self.where.signal}; name a field of its topic"
            )


@dataclasses.dataclass(frozen=True)
class Becomes(Event):
    """A formula begins to hold; also at the first instant, if it holds there."""

    formula: Formula


@dataclasses.dataclass(frozen=True)
class Not(Formula):
    """The formula does not hold."""

    formula: Formula


@dataclasses.dataclass(frozen=True)
class _Several(Formula):
    formulas: tuple[Formula, ...]

    def __post_init__(self) -> None:
        if not self.formulas:
            raise ExpectationError("all and any need at least one formula")


class And(_Several):
    """All formulas hold."""


class Or(_Several):
    """At least one formula holds."""


@dataclasses.dataclass(frozen=True)
class Implies(Formula):
    """If the first holds, so does the second."""

    condition: Formula
    formula: Formula


@dataclasses.dataclass(frozen=True)
class _OverWindow(Formula):
    formula: Formula
    window: Window = WHOLE


class Always(_OverWindow):
    """The formula holds at every instant of a window."""


class Eventually(_OverWindow):
    """The formula holds at some instant of a window."""


@dataclasses.dataclass(frozen=True)
class Until(Formula):
    """The goal comes in a window, and the formula holds until just before."""

    formula: Formula  # that holds
    goal: Formula  # that comes
    window: Window = WHOLE  # in which it comes
    weak: bool = False  # whether the goal may never come, if the formula always holds

    def __post_init__(self) -> None:
        if self.weak and self.window != WHOLE:
            raise ExpectationError("unless has no window: its goal may come at any time, or never")


@dataclasses.dataclass(frozen=True)
class After(Formula):
    """The formula holds at every instant of an event; undecided if the event never comes."""

    trigger: Formula  # an event; another formula stands for the instants at which it begins to hold
    formula: Formula  # that holds then


@dataclasses.dataclass(frozen=True)
class Count(Formula):
    """The number of events in a window, or before a goal holds, compared."""

    event: Event
    operator: str
    number: float
    window: Window = WHOLE
    until: Formula | None = None  # the goal, in place of a window

    def __post_init__(self) -> None:
        _check_operator(self.operator)
        if self.until is not None and self.window != WHOLE:
            raise ExpectationError("a count has a window or an until, not both")
        if not 0.0 <= self.number < 1e15:
            raise ExpectationError(f"count = {self.number:g} is outside its range [0, 1e15)")


@dataclasses.dataclass(frozen=True)
class Quantile(Formula):
    """A quantile of the messages' values in a window, compared."""

    share: float  # at least this share of the values is at most the quantile; in (0, 1]
    signal: Signal  # of numbers
    operator: str  # as in ``Compare``
    number: Number  # as in ``Compare``
    window: Window = WHOLE  # of the messages' stamps

    def __post_init__(self) -> None:
        _check_operator(self.operator)
        if not 0.0 < self.share <= 1.0:
            raise ExpectationError(f"quantile = {self.share:g} is outside its range (0, 1]")


def _check_operator(operator: str) -> None:
    if operator not in OPERATORS:
        raise ExpectationError(f"{shown(operator)} is not one of {', '.join(OPERATORS)}")


def signal(name: str, hold: str | float | None = None) -> Signal:
    """Return a signal by topic and field, as in ``reacting_force.force``.

    A value holds at most for ``hold``, as ``0.1 s``; None for that of the topic.
    """
    match = _SIGNAL.fullmatch(name) if isinstance(name, str) else None
    if match is None:
        raise ExpectationError(f"{shown(name)} is not a topic and a field, as reacting_force.force")
    topic = "/diagnostics" if match[1] == "diagnostics" else match[1]
    return Signal(topic, match[2], None if hold is None else parse_duration(hold, "hold"))


def window(within: Any = None, between: Any = None) -> Window:
    """Return a window from its end, or from start and end; of neither, the rest of the recording.

    Both are as ``0.5 s``; an end of None is that of the recording.
    """
    if within is not None and between is not None:
        raise ExpectationError("within and between exclude each other")
    if between is None:
        return WHOLE if within is None else Window(0, parse_duration(within, "within"))
    if not isinstance(between, (list, tuple)) or len(between) != 2:
        raise ExpectationError(f"between = {shown(between)} is not [start, end], as [1 s, 2 s]")
    first, last = between
    end = None if last is None else parse_duration(last, "between")
    return Window(parse_duration(first, "between"), end)


def always(formula: Formula, within: Any = None, between: Any = None) -> Always:
    """Return the formula that ``formula`` holds at every instant of a window."""
    return Always(formula, window(within, between))


def eventually(formula: Formula, within: Any = None, between: Any = None) -> Eventually:
    """Return the formula that ``formula`` holds at some instant of a window."""
    return Eventually(formula, window(within, between))


def until(formula: Formula, goal: Formula, within: Any = None, between: Any = None) -> Until:
    """Return the formula that ``goal`` comes in a window and ``formula`` holds until then."""
    return Until(formula, goal, window(within, between))


def unless(formula: Formula, goal: Formula) -> Until:
    """Return the formula that ``formula`` holds until ``goal`` comes, or always."""
    return Until(formula, goal, WHOLE, True)


def after(trigger: Formula, formula: Formula) -> After:
    """Return the formula that ``formula`` holds at each instant of ``trigger``."""
    return After(trigger, formula)


def count(
    event: Event,
    operator: str,
    number: float,
    within: Any = None,
    between: Any = None,
    until: Formula | None = None,
) -> Count:
    """Return the comparison of the number of events in a window, or before ``until`` holds."""
    return Count(event, operator, float(number), window(within, between), until)


def quantile(
    share: float,
    of: Signal,
    operator: str,
    number: str | float,
    within: Any = None,
    between: Any = None,
) -> Quantile:
    """Return the comparison of a quantile of a signal's messages in a window."""
    return Quantile(float(share), of, operator, to_number(number), window(within, between))
