"""How much a recorder may write."""

from __future__ import annotations

import os
import time
from pathlib import Path

from rpud_sim.bag import BagError

_RESERVE = 32 * 2**20  # bytes that are left on the disk: also for what is in memory at a look
_PERIOD = 0.1  # s between two looks at the disk


class DiskRoom:
    """Tells why the next message must not be written, if so.

    Args:
        path: of the bag.
        limit: bytes that the whole bag may have; None for no limit.
    """

    def __init__(self, path: Path, limit: int | None) -> None:
        self._path = path
        self._limit = limit
        self._looked = float("-inf")
        self._free = 0  # bytes, by the last look
        self._size = 0  # the bag's at that time

    def refusal(self, closed_size: int, size: int) -> str:
        """Say why there is no room for `size` bytes more; empty where there is.

        `closed_size` are the bag's bytes, were it closed now. Raises BagError.
        """
        if self._limit is not None and closed_size + size > self._limit:
            return f"it has reached --max-disk {self._limit} bytes"
        now = time.monotonic()
        if now >= self._looked + _PERIOD:
            self._looked = now
            try:
                disk = os.statvfs(self._path)
            except OSError as error:
                raise BagError(f"cannot look at {self._path}: {error.strerror}") from error
            self._free = disk.f_bavail * disk.f_frsize
            self._size = closed_size
        if closed_size - self._size + size + _RESERVE > self._free:
            return f"the disk of {self._path} has {self._free} bytes left"
        return ""
