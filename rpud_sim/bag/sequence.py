"""Gaps in numbered messages: numbers of the middleware, or those that messages carry themselves."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable

_BEGINNING = re.compile(
    r"\s*std_msgs/(?:msg/)?Header\s+header\s+uint64\s+sequence\b",
)
_COMMENT = re.compile(r"#.*")
_SEQUENCES = 64  # of one topic; those of publishers that left are forgotten at last


class SequenceGaps:
    """Counts messages that never arrived, by the numbers that publishers give their messages.

    Messages do not say who sent them. With one publisher the count is exact. With several, a
    number that continues none of the sequences heard so far is a gap in the one just below it,
    unless there are more publishers than sequences: then it begins a new one.
    """

    def __init__(self, publisher_count: Callable[[], int]) -> None:
        """`publisher_count` gives the number of publishers now; it is asked at gaps only."""
        self.missing = 0
        self._publisher_count = publisher_count
        self._last: list[int] = []  # of each sequence; the one heard last is at the end

    def note(self, number: int) -> None:
        """Note the number of a message that arrived."""
        last = self._last
        if number - 1 in last:
            last.remove(number - 1)
        else:
            below = max((before for before in last if before < number), default=None)
            if below is not None and len(last) >= self._publisher_count():
                self.missing += number - below - 1
                last.remove(below)
        last.append(number)
        if len(last) > _SEQUENCES:
            del last[0]


class SequenceCounter:
    """Counts what is missing between messages by the numbers in them, without decoding them all.

    It understands types that begin with a `std_msgs/Header header` and a `uint64 sequence`. Blocks
    number their first entry, and not themselves: what they skip is known, and not how many blocks.
    """

    def __init__(self, definition: str, publishers: int) -> None:
        """`definition` is the `ros2msg` text of the type that so many publishers sent."""
        text = _COMMENT.sub("", definition[: 64 * 1024]).split("=" * 80)[0]
        counts = _BEGINNING.match(text) is not None and "[]" not in text
        self._gaps = SequenceGaps(lambda: publishers) if counts else None

    @property
    def gaps(self) -> int | None:
        """Messages that are missing in between; None where they have no numbers."""
        return None if self._gaps is None else self._gaps.missing

    def note(self, data: bytes) -> None:
        """Note a message as it was serialized (CDR)."""
        if self._gaps is not None and (number := _sequence(data)) is not None:
            self._gaps.note(number)


def _sequence(data: bytes) -> int | None:
    """Read the field `sequence` behind the header: seconds, nanoseconds, and the frame's name."""
    order = "<" if data[1:2] == b"\x01" else ">"
    try:
        (length,) = struct.unpack_from(f"{order}I", data, 12)
        place = 4 + (12 + length + 7) // 8 * 8  # numbers are aligned to their size after 4 bytes
        (number,) = struct.unpack_from(f"{order}Q", data, place)
    except struct.error:
        return None
    return int(number)
