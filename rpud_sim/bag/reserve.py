"""Reserved room on the disk for the end of a bag, in case another program fills the disk."""

from __future__ import annotations

import errno
import io
import os
from pathlib import Path

# Name of the file that holds the room in a bag's directory, until the bag is closed.
FILE_NAME = "reserve.tmp"

_STEP = 1 << 22  # bytes by which it grows
_FULL = (errno.ENOSPC, errno.EDQUOT)


class Reserve:
    """File in ``folder`` that takes room on the disk until it is released."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE_NAME
        self._size = 0
        self._released = False

    def hold(self, size: int) -> bool:
        """Reserve at least ``size`` bytes and return whether they are reserved."""
        if self._released:
            return False
        if size <= self._size:
            return True
        size = (size + _STEP - 1) // _STEP * _STEP
        disk = os.statvfs(self._path.parent)
        # A file system may fill itself before it says that it cannot hold so much.
        if size - self._size > disk.f_bavail * disk.f_frsize:
            return False
        descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT, 0o600)
        try:
            os.posix_fallocate(descriptor, 0, size)
        except OSError as error:
            if error.errno in _FULL:
                return False
            # Some file systems cannot reserve room, or not as much; then there is no reserve.
        finally:
            os.close(descriptor)
        self._size = size
        return True

    def release(self) -> bool:
        """Release the room for good and return whether there was any."""
        held, self._released = self._size > 0 and not self._released, True
        self._path.unlink(missing_ok=True)
        return held


class ReservedFile(io.FileIO):
    """New unbuffered file that uses the reserve when the disk is full."""

    def __init__(self, path: Path, reserve: Reserve | None) -> None:
        super().__init__(path, "xb")
        self._reserve = reserve

    def write(self, data: object, /) -> int:
        """Write some of the bytes and return their number; the reserve serves a full disk."""
        try:
            return super().write(data)  # type: ignore[arg-type]
        except OSError as error:
            if error.errno not in _FULL or self._reserve is None or not self._reserve.release():
                raise
            return super().write(data)  # type: ignore[arg-type]
