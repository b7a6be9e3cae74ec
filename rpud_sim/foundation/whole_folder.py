"""New folders, and files in them: there when all is whole, and never written through a link."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

UNFINISHED = ".unfinished"
"""Behind the name of a file until all of it is written."""


@contextmanager
def whole_folder(out: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a folder that gets the name ``out`` when all is in it, and goes when something fails.

    Raises FileExistsError, with the name, where anything exists at ``out`` or at the name that the
    folder has until then, and OSError where it cannot be made.
    """
    whole = Path(os.path.abspath(out))
    part = Path(f"{whole}.part")
    for there, name in ((whole, os.fspath(out)), (part, f"{os.fspath(out)}.part")):
        if os.path.lexists(there):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), name)
    part.mkdir(parents=True)
    try:
        yield part
        part.rename(whole)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a path to write to, which becomes this one when all is written and on the disk."""
    unfinished = path.with_name(path.name + UNFINISHED)
    # A call that was killed may have left it; what a link of that name leads to is not ours.
    unfinished.unlink(missing_ok=True)
    unfinished.open("xb").close()
    yield unfinished
    with unfinished.open("rb") as file:
        os.fsync(file.fileno())
    unfinished.replace(path)
