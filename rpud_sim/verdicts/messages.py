"""Messages of one topic: their stamps, their order, the values of their fields, and what is lost.

Some come as columns of a bag, and others one by one, as mappings or as objects with attributes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import reduce
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.bag import Kind
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.terminal import error_text
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.messages.columns import objects
from rpud_sim.verdicts.names import SignalField
from rpud_sim.verdicts.steps import HIGH, LOW

# Fields that never decrease in a run; their sums put messages of one stamp in order.
_COUNTERS = {
    "contact_force": ("sequence",),
    "journal": ("sequence",),
    "status": ("commands_accepted", "commands_rejected", "impacts"),
}
NONE = np.empty(0, np.int64)  # no time


def get(message: Any, name: str) -> Any:
    """Return a field of a message; None if it has none of that name."""
    return message.get(name) if isinstance(message, Mapping) else getattr(message, name, None)


def time_of(value: Any) -> int:
    """Return a time of a message [ns]."""
    if isinstance(value, (int, np.integer)):
        return int(value)
    return int(get(value, "sec")) * SECOND + int(get(value, "nanosec"))


def to_floats(values: np.ndarray) -> np.ndarray:
    """Return numbers; NaN for what is none."""
    if values.dtype != object:
        return values.astype(float)
    plain = [
        each[0] if isinstance(each, bytes) and len(each) == 1 else each for each in values.tolist()
    ]
    return np.array([float(x) if isinstance(x, (int, float)) else np.nan for x in plain], float)


class MissingMessages(NamedTuple):
    """Numbers of messages that are missing, each in a stretch of time."""

    first: np.ndarray = NONE  # of each stretch, in order [ns]
    last: np.ndarray = NONE  # of each stretch, in order [ns]
    counts: np.ndarray = NONE  # of the messages that are missing in each
    anywhere: int = 0  # number of further messages, at times that are not known

    @property
    def total(self) -> int:
        """Number of all that are missing."""
        return int(self.counts.sum()) + self.anywhere

    def among(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Return the greatest number of messages missing in each of some spans of time [ns]."""
        sums = np.concatenate([[0], np.cumsum(self.counts)])
        begun = sums[np.searchsorted(self.first, last, side="right")]
        ended = sums[np.searchsorted(self.last, first, side="left")]
        missing: np.ndarray = np.maximum(begun - ended, 0) + self.anywhere
        return missing


@dataclasses.dataclass(frozen=True)
class TopicBatch:
    """Some messages of a topic, with their times."""

    stamps: np.ndarray  # of the messages [ns]
    published: np.ndarray  # that increase in the order of publishing
    columns: Mapping[str, np.ndarray] | None = None  # of a bag, by field; None for ``messages``
    messages: Sequence[Any] = ()

    def values(self, name: str) -> np.ndarray | list[Any]:
        """Return the values of a field."""
        if self.columns is None:
            return [reduce(get, name.split("."), message) for message in self.messages]
        if name not in self.columns:
            raise ParameterError(f"the messages of the bag have no field {name!r}")
        return self.columns[name]


