"""Room on the disk for the end of a bag that is being written, and its files, which use it."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rpud_sim.bag.errors import BagError

RESERVE_NAME = "reserve.tmp"  # file that holds a bag's reserve until the bag is closed

_RESERVE_STEP = 1 << 22  # bytes by which it grows
_FULL = (errno.ENOSPC, errno.EDQUOT)


class Reserve:
    """File in ``folder`` that takes room on the disk until it is released.

    So a bag can be closed although another program fills the disk.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / RESERVE_NAME
        self._size = 0
        self._released = False

    def hold(self, size: int) -> bool:
        """Reserve at least ``size`` bytes and return whether they are reserved."""
        if self._released:
            return False
        if size <= self._size:
            return True
        size = -(-size // _RESERVE_STEP) * _RESERVE_STEP
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
    """New unbuffered file of a bag that uses the reserve when the disk is full."""

    def __init__(self, path: Path, reserve: Reserve | None) -> None:
        self.failed = False  # whether a write failed
        self._reserve = reserve
        self._bag = path.parent
        with writing(self._bag):
            super().__init__(path, "xb")

    def write(self, data: object, /) -> int:
        """Write some of the bytes and return their number; the reserve serves a full disk."""
        with self._writing():
            try:
                return super().write(data)  # type: ignore[arg-type]
            except OSError as error:
                if error.errno not in _FULL or self._reserve is None or not self._reserve.release():
                    raise
                return super().write(data)  # type: ignore[arg-type]

    def sync(self) -> None:
        """Wait until everything is on the disk."""
        with self._writing():
            os.fsync(self.fileno())

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            with writing(self._bag):
                yield
        except BagError:
            self.failed = True
            raise


@contextmanager
def writing(bag: Path) -> Iterator[None]:
    """Replace errors of the disk by a BagError that names the bag."""
    try:
        yield
    except OSError as error:
        raise BagError(f"cannot write the bag {bag}: {error.strerror}") from error
