"""Words of expectations: immutable formulas over signals, events and time.

``docs/reference/expectations.md`` defines what each means. Times are integer nanoseconds.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from rpud_sim.foundation.quantities import shown
from rpud_sim.simulation.faults import Fault
from rpud_sim.verdicts.units import ExpectationError, parse_quantity

OPERATORS = ("<", "<=", ">", ">=", "==", "!=")


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
        """Both hold."""
        return And((self, other))

    def __or__(self, other: Formula) -> Or:
        """At least one holds."""
        return Or((self, other))

    def __invert__(self) -> Not:
        """It does not hold."""
        return Not(self)

    def implies(self, other: Formula) -> Implies:
        """Return the formula that ``other`` holds whenever this one does."""
        return Implies(self, other)

    def children(self) -> tuple[Formula, ...]:
        """Return the formulas in this one."""
        found = (getattr(self, field.name) for field in dataclasses.fields(self))  # type: ignore[arg-type]
        return tuple(
            part
            for value in found
            for part in (value if isinstance(value, tuple) else (value,))
            if isinstance(part, Formula)
        )

    def walk(self) -> Iterator[Formula]:
        """Yield this formula and all in it."""
        yield self
        for child in self.children():
            yield from child.walk()


@dataclasses.dataclass(frozen=True)
class Signal:
    """Field of a topic over time. A message's value holds until the next message."""

    topic: str  # relative name of one of the drill's topics, or any absolute name
    field: str  # with dots and numbers in brackets, as in ``position[1]``
    hold: int | None = None  # longest time for which a value holds [ns]; None for that of the topic

    def __str__(self) -> str:
        """Topic and field with a dot."""
        return f"{self.topic}.{self.field}"

    def __lt__(self, value: str | float) -> Compare:
        """Less than a number with a unit."""
        return self.compare("<", value)

    def __le__(self, value: str | float) -> Compare:
        """At most a number with a unit."""
        return self.compare("<=", value)

    def __gt__(self, value: str | float) -> Compare:
        """More than a number with a unit."""
        return self.compare(">", value)

    def __ge__(self, value: str | float) -> Compare:
        """At least a number with a unit."""
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
        """Number and unit."""
        text = f"{self.value:g}"
        return f"{text if float(text) == self.value else repr(self.value)} {self.unit}".rstrip()


def to_number(value: str | float) -> Number:
    """Return a number from a text such as ``45 N``, or from a number without a unit."""
    if isinstance(value, str):
        return Number(*parse_quantity(value))
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ExpectationError(f"{shown(value)} is not a number with a unit, such as 45 N")
    return Number(*parse_quantity(repr(float(value))))


def _check_operator(operator: str) -> None:
    if operator not in OPERATORS:
        raise ExpectationError(f"{shown(operator)} is not one of {', '.join(OPERATORS)}")


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
class Active(Formula):
    """A fault lasts: from its onset to just before its clearing."""

    fault: str  # a kind, or ``KIND on CHANNEL``

    def __post_init__(self) -> None:
        _check_fault(self.fault)


class Event(Formula):
    """Base of formulas that hold at single nanoseconds."""


@dataclasses.dataclass(frozen=True)
class Onset(Event):
    """A fault begins."""

    fault: str

    def __post_init__(self) -> None:
        _check_fault(self.fault)


@dataclasses.dataclass(frozen=True)
class Cleared(Event):
    """A fault ends."""

    fault: str

    def __post_init__(self) -> None:
        _check_fault(self.fault)


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
class And(Formula):
    """All formulas hold."""

    formulas: tuple[Formula, ...]

    def __post_init__(self) -> None:
        _check_some(self.formulas)


@dataclasses.dataclass(frozen=True)
class Or(Formula):
    """At least one formula holds."""

    formulas: tuple[Formula, ...]

    def __post_init__(self) -> None:
        _check_some(self.formulas)


@dataclasses.dataclass(frozen=True)
class Implies(Formula):
    """If the first holds, so does the second."""

    condition: Formula
    formula: Formula


@dataclasses.dataclass(frozen=True)
class Always(Formula):
    """The formula holds at every instant of a window."""

    formula: Formula
    window: Window = WHOLE


@dataclasses.dataclass(frozen=True)
class Eventually(Formula):
    """The formula holds at some instant of a window."""

    formula: Formula
    window: Window = WHOLE


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


def _check_some(formulas: tuple[Formula, ...]) -> None:
    if not formulas:
        raise ExpectationError("all and any need at least one formula")


def split_fault(fault: str) -> tuple[str, str]:
    """Return kind and channel of a fault's name, such as ``noise on wrench``."""
    kind, _, channel = fault.partition(" on ")
    return kind.strip(), channel.strip()


def _check_fault(fault: str) -> None:
    if not isinstance(fault, str):
        raise ExpectationError(f"fault = {shown(fault)} is not a kind of fault")
    Fault(*split_fault(fault))