@dataclasses.dataclass(frozen=True)
class FieldSamples:
    """Values of a field at increasing stamps."""

    stamps: np.ndarray  # of the messages [ns]; equal stamps follow each other
    values: np.ndarray  # floats, texts or truth values
    gaps: np.ndarray  # whether messages are missing between each and the next
    first_missing: bool  # whether messages are missing before the first
    ordered: np.ndarray  # whether it is known that each follows the one before it of the same stamp

    def one_a_stamp(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return stamps, bounds and gaps, one a stamp: its last one, or all of unknown order."""
        last = np.append(self.stamps[1:] != self.stamps[:-1], True)
        kept = values[:, last]
        if not self.ordered.all():
            edges = np.concatenate([[0], np.flatnonzero(last) + 1]).tolist()
            for number, (first, end) in enumerate(pairwise(edges)):
                begin = end - 1
                while begin > first and not self.ordered[begin]:
                    begin -= 1
                group = values[:, begin:end]
                kept[LOW, number], kept[HIGH, number] = group[LOW].min(1), group[HIGH].max(1)
        return self.stamps[last], kept, self.gaps[last]


class TopicMessages:
    """Messages of one topic of a run, each once, in order of stamps, then of numbers or counters.

    Reports of one stamp with the same counters are in the order in which they were published.
    """

    def __init__(self, topic: str, batches: list[TopicBatch]) -> None:
        self._topic = topic
        self._batches = batches
        stamps = np.concatenate([NONE, *(batch.stamps for batch in batches)])
        self._order = np.arange(len(stamps))
        key = self._keys()
        # The drill alone publishes its reports, and the middleware keeps the order of a publisher.
        self._in_order = topic in ("power", "status", "timing")
        published = np.concatenate([NONE, *(batch.published for batch in batches)])
        order = np.lexsort((*([published] if self._in_order else []), key, stamps))
        if "sequence" in _COUNTERS.get(topic, ()):
            same = (np.diff(stamps[order]) == 0) & (np.diff(key[order]) == 0)
            order = order[np.append(np.ones(min(len(order), 1), bool), ~same)]
        self.stamps, self._order, self._key = stamps[order], order, key[order]
        # Numbers that follow each other show what is missing.
        self._numbered = topic == "contact_force" and len(self.stamps) > 0

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def missing(self) -> MissingMessages:
        """What the numbers in the messages show as missing."""
        if not self._numbered:
            return MissingMessages()
        counts = np.concatenate([self._key[:1], np.maximum(np.diff(self._key) - 1, 0)])
        before = np.concatenate([[-NEVER], self.stamps[:-1]])
        some = counts > 0
        return MissingMessages(before[some], self.stamps[some], counts[some])

    def samples(self, name: str, field: SignalField | None) -> FieldSamples:
        """Return the values of a field, by its name if its type is not known."""
        values = self._values(field) if field is not None else objects(self.column(name))
        gaps = np.zeros(len(self), bool)
        if self._numbered:
            gaps[:-1] = np.diff(self._key) > 1
        first = bool(self._numbered and self._key[0] > 0)
        ordered = np.ones(len(self), bool)
        same = self.stamps[1:] == self.stamps[:-1]
        ordered[1:] = ~(same & (self._key[1:] == self._key[:-1])) | self._in_order
        return FieldSamples(self.stamps, values, gaps, first, ordered)

    def column(self, name: str) -> list[Any]:
        """Return the values of a field of any kind, as they are."""
        return list(self._spread(name))

    def _keys(self) -> np.ndarray:
        names = _COUNTERS.get(self._topic, ())
        key = np.zeros(len(self._order), np.int64)
        try:
            for name in names:
                key += np.array([int(value or 0) for value in self.column(name)], np.int64)
        except (OverflowError, TypeError, ValueError) as error:
            raise ParameterError(
                f"{self._topic}: {', '.join(names)}: {error_text(error)}"
            ) from None
        return key

    def _spread(self, name: str) -> np.ndarray:
        """Return the values of a field in all batches, in order."""
        parts = [batch.values(name) for batch in self._batches]
        if all(isinstance(each, np.ndarray) and each.dtype != object for each in parts) and parts:
            return np.concatenate(parts)[self._order]
        return objects([value for part in parts for value in part])[self._order]

    def _values(self, field: SignalField) -> np.ndarray:
        column, index = field.column, field.index
        values = self._spread(column.name)
        if index is not None:
            values = objects([each[index] if index < len(each) else np.nan for each in values])
        if column.kind is Kind.TEXT:
            return values
        if column.kind in (Kind.TIME, Kind.DURATION):
            return np.array([time_of(value) for value in values], np.int64)
        try:
            return values.astype(bool if field.is_flag else float)
        except (TypeError, ValueError) as error:
            raise ParameterError(f"{self._topic}.{column.name}: {error_text(error)}") from None
