"""Room on the disk that is kept to end a bag with, should another program take the rest."""

from __future__ import annotations

import errno
import io
import os
from pathlib import Path

FILE_NAME = "reserve.tmp"
"""Name of the file beside those of a bag that holds the room, until the bag is closed."""

_STEP = 1 << 22  # bytes by which it grows
_FULL = (errno.ENOSPC, errno.EDQUOT)


class Reserve:
    """A file that takes the room, until it is released."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE_NAME
        self._size = 0
        self._released = False

    def hold(self, size: int) -> bool:
        """Hold at least `size` bytes; tell whether they are held. Raises OSError."""
        if self._released:
            return False
        if size <= self._size:
            return True
        size = (size + _STEP - 1) // _STEP * _STEP
        descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT, 0o600)
        try:
            os.posix_fallocate(descriptor, 0, size)
        except OSError as error:
            if error.errno in _FULL:
                return False
            # Where files cannot have room ahead, or not as large, the bag is written without.
        finally:
            os.close(descriptor)
        self._size = size
        return True

    def release(self) -> bool:
        """Give the room back for good; tell whether there was any."""
        held, self._released = self._size > 0 and not self._released, True
        self._path.unlink(missing_ok=True)
        return held


class ReservedFile(io.FileIO):
    """A new unbuffered file that has the reserve where the disk is full."""

    def __init__(self, path: Path, reserve: Reserve | None) -> None:
        super().__init__(path, "xb")
        self._reserve = reserve

    def write(self, data: object, /) -> int:
        """Write some of the bytes; give how many. Raises OSError."""
        try:
            return super().write(data)  # type: ignore[arg-type]
        except OSError as error:
            if error.errno not in _FULL or self._reserve is None or not self._reserve.release():
                raise
            return super().write(data)  # type: ignore[arg-type]
