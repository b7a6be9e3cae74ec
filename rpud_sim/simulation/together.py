"""Messages of a span of blocks together: columns of topics."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from heapq import merge

import numpy as np

from rpud_sim.foundation.ragged import Ragged
from rpud_sim.foundation.shared import Shared
from rpud_sim.simulation.fields import Fields, to_array

# A message: simulation time at which it is published [ns], topic, fields.
Entry = tuple[int, str, Fields]

# Order in which a block's messages are published.
_ORDER = {
    topic: number
    for number, topic in enumerate(
        (
            "contact_force",
            "nodal_plane",
            "drill_tool",
            "reacting_force",
            "wrench",
            "rotation",
            "mount",
            "borehole",
            "joint_states",
            "actuator_state",
            "waveform",
            "trajectory",
        )
    )
}


@dataclass(frozen=True)
class Columns(Shared):
    """Messages of one topic, as columns."""

    topic: str  # its name
    # number of the block in the span that each belongs to, ascending, shape (n,)
    blocks: np.ndarray
    times: np.ndarray  # simulation time at which each is published [ns], shape (n,), int64
    # as of one message, with an array in place of each value that differs. A sequence has a
    # row for each message, or is ``Ragged``.
    fields: Fields

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.times)

    @property
    def places(self) -> np.ndarray:
        """Place of each among all messages of the span; equal where they follow each other."""
        return self.blocks * len(_ORDER) + _ORDER[self.topic]

    def row(self, number: int, names: Collection[str] | None = None) -> Fields:
        """Return the fields of one message.

        Args:
            names: of the fields to return, as far as there are any; None for all. A message of
                samples or segments has long sequences.
        """
        if names is None:
            return row_of(self.fields, number)
        return row_of({name: self.fields[name] for name in names if name in self.fields}, number)

    def messages(self) -> Iterator[Entry]:
        """Yield the messages one by one."""
        for number, time in enumerate(self.times.tolist()):
            yield time, self.topic, self.row(number)


@dataclass(frozen=True)
class Together:
    """All messages of a span."""

    ends: np.ndarray  # of its blocks: simulation times [ns]
    columns: tuple[Columns, ...]  # of topics; those of a topic follow each other in time

    @property
    def end(self) -> int:
        """End of the span: simulation time [ns]."""
        return int(self.ends[-1])

    def messages(self) -> Iterator[Entry]:
        """Yield the messages one by one, in order."""
        groups = [_placed(columns) for columns in self.columns]
        for _, number, found in merge(*groups, key=lambda each: each[0]):
            yield int(found.times[number]), found.topic, found.row(number)


def one_by_one(found: Iterable[Entry | Together]) -> Iterator[Entry]:
    """Yield messages that come together one by one, in order."""
    for each in found:
        if isinstance(each, Together):
            yield from each.messages()
        else:
            yield each


def _placed(columns: Columns) -> Iterator[tuple[int, int, Columns]]:
    """Yield place and number of each message of columns, with the columns."""
    for number, place in enumerate(columns.places.tolist()):
        yield place, number, columns


def row_of(fields: Fields, number: int) -> Fields:
    """Return the fields of one message of columns."""
    row = {}
    for name, value in fields.items():
        kind = type(value)
        if kind is np.ndarray:
            row[name] = value.item(number) if value.ndim == 1 else to_array(value[number])
        elif kind is dict:
            row[name] = row_of(value, number)
        elif kind is Ragged:
            row[name] = to_array(value.sequence(number))
        else:
            row[name] = list(value) if kind is list else value
    return row
