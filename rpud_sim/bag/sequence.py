"""Gaps in numbered messages: numbers of the middleware, or those in the messages."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable

_BEGINNING = re.compile(r"\s*std_msgs/(?:msg/)?Header\s+header\s+uint64\s+sequence\b")
_COMMENT = re.compile(r"#.*")
_SEQUENCES = 64  # of one topic at most; the oldest, of publishers that left, are discarded


class SequenceGaps:
    """Count of messages that never arrived, from the numbers that publishers give to messages.

    Messages do not name their publisher. With one publisher the count is exact. With several, a
    number that continues no known sequence is a gap in the sequence just below it. If there are
    more publishers than known sequences, it begins a new sequence instead. ``publisher_count`` is
    called at gaps only. What a sequence lacks before its first number counts where ``from_first``.
    """

    def __init__(self, publisher_count: Callable[[], int]) -> None:
        self.missing = 0  # messages that never arrived
        self.from_first = False  # whether all publishers of new sequences began with number 1
        self._publisher_count = publisher_count
        self._last: list[int] = []  # number of each sequence, the most recent at the end

    def note(self, number: int) -> None:
        last = self._last
        if number - 1 in last:
            last.remove(number - 1)
        else:
            below = max((before for before in last if before < number), default=None)
            if below is None:
                self.missing += self.from_first * (number - 1)
            elif len(last) >= self._publisher_count():
                self.missing += number - below - 1
                last.remove(below)
        last.append(number)
        if len(last) > _SEQUENCES:
            del last[0]


class SequenceCounter:
    """Count of missing messages from the numbers in them, without decoding whole messages.

    It reads types that begin with ``std_msgs/Header header`` and ``uint64 sequence``. Blocks number
    their first entry, not themselves: the number of missing blocks cannot be known.
    """

    def __init__(self, definition: str, publishers: int) -> None:
        text = _COMMENT.sub("", definition[: 64 * 1024]).split("=" * 80)[0]
        counts = _BEGINNING.match(text) is not None and "[]" not in text
        self._gaps = SequenceGaps(lambda: publishers) if counts else None

    @property
    def gaps(self) -> int | None:
        """Number of missing messages; None if messages have no numbers."""
        return None if self._gaps is None else self._gaps.missing

    def note(self, data: bytes) -> None:
        if self._gaps is not None and (number := _sequence(data)) is not None:
            self._gaps.note(number)


def _sequence(data: bytes) -> int | None:
    """Return the field ``sequence``, which follows seconds, nanoseconds and name of the frame."""
    order = "<" if data[1:2] == b"\x01" else ">"
    try:
        (length,) = struct.unpack_from(f"{order}I", data, 12)
        place = 4 + (12 + length + 7) // 8 * 8  # numbers are aligned to their size after 4 bytes
        (number,) = struct.unpack_from(f"{order}Q", data, place)
    except struct.error:
        return None
    return int(number)
