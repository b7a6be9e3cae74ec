"""Messages of one topic: their stamps, their order and the values of their fields."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from rpud_sim.bag import Kind
from rpud_sim.bag.columns import objects, to_plain
from rpud_sim.foundation.time import SECOND
from rpud_sim.verdicts.missing import Missing
from rpud_sim.verdicts.names import DIAGNOSTICS, Field
from rpud_sim.verdicts.units import ExpectationError

# Counters of a status that never decrease in a run; they put reports of one stamp in order.
_COUNTERS = ("commands_accepted", "commands_rejected", "impacts", "deadlines_missed")


@dataclasses.dataclass(frozen=True)
class Table:
    """Messages of a bag as arrays, one for each column."""

    columns: Mapping[str, np.ndarray]

    def __len__(self) -> int:
        return len(self.columns["log_time"])

    def values(self, name: str, attribute: str) -> np.ndarray | list[Any]:
        if name not in self.columns:
            raise ExpectationError(f"the messages of the bag have no field {name!r}")
        return self.columns[name]

    def content(self, number: int) -> str:
        """Return all of a message as text."""
        return repr(
            [
                (name, to_plain(values[number]))
                for name, values in self.columns.items()
                if name not in ("log_time", "publish_time")
            ]
        )


class Live:
    """Messages one by one, as mappings or as objects with attributes."""

    def __init__(self) -> None:
        self.messages: list[Any] = []

    def __len__(self) -> int:
        return len(self.messages)

    def values(self, name: str, attribute: str) -> np.ndarray | list[Any]:
        path = name.split(".")
        return [_inner(message, path) for message in self.messages]

    def content(self, number: int) -> str:
        """Return all of a message as text."""
        return repr(self.messages[number])


def get(message: Any, name: str) -> Any:
    """Return a field of a message; None if it has none of that name."""
    if isinstance(message, Mapping):
        return message.get(name)
    return getattr(message, name, None)


def _inner(message: Any, path: list[str]) -> Any:
    for name in path:
        message = get(message, name)
    return message


def time_of(value: Any) -> int:
    if isinstance(value, (int, np.integer)):
        return int(value)
    return int(get(value, "sec")) * SECOND + int(get(value, "nanosec"))


@dataclasses.dataclass(frozen=True)
class Piece:
    """Some messages of a topic, with their times."""

    source: Table | Live  # of the values
    stamps: np.ndarray  # of the messages [ns]
    published: np.ndarray  # that increase in the order of publishing


@dataclasses.dataclass(frozen=True)
class Samples:
    """Values of a field at increasing stamps."""

    stamps: np.ndarray  # of the messages [ns]; equal stamps follow each other
    values: np.ndarray  # floats, texts or truth values
    gaps: np.ndarray  # whether messages are missing between each and the next
    first_missing: bool  # whether messages are missing before the first
    ordered: np.ndarray  # whether it is known that each follows the one before it of the same stamp


class TopicMessages:
    """Messages of one topic in a span of time, without repetitions, in order of their stamps.

    The order does not depend on that of arrival: messages of one stamp are ordered by their numbers
    or counters, where they have some. Reports of one stamp with the same counters are in the order
    in which the drill published them. ``keep`` says, for each piece, which messages count.
    """

    def __init__(self, topic: str, pieces: list[Piece], keep: list[np.ndarray]) -> None:
        self._topic = topic
        self._sources = [piece.source for piece in pieces]
        chosen = [np.flatnonzero(each) for each in keep]
        none = np.empty(0, np.int64)
        stamps = np.concatenate(
            [none, *(piece.stamps[at] for piece, at in zip(pieces, chosen, strict=True))]
        )
        self._piece = np.concatenate([none, *(np.full(len(at), n) for n, at in enumerate(chosen))])
        self._row = np.concatenate([none, *chosen])
        key = self._keys()
        # The drill alone publishes its status, and the middleware keeps the order of a publisher.
        self._in_order = topic == "status"
        arrived = [none, *(piece.published[at] for piece, at in zip(pieces, chosen, strict=True))]
        before = (np.concatenate(arrived),) if self._in_order else ()
        order = np.lexsort((*before, key, stamps))
        order = self._without_repetitions(order, stamps, key)
        self.stamps = stamps[order]
        self._piece, self._row, self._key = self._piece[order], self._row[order], key[order]

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def missing(self) -> Missing:
        """What the numbers in the messages show as missing."""
        if not self._numbered or not len(self):
            return Missing.none()
        return Missing.from_numbers(self.stamps, self._key)

    def samples(self, field: Field | str) -> Samples:
        """Return the values of a field, or by name of a diagnostic or a field of unknown type."""
        if not isinstance(field, str):
            values = self._values(field)
        elif self._topic == DIAGNOSTICS:
            values = self._diagnosed(field)
        else:
            values = objects(self.column(field))
        gaps = np.zeros(len(self), bool)
        if self._numbered and len(self) > 1:
            gaps[:-1] = np.diff(self._key) > 1
        first = bool(self._numbered and len(self) and self._key[0] > 0)
        ordered = np.ones(len(self), bool)
        same = self.stamps[1:] == self.stamps[:-1]
        ordered[1:] = ~(same & (self._key[1:] == self._key[:-1])) | self._in_order
        return Samples(self.stamps, values, gaps, first, ordered)

    def column(self, name: str) -> list[Any]:
        """Return the values of a field of any kind, as they are."""
        return list(self._spread(lambda source: source.values(name, name)))

    @property
    def _numbered(self) -> bool:
        return self._topic == "contact_force" and len(self._sources) > 0

    def _keys(self) -> np.ndarray:
        if self._topic in ("contact_force", "journal"):
            names: tuple[str, ...] = ("sequence",)
        elif self._topic == "status":
            names = _COUNTERS
        else:
            return np.zeros(len(self._row), np.int64)
        try:
            return sum(
                np.array([int(value or 0) for value in self.column(name)], np.int64)
                for name in names
            ) + np.zeros(len(self._row), np.int64)
        except (OverflowError, TypeError, ValueError) as error:
            raise ExpectationError(f"{self._topic}: {', '.join(names)}: {error!r:.100}") from None

    def _without_repetitions(
        self, order: np.ndarray, stamps: np.ndarray, key: np.ndarray
    ) -> np.ndarray:
        same = (np.diff(stamps[order]) == 0) & (np.diff(key[order]) == 0)
        if not same.any():
            return order
        edges = np.flatnonzero(np.concatenate([[True], ~same, [True]]))
        kept = []
        for first, end in pairwise(edges.tolist()):
            group = order[first:end]
            if len(group) == 1:
                kept.append(int(group[0]))
                continue
            texts = [
                self._sources[self._piece[number]].content(int(self._row[number]))
                for number in group
            ]
            if self._in_order:
                kept.extend(
                    int(number)
                    for place, number in enumerate(group)
                    if place == 0 or texts[place] != texts[place - 1]
                )
                continue
            contents = dict(zip(texts, group.tolist(), strict=True))
            kept.extend(contents[text] for text in sorted(contents))
        return np.array(kept, np.int64)

    def _spread(self, values_of: Any) -> np.ndarray:
        parts = [values_of(source) for source in self._sources]
        plain = all(isinstance(part, np.ndarray) and part.dtype != object for part in parts)
        if plain and parts:
            offsets = np.cumsum([0, *map(len, parts)])
            return np.concatenate(parts)[offsets[self._piece] + self._row]
        return objects(
            [
                parts[piece][row]
                for piece, row in zip(self._piece.tolist(), self._row.tolist(), strict=True)
            ]
        )

    def _values(self, field: Field) -> np.ndarray:
        column = field.column
        values = self._spread(lambda source: source.values(column.name, column.attribute))
        if field.index is not None:
            values = objects(
                [each[field.index] if field.index < len(each) else np.nan for each in values]
            )
        if column.kind is Kind.TEXT:
            return values
        if column.kind in (Kind.TIME, Kind.DURATION):
            return np.array([time_of(value) for value in values], np.int64)
        try:
            return values.astype(bool if field.is_flag else float)
        except (TypeError, ValueError) as error:
            raise ExpectationError(f"{self._topic}.{column.name}: {error!r:.100}") from None

    def _diagnosed(self, name: str) -> np.ndarray:
        """Return a value of the diagnostics: NAME.level, NAME.message or NAME.KEY."""
        entry, _, key = name.partition(".")
        found = []
        for statuses in self.column("status"):
            value: Any = np.nan
            for status in statuses:
                if str(get(status, "name")).rpartition(": ")[2] == entry:
                    value = _entry(status, key)
            found.append(value)
        return objects(found)


def _entry(status: Any, key: str) -> Any:
    if key == "level":
        level = get(status, "level")
        return float(level[0] if isinstance(level, bytes) else level)
    if key == "message":
        return str(get(status, "message"))
    for item in get(status, "values"):
        if str(get(item, "key")).partition(" [")[0] == key:
            text = str(get(item, "value"))
            try:
                return float(text)
            except ValueError:
                return text
    return np.nan
