"""Room on the disk for a bag."""

from __future__ import annotations

import os
import time
from pathlib import Path

from rpud_sim.bag import BagError

_RESERVE = 32 * 2**20  # bytes to leave free: also for data in memory at the time of a check
_CHECK_PERIOD = 0.1  # of the free space [s]


class DiskRoom:
    """Limit of a bag: by its size [bytes], None for none, and by the free space of its disk."""

    def __init__(self, path: Path, limit: int | None) -> None:
        self._path = path
        self._limit = limit
        self._checked = float("-inf")
        self._free = 0  # bytes, at the last check
        self._size = 0  # the bag's at that time

    def refusal(self, closed_size: int, size: int) -> str:
        """Return why there is no room for a message in a bag of this closed size [bytes], or ""."""
        if self._limit is not None and closed_size + size > self._limit:
            return f"it has reached --max-disk {self._limit} bytes"
        now = time.monotonic()
        if now >= self._checked + _CHECK_PERIOD:
            self._checked = now
            try:
                disk = os.statvfs(self._path)
            except OSError as error:
                raise BagError(f"cannot look at {self._path}: {error.strerror}") from error
            self._free = disk.f_bavail * disk.f_frsize
            self._size = closed_size
        if closed_size - self._size + size + _RESERVE > self._free:
            return f"the disk of {self._path} has {self._free} bytes left"
        return ""
