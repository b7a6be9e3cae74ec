"""Rows of those parts of a bag that were read last, within a limit of memory."""

from __future__ import annotations

from collections import OrderedDict

from rpud_sim.watch.recorded.signals import Rows

_MOST_PARTS = 200
_MOST_VALUES = 4_000_000  # numbers in the rows of all kept parts
PieceRows = dict[str, Rows]  # rows of one part of a bag, by topic


class KeptRows:
    """Rows of the parts that were read last; those that were not used for longest are dropped."""

    def __init__(self) -> None:
        self._rows: OrderedDict[int, PieceRows] = OrderedDict()
        self._values = 0

    def find(self, number: int) -> PieceRows | None:
        if number not in self._rows:
            return None
        self._rows.move_to_end(number)
        return self._rows[number]

    def add(self, number: int, rows: PieceRows) -> None:
        """Keep the rows of a part that is not kept yet."""
        self._rows[number] = rows
        self._values += _size(rows)
        while len(self._rows) > 1 and (
            len(self._rows) > _MOST_PARTS or self._values > _MOST_VALUES
        ):
            _, dropped = self._rows.popitem(last=False)
            self._values -= _size(dropped)


def _size(rows: PieceRows) -> int:
    return sum(len(each.stamps) * (2 + len(each.values)) for each in rows.values())
