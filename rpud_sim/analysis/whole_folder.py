"""A new folder of files: there when all of it is whole, and not at all when something fails."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


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
