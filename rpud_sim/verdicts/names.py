"""Topics and fields that an expectation may name, and the check of its formula before a run."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from functools import cache

import numpy as np

from rpud_sim.bag import Column, Kind
from rpud_sim.foundation.quantities import ParameterError, did_you_mean, short_repr
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.columns import RECEIVED
from rpud_sim.recorded.drill_tables import drill_table
from rpud_sim.simulation.topics import COMMAND_TOPICS, TOPICS
from rpud_sim.verdicts.formulas import (
    Active,
    Cleared,
    Compare,
    Formula,
    HasText,
    Onset,
    Published,
    Signal,
    SignalFormula,
)
from rpud_sim.verdicts.units import Number, find_unit, to_si

# Types of the topics with relative names.
TYPES: Mapping[str, str] = {
    **{name: topic.type for name, topic in TOPICS.items()},
    **COMMAND_TOPICS,
}

# Standard types name no units.
_STANDARD_UNITS: Mapping[str, str] = {
    **{f"wrench.wrench.force.{axis}": "N" for axis in "xyz"},
    **{f"wrench.wrench.torque.{axis}": "N m" for axis in "xyz"},
    "joint_states.position": "m",
    "joint_states.velocity": "m/s",
    "joint_states.effort": "N",
}

# One message a sample: these define where a recording begins, and fall silent only by a fault.
PERIODIC = frozenset(
    (
        *("actuator_state", "borehole", "drill_tool", "joint_states", "mount", "nodal_plane"),
        *("reacting_force", "rotation", "wrench"),
    )
)
# Longest time for which a value of a periodic topic holds, unless the signal has its own [ns]. The
# least telemetry rate is 1 Hz, so that a healthy topic is never silent for longer.
PERIODIC_HOLD = SECOND

_INDEX = re.compile(r"(.*)\[(\d{1,6})\]")


@dataclasses.dataclass(frozen=True)
class SignalField:
    """Field of a message, as an expectation uses it."""

    column: Column  # of the topic's table
    index: int | None = None  # of an element; None for the whole field

    @property
    def has_text(self) -> bool:
        """Whether it is a text or a truth value, not a number."""
        return self.column.kind is Kind.TEXT or self.is_flag

    @property
    def is_flag(self) -> bool:
        """Whether it is a truth value."""
        return self.column.kind is Kind.NUMBER and self.column.dtype == np.dtype(bool)

    @property
    def unit(self) -> str:
        """SI unit; empty for a pure number."""
        if self.column.kind in (Kind.TIME, Kind.DURATION):
            return "s"
        return self.column.unit


@dataclasses.dataclass(frozen=True)
class Expectation:
    """Named formula that must hold from the beginning of a run."""

    name: str  # for people
    formula: Formula  # to hold
    requirement: str = ""  # its identifier; empty for none

    def __post_init__(self) -> None:
        _check_formula(self.formula)

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics that a record needs, in the order of their names."""
        # These show where runs begin, and how far they go.
        return tuple(sorted({"journal", "status", *self.used_topics}))

    @property
    def used_topics(self) -> tuple[str, ...]:
        """Topics that the formula names, in the order of their names."""
        found = set()
        for part in self.formula.walk():
            if isinstance(part, SignalFormula):
                found.add(part.signal.topic)
            elif isinstance(part, Published):
                found.add(part.topic)
            elif isinstance(part, Active | Onset | Cleared):
                found.add("faults")
        return tuple(sorted(found))


@cache
def drill_columns(topic: str) -> tuple[Column, ...]:
    """Return the columns of a topic of the drill, of each row where messages are blocks of rows."""
    columns = drill_table(TYPES[topic]).columns
    return tuple(column for column in columns if column.name not in RECEIVED)


def find_field(signal: Signal, columns: tuple[Column, ...]) -> SignalField:
    """Return the field of a signal among the columns of its topic."""
    topic, match = signal.topic, _INDEX.fullmatch(signal.field)
    base = match[1] if match else signal.field
    index = int(match[2]) if match else None
    known = {column.name: column for column in columns}
    if base not in known:
        hint = did_you_mean(base, [each for each in known if not each.startswith("header.")])
        raise ParameterError(f"{topic} has no field {short_repr(base)}{hint}")
    column = known[base]
    if column.kind is Kind.NESTED:
        hint = "; use fault, onset or cleared" if topic == "faults" else ""
        raise ParameterError(f"{topic}.{base} is a list of messages, not a signal{hint}")
    many = column.kind in (Kind.ARRAY, Kind.SEQUENCE)
    if many and index is None:
        raise ParameterError(f"{topic}.{base} has many values; name one of them, as {base}[0]")
    if index is not None and not many:
        raise ParameterError(f"{topic}.{base} is one value, and has no [{index}]")
    if index is not None and column.kind is Kind.ARRAY and index >= column.length:
        raise ParameterError(f"{topic}.{base} has {column.length} values, and no [{index}]")
    unit = column.unit or _STANDARD_UNITS.get(f"{topic}.{base}", "")
    return SignalField(dataclasses.replace(column, unit=unit), index)


def _check_topic(topic: str) -> None:
    """Raise an ParameterError if a relative name is none of the drill's topics."""
    if not topic.startswith("/") and topic not in TYPES:
        hint = did_you_mean(topic, TYPES)
        raise ParameterError(
            f"topic {short_repr(topic)} is none of the drill's{hint} (others begin with /)"
        )


def _check_formula(formula: Formula) -> None:
    """Check every name and unit of a formula, as far as they are known without a bag."""
    _check_kind(formula)
    for part in formula.walk():
        for name in ("formula", "goal", "condition", "trigger", "event"):
            _check_kind(getattr(part, name, part))
        for each in getattr(part, "formulas", ()):
            _check_kind(each)
        if isinstance(part, SignalFormula):
            topic = part.signal.topic
            _check_topic(topic)
            # The type of a topic of others is known only to a bag.
            known = drill_columns(topic) if topic in TYPES else None
            check_use(part, find_field(part.signal, known) if known is not None else None)
        elif isinstance(part, Published):
            _check_topic(part.topic)


def _check_kind(formula: object) -> None:
    if not isinstance(formula, Formula):
        raise ParameterError(
            f"{short_repr(formula)} is not a formula; compare by <, <=, >, >=, equals or has_text"
        )


def check_use(part: SignalFormula, field: SignalField | None) -> None:
    """Check that a field has the kind and unit with which a formula uses it; None passes."""
    if isinstance(part, HasText):
        if field is not None and not field.has_text:
            raise ParameterError(f"{part.signal} is a number: compare it with ==")
        if field is not None and field.is_flag is not isinstance(part.word, bool):
            kind = "true or false" if field.is_flag else "a text"
            raise ParameterError(f"{part.signal} is {kind}, given {short_repr(part.word)}")
        return
    if field is not None and field.has_text:
        raise ParameterError(f"{part.signal} is not a number: write {part.signal} is WORD")
    threshold(part.number, field, part.signal)
    if isinstance(part, Compare):
        threshold(part.tolerance, field, part.signal)


def threshold(number: Number, field: SignalField | None, signal: Signal) -> float:
    """Return a number in the unit of a field; in SI if the field has no known unit."""
    if field is None or (not field.unit and signal.topic.startswith("/")):
        return find_unit(number.unit).to_si(number.value)
    return to_si(number.value, number.unit, field.unit, str(signal))
