"""Store of a drill's journal, for those who lack entries of it."""

from __future__ import annotations

import threading
import time
import zlib
from array import array
from collections import deque

MOST = 1_000_000  # entries that are kept at least, about 15 MB
_PAGE = 500  # entries that are compressed, and returned, together

Entries = list[tuple[int, bytes]]  # publishing times [ns since the epoch], and serialized entries


class JournalStore:
    """The newest entries of a journal as they were published, compressed in pages.

    One thread adds; any may read.
    """

    def __init__(self, most: int = MOST) -> None:
        self.count = 0  # entries so far
        self._lock = threading.Lock()
        self._pages: deque[bytes] = deque(maxlen=most // _PAGE)
        self._newest: Entries = []  # that are no page yet

    @property
    def first_kept(self) -> int:
        """Number of the first entry that is still kept; those before were dropped."""
        with self._lock:
            return self._first_kept()

    def add(self, entry: bytes) -> None:
        """Add a serialized entry that is published now."""
        with self._lock:
            self._newest.append((time.time_ns(), entry))
            self.count += 1
            if len(self._newest) == _PAGE:
                self._pages.append(_compressed(self._newest))
                self._newest = []

    def read(self, first: int) -> Entries:
        """Return some entries from a number on, or from the first kept one if that is greater."""
        with self._lock:
            place = max(0, first - self._first_kept())
            number, skipped = divmod(place, _PAGE)
            if number >= len(self._pages):
                return self._newest[place - len(self._pages) * _PAGE :]
            page = self._pages[number]
        return _entries(page)[skipped:]

    def _first_kept(self) -> int:
        return self.count - len(self._newest) - len(self._pages) * _PAGE


def _compressed(entries: Entries) -> bytes:
    times, data = zip(*entries, strict=True)
    lengths = array("q", map(len, data))
    return zlib.compress(b"".join((array("q", times), lengths, *data)), 1)


def _entries(page: bytes) -> Entries:
    content = zlib.decompress(page)
    numbers = array("q", content[: 16 * _PAGE])
    found, place = [], 16 * _PAGE
    for published, length in zip(numbers[:_PAGE], numbers[_PAGE:], strict=True):
        found.append((published, content[place : place + length]))
        place += length
    return found
