"""Topics and fields that an expectation may name, and the check of a formula before a run."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from functools import cache

import numpy as np

from rpud_sim.bag import Column, Kind
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.columns import RECEIVED, columns_of, holds_rows, row_columns
from rpud_sim.bag.definitions import find_definition
from rpud_sim.foundation.quantities import did_you_mean, shown
from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.verdicts.units import ExpectationError, to_si, unit_factor
from rpud_sim.verdicts.vocabulary import (
    Becomes,
    Compare,
    Count,
    Event,
    Formula,
    Message,
    Number,
    Quantile,
    Says,
    Signal,
)

DIAGNOSTICS = "/diagnostics"

COMMANDS: Mapping[str, str] = {
    "command/drive": "rpud_msgs/msg/Drive",
    "command/feed": "rpud_msgs/msg/Feed",
    "command/weight_on_bit": "rpud_msgs/msg/WeightOnBit",
}
# Types of the topics with relative names.
TYPES: Mapping[str, str] = {**{name: topic.type for name, topic in TOPICS.items()}, **COMMANDS}

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
class Field:
    """Field of a message, as an expectation uses it."""

    column: Column  # of the topic's table
    index: int | None = None  # of an element; None for the whole field

    @property
    def says(self) -> bool:
        """Whether it is a text or a truth value, not a number."""
        return self.column.kind is Kind.TEXT or self.is_flag

    @property
    def is_flag(self) -> bool:
        return self.column.kind is Kind.NUMBER and self.column.dtype == np.dtype(bool)

    @property
    def unit(self) -> str:
        """SI unit; empty for a pure number."""
        if self.column.kind in (Kind.TIME, Kind.DURATION):
            return "s"
        return self.column.unit


@cache
def table_columns(type_name: str, definition: str) -> tuple[Column, ...]:
    """Return the columns of a type; those of each row where its messages are blocks of rows."""
    columns = columns_of(Codec(type_name, definition), definition)
    return row_columns(columns) if holds_rows(type_name, columns) else columns


@cache
def drill_columns(topic: str) -> tuple[Column, ...]:
    return table_columns(TYPES[topic], find_definition(TYPES[topic]))


@cache
def block_columns(topic: str) -> tuple[Column, ...]:
    """Return the columns of a topic whose messages are blocks, as they are before they are rows."""
    definition = find_definition(TYPES[topic])
    received = (Column(name, Kind.TIME, np.dtype(np.int64)) for name in RECEIVED)
    return (*received, *columns_of(Codec(TYPES[topic], definition), definition))


def find_field(name: str, columns: tuple[Column, ...], topic: str) -> Field:
    """Return a field of a topic by its name, with dots, and a number in brackets for an element."""
    match = _INDEX.fullmatch(name)
    base = match[1] if match else name
    index = int(match[2]) if match else None
    known = {column.name: column for column in columns}
    if base not in known:
        hint = did_you_mean(base, [each for each in known if not each.startswith("header.")])
        raise ExpectationError(f"{topic} has no field {shown(base)}; {hint}")
    column = known[base]
    if column.kind is Kind.NESTED:
        hint = "; use fault, onset or cleared" if topic == "faults" else ""
        raise ExpectationError(f"{topic}.{base} is a list of messages, not a signal{hint}")
    many = column.kind in (Kind.ARRAY, Kind.SEQUENCE)
    if many and index is None:
        raise ExpectationError(f"{topic}.{base} has many values; name one of them, as {base}[0]")
    if index is not None and not many:
        raise ExpectationError(f"{topic}.{base} is one value, and has no [{index}]")
    if index is not None and column.kind is Kind.ARRAY and index >= column.length:
        raise ExpectationError(f"{topic}.{base} has {column.length} values, and no [{index}]")
    unit = column.unit or _STANDARD_UNITS.get(f"{topic}.{base}", "")
    return Field(dataclasses.replace(column, unit=unit), index)


def field_of(signal: Signal) -> Field | None:
    """Return the field of a signal; None if its type is known only to a bag."""
    check_topic(signal.topic)
    if signal.topic not in TYPES:
        return None
    return find_field(signal.field, drill_columns(signal.topic), signal.topic)


def check_topic(topic: str) -> None:
    """Raise an ExpectationError if a relative name is none of the drill's topics."""
    if not topic.startswith("/") and topic not in TYPES:
        hint = did_you_mean(topic, (*TYPES, "diagnostics"))
        raise ExpectationError(
            f"topic {shown(topic)} is none of the drill's; {hint} (others begin with /)"
        )


def check_formula(formula: Formula) -> None:
    """Check every name and unit of a formula, as far as they are known without a bag."""
    _check_kind(formula)
    for part in formula.walk():
        for field in dataclasses.fields(part):  # type: ignore[arg-type]
            if field.name in ("formula", "goal", "condition", "trigger", "event"):
                _check_kind(getattr(part, field.name))
        for each in getattr(part, "formulas", ()):
            _check_kind(each)
        if isinstance(part, (Compare, Says, Quantile)):
            check_use(part, field_of(part.signal))
        elif isinstance(part, Message):
            check_topic(part.topic)
        elif isinstance(part, Count) and not isinstance(part.event, Event):
            raise ExpectationError("count needs an event: onset, cleared, message or becomes")
        elif isinstance(part, Becomes) and isinstance(part.formula, Event):
            raise ExpectationError("an event is an instant, and becomes nothing")


def _check_kind(formula: object) -> None:
    if not isinstance(formula, Formula):
        raise ExpectationError(
            f"{shown(formula)} is no formula; a signal is compared by <, <=, >, >=, equals or says"
        )


def check_use(part: Compare | Says | Quantile, field: Field | None) -> None:
    """Check that a field has the kind and unit with which a formula uses it; None passes."""
    if isinstance(part, Says):
        if field is not None and not field.says:
            raise ExpectationError(f"{part.signal} is a number: compare it with ==")
        if field is not None and field.is_flag is not isinstance(part.word, bool):
            kind = "true or false" if field.is_flag else "a text"
            raise ExpectationError(f"{part.signal} is {kind}, given {shown(part.word)}")
        return
    if field is not None and field.says:
        raise ExpectationError(f"{part.signal} is no number: write {part.signal} is WORD")
    threshold(part.number, field, str(part.signal))
    if isinstance(part, Compare):
        threshold(part.tolerance, field, str(part.signal))


def threshold(number: Number, field: Field | None, name: str) -> float:
    """Return a number in the unit of a field; in SI if the field has no known unit."""
    if field is None or (not field.unit and not _drills(name)):
        return number.value * unit_factor(number.unit)[0]
    return to_si(number.value, number.unit, field.unit, name)


def _drills(name: str) -> bool:
    return not name.startswith("/")


def unit_of(number: Number, field: Field | None) -> str:
    """Return the SI unit in which a comparison with a number has its margin."""
    return field.unit if field is not None and field.unit else unit_factor(number.unit)[1]
