"""Gaps in the numbers that messages themselves carry, found without decoding all of a message."""

from __future__ import annotations

import re
import struct

_BEGINNING = re.compile(
    r"\s*std_msgs/(?:msg/)?Header\s+header\s+uint64\s+sequence\b",
)
_COMMENT = re.compile(r"#.*")


class SequenceCounter:
    """Counts what is missing between the messages of one publisher, in the order it sent them.

    It understands types that begin with a `std_msgs/Header header` and a `uint64 sequence`. Blocks
    number their first entry, and not themselves: what they skip is known, and not how many blocks.
    """

    def __init__(self, definition: str) -> None:
        """`definition` is the `ros2msg` text of the type."""
        text = _COMMENT.sub("", definition[: 64 * 1024])
        fields = text.split("=" * 80)[0]
        self._counts = bool(_BEGINNING.match(text)) and "[]" not in fields
        self._last: int | None = None
        self.gaps: int | None = 0 if self._counts else None

    def note(self, data: bytes) -> None:
        """Note a message as it was serialized (CDR)."""
        if not self._counts:
            return
        number = _sequence(data)
        if number is None or self.gaps is None:
            return
        # A smaller number is that of a drill that began anew.
        if self._last is not None and number > self._last:
            self.gaps += number - self._last - 1
        self._last = number


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
