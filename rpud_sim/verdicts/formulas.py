"""Formulas of expectations: signals, events and time.

``docs/reference/expectations.md`` defines what each means, and ``Evaluation`` computes it.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Iterator

from rpud_sim.foundation.quantities import ParameterError, short_repr
from rpud_sim.simulation.faults import Fault
from rpud_sim.verdicts.units import (
    WHOLE,
    ZERO,
    Number,
    Window,
    to_number,
)

OPERATORS = ("<", "<=", ">", ">=", "==", "!=")


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

    def __str__(self) -> str:
        return f"{self.topic}.{self.field}"

    def __repr__(self) -> str:
        return f"signal({str(self)!r})"

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

    def has_text(self, word: str | bool) -> HasText:
        """Return the formula that a text or a truth value is ``word``."""
        flags = {"true": True, "false": False}
        return HasText(self, flags.get(word, word) if isinstance(word, str) else word)

    def says(self, word: str | bool) -> HasText:
        """Return ``has_text``, which 0.3 named so."""
        warnings.warn("says is now has_text", DeprecationWarning, stacklevel=2)
        return self.has_text(word)


@dataclasses.dataclass(frozen=True)
class Compare(Formula):
    """A signal compared with a number."""

    signal: Signal  # of numbers
    operator: str  # one of ``OPERATORS``
    number: Number  # to compare with
    # greatest difference of equal numbers; only with ``==`` and ``!=``
    tolerance: Number = ZERO

    def __post_init__(self) -> None:
        _check_operator(self.operator)
        if self.tolerance.value and self.operator not in ("==", "!="):
            raise ParameterError(f"a tolerance goes with == and !=, not with {self.operator}")
        if self.tolerance.value < 0.0:
            raise ParameterError(f"tolerance = {self.tolerance} is below zero")

    def __str__(self) -> str:
        tolerance = f" +- {self.tolerance}" if self.tolerance != ZERO else ""
        return f"{self.signal} {self.operator} {self.number}{tolerance}"


@dataclasses.dataclass(frozen=True)
class HasText(Formula):
    """A text or truth value of a signal is a certain one."""

    signal: Signal
    word: str | bool

    def __post_init__(self) -> None:
        word = self.word
        fits = isinstance(word, bool) or (isinstance(word, str) and word == word.strip() != "")
        if not fits or word in ("true", "false"):
            raise ParameterError(f"{self.signal} is {short_repr(word)}: that is not a word")

    def __str__(self) -> str:
        word = str(self.word).lower() if isinstance(self.word, bool) else self.word
        return f"{self.signal} is {word}"


@dataclasses.dataclass(frozen=True)
class _OfFault:
    fault: str  # a kind, or ``KIND on CHANNEL``

    def __post_init__(self) -> None:
        if not isinstance(self.fault, str):
            raise ParameterError(f"fault = {short_repr(self.fault)} is not a kind of fault")
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
class Published(Event):
    """A message of a topic, at its stamp."""

    topic: str  # as in ``Signal``
    # comparison of a field of the same message; None for every message
    where: Compare | HasText | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.where, Compare | HasText | None):
            raise ParameterError("where is not a comparison")
        if self.where is not None and self.where.signal.topic != self.topic:
            raise ParameterError(
                f"a message of {self.topic} has no {self.where.signal}; name a field of its topic"
            )


@dataclasses.dataclass(frozen=True)
class Becomes(Event):
    """A formula begins to hold; also at the start of the recording, if it holds there."""

    formula: Formula

    def __post_init__(self) -> None:
        if isinstance(self.formula, Event):
            raise ParameterError("an event is an instant, and becomes nothing")


@dataclasses.dataclass(frozen=True)
class Not(Formula):
    """The formula does not hold."""

    formula: Formula


@dataclasses.dataclass(frozen=True)
class _Several(Formula):
    formulas: tuple[Formula, ...]

    def __post_init__(self) -> None:
        if not self.formulas:
            raise ParameterError("all and any need at least one formula")


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
            raise ParameterError("unless has no window: its goal may come at any time, or never")


@dataclasses.dataclass(frozen=True)
class After(Formula):
    """The formula holds at every instant of an event; undecided if the event never comes."""

    trigger: Formula  # an event; another formula gives the instants at which it begins to hold
    formula: Formula  # that holds then


@dataclasses.dataclass(frozen=True)
class Count(Formula):
    """The number of events in a window, compared."""

    event: Event
    operator: str
    number: float
    window: Window = WHOLE

    def __post_init__(self) -> None:
        _check_operator(self.operator)
        if not isinstance(self.event, Event):
            raise ParameterError("count needs an event: onset, cleared, message or becomes")
        if not 0.0 <= self.number < 1e15:
            raise ParameterError(f"count = {self.number:g} is outside its range [0, 1e15)")


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
            raise ParameterError(f"quantile = {self.share:g} is outside its range (0, 1]")


SignalFormula = Compare | HasText | Quantile


def _check_operator(operator: str) -> None:
    if operator not in OPERATORS:
        raise ParameterError(f"{short_repr(operator)} is not one of {', '.join(OPERATORS)}")
