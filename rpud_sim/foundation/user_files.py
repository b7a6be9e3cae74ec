"""Files that a user names: only regular ones are opened, and each error has the path."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from rpud_sim.foundation.quantities import ExpectedError, did_you_mean

# A FIFO would wait for a writer, perhaps one that took the file's place after the first look.
_READ = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC


@contextmanager
def named_errors(
    path: str | os.PathLike[str], kind: type[ExpectedError] | None = None
) -> Iterator[None]:
    """Give each OSError the path, which errors in reading and writing an open file lack.

    With ``kind`` it becomes an error of that class, ``PATH: reason``.
    """
    try:
        yield
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = os.fspath(path)
        if kind is None:
            raise
        raise kind(f"{error.filename or path}: {error.strerror or error}") from error


def name_beside(path: str | os.PathLike[str]) -> str:
    """Return ``; did you mean x?`` with the nearest name in the folder of a missing file."""
    with suppress(OSError):
        name = Path(path).name
        return did_you_mean(name, set(os.listdir(Path(path).parent)) - {name}, others=False)
    return ""


def open_file(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a regular file for reading; anything else, as a FIFO or a device, is an OSError."""
    with named_errors(path):
        try:
            _check(os.stat(path), path)
        except FileNotFoundError as error:
            raise FileNotFoundError(
                error.errno, f"{error.strerror}{name_beside(path)}", os.fspath(path)
            ) from None
        except ValueError as error:  # a name with a null character
            raise OSError(errno.EINVAL, str(error), os.fspath(path)) from None
        descriptor = os.open(path, _READ)
        try:
            _check(os.fstat(descriptor), path)
            return open(descriptor, "rb")
        except BaseException:
            os.close(descriptor)
            raise


def read_file(path: str | os.PathLike[str], most: int = -1) -> bytes:
    """Return the content of a regular file, or its first bytes, ``most`` of them."""
    with named_errors(path), open_file(path) as file:
        # Python takes as much memory as it may read.
        size = os.fstat(file.fileno()).st_size + 1
        return file.read(size if most < 0 else min(most, size))


def _check(its: os.stat_result, path: str | os.PathLike[str]) -> None:
    if stat.S_ISDIR(its.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    if not stat.S_ISREG(its.st_mode):
        raise OSError(errno.EINVAL, "is not a regular file", os.fspath(path))
