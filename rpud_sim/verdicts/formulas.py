"""Formulas of expectations: signals, events and time, with their meaning on a recording.

``docs/reference/expectations.md`` defines what each means. Times are integer nanoseconds.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Protocol

from rpud_sim.foundation.quantities import shown
from rpud_sim.simulation.faults import Fault
from rpud_sim.verdicts.steps import (
    LEAST_TRUTH,
    MOST_TRUTH,
    UNKNOWN,
    Steps,
    aligned,
    beginnings,
    combine,
    negate,
    over_window,
    until,
)
from rpud_sim.verdicts.units import (
    WHOLE,
    ZERO,
    ExpectationError,
    Number,
    Window,
    to_number,
)

OPERATORS = ("<", "<=", ">", ">=", "==", "!=")


class Meaning(Protocol):
    """Meaning of formulas from ``begin`` to ``end`` [ns] of a recording; `Evaluation` gives it."""

    begin: int
    end: int

    def steps(self, formula: Formula, once: bool = False) -> Steps: ...

    def trigger(self, formula: Formula) -> Steps: ...

    def shown(self, formula: Formula, begin: int, last: int, held: bool) -> int: ...

    def active(self, part: Active) -> Steps: ...

    def compared_signal(self, part: Compare | Says) -> Steps: ...

    def event(self, event: Event) -> Steps: ...

    def count(self, formula: Count) -> Steps: ...

    def quantile(self, formula: Quantile, once: bool) -> Steps: ...


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

    def _steps(self, on: Meaning, once: bool) -> Steps:
        """Return what it means on a recording, ``once`` only at the beginning."""
        raise NotImplementedError

    def _decided(self, on: Meaning, time: int, held: bool) -> int:
        """Return the instant at which it shows that it holds at a time, or does not [ns]."""
        return time


class Event(Formula):
    """Base of formulas that hold at single nanoseconds."""

    def _steps(self, on: Meaning, once: bool) -> Steps:
        return on.event(self)


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
            raise ExpectationError(f"a tolerance goes with == and !=, not with {self.operator}")
        if self.tolerance.value < 0.0:
            raise ExpectationError(f"tolerance = {self.tolerance} is below zero")

    def _steps(self, on: Meaning, once: bool) -> Steps:
        return on.compared_signal(self)


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

    def _steps(self, on: Meaning, once: bool) -> Steps:
        return on.compared_signal(self)


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

    def _steps(self, on: Meaning, once: bool) -> Steps:
        return on.active(self)


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
        if not isinstance(self.where, Compare | Says | None):
            raise ExpectationError("where is no comparison")
        if self.where is not None and self.where.signal.topic != self.topic:
            raise ExpectationError(
                f"a message of {self.topic} has no {self.where.signal}; name a field of its topic"
            )


@dataclasses.dataclass(frozen=True)
class Becomes(Event):
    """A formula begins to hold; also at the first instant, if it holds there."""

    formula: Formula

    def _steps(self, on: Meaning, once: bool) -> Steps:
        return beginnings(on.steps(self.formula))


@dataclasses.dataclass(frozen=True)
class Not(Formula):
    """The formula does not hold."""

    formula: Formula

    def _steps(self, on: Meaning, once: bool) -> Steps:
        return negate(on.steps(self.formula, once))

    def _decided(self, on: Meaning, time: int, held: bool) -> int:
        return self.formula._decided(on, time, not held)


@dataclasses.dataclass(frozen=True)
class _Several(Formula):
    formulas: tuple[Formula, ...]

    def __post_init__(self) -> None:
        if not self.formulas:
            raise ExpectationError("all and any need at least one formula")

    def _steps(self, on: Meaning, once: bool) -> Steps:
        parts = [on.steps(each, once) for each in self.formulas]
        return combine(parts, least=isinstance(self, And))

    def _decided(self, on: Meaning, time: int, held: bool) -> int:
        times = [
            part._decided(on, time, held)
            for part in self.formulas
            if on.steps(part, once=time == on.begin).shows(time, held)
        ]
        return (max if held is isinstance(self, And) else min)(times, default=time)


class And(_Several):
    """All formulas hold."""


class Or(_Several):
    """At least one formula holds."""


@dataclasses.dataclass(frozen=True)
class Implies(Formula):
    """If the first holds, so does the second."""

    condition: Formula
    formula: Formula

    @property
    def _either(self) -> Or:
        return Or((Not(self.condition), self.formula))

    def _steps(self, on: Meaning, once: bool) -> Steps:
        return on.steps(self._either, once)

    def _decided(self, on: Meaning, time: int, held: bool) -> int:
        return self._either._decided(on, time, held)


@dataclasses.dataclass(frozen=True)
class _OverWindow(Formula):
    formula: Formula
    window: Window = WHOLE

    def _steps(self, on: Meaning, once: bool) -> Steps:
        span = self.window.start, self.window.end
        return over_window(on.steps(self.formula), *span, isinstance(self, Always), once)

    def _decided(self, on: Meaning, time: int, held: bool) -> int:
        last = self.window.last(time, on.end)
        if held is isinstance(self, Always):
            return last
        return on.shown(self.formula, time + self.window.start, last, held)


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

    def _steps(self, on: Meaning, once: bool) -> Steps:
        kept = on.steps(self.formula)
        found = until(kept, on.steps(self.goal), self.window.start, self.window.end)
        if not self.weak:
            return found
        return combine([found, over_window(kept, 0, None, least=True)], least=False)

    def _decided(self, on: Meaning, time: int, held: bool) -> int:
        last = self.window.last(time, on.end)
        if held:
            return on.shown(self.goal, time + self.window.start, last, held)
        return on.shown(self.formula, time, last, held)


@dataclasses.dataclass(frozen=True)
class After(Formula):
    """The formula holds at every instant of an event; undecided if the event never comes."""

    trigger: Formula  # an event; another formula stands for the instants at which it begins to hold
    formula: Formula  # that holds then

    def _steps(self, on: Meaning, once: bool) -> Steps:
        trigger, then = on.trigger(self.trigger), on.steps(self.formula)
        implied = combine([negate(trigger), then], least=False)
        implied, never = aligned(implied, trigger)
        absent = implied.absent | (never.values[MOST_TRUTH] < 0.0) | never.absent
        spread = Steps(implied.starts, implied.values, absent)
        always = over_window(spread, 0, None, least=True, once=once)
        # An event that may not have come at all proves nothing.
        came = over_window(trigger, 0, None, least=False, once=once)
        always, came = aligned(always, came)
        unsure = (came.values[LEAST_TRUTH] < 0.0) & (always.values[LEAST_TRUTH] > 0.0)
        always.values[:, unsure] = UNKNOWN[:, None]
        return always.merged()

    def _decided(self, on: Meaning, time: int, held: bool) -> int:
        if not held:
            then = on.steps(self.formula)
            for instant in on.trigger(self.trigger).sure(time):
                if then.shows(instant, False):
                    return self.formula._decided(on, instant, False)
        return on.end


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

    def _steps(self, on: Meaning, once: bool) -> Steps:
        return on.count(self)

    def _decided(self, on: Meaning, time: int, held: bool) -> int:
        if self.until is None:
            return self.window.last(time, on.end)
        found = on.steps(self.until).first(time, on.end, True)
        return on.end if found is None else found


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

    def _steps(self, on: Meaning, once: bool) -> Steps:
        return on.quantile(self, once)

    def _decided(self, on: Meaning, time: int, held: bool) -> int:
        return self.window.last(time, on.end)


SignalFormula = Compare | Says | Quantile


def _check_operator(operator: str) -> None:
    if operator not in OPERATORS:
        raise ExpectationError(f"{shown(operator)} is not one of {', '.join(OPERATORS)}")
