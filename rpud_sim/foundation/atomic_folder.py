"""Folders and files that appear under their names only when they are complete."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from rpud_sim.foundation.user_files import named_errors

EXISTS = "exists already; nothing is overwritten"

# Suffix of the name of a file until it is complete
UNFINISHED = ".unfinished"


@contextmanager
def atomic_folder(out: str | os.PathLike[str]) -> Iterator[Path]:
    """Context with a new folder, which is renamed to ``out`` at its end; deleted after an error.

    A FileExistsError names ``out``, or ``out`` with ``.part``, its name until then, if it exists.
    """
    whole = Path(os.path.abspath(out))
    part = Path(f"{whole}.part")
    for existing, name in ((whole, os.fspath(out)), (part, f"{os.fspath(out)}.part")):
        if os.path.lexists(existing):
            raise FileExistsError(errno.EEXIST, EXISTS, name)
    try:
        made = make_folder(part)
    except OSError as error:
        error.filename = os.fspath(out)
        raise
    try:
        yield part
        part.rename(whole)
    except BaseException:
        remove_folder(made)
        raise


def make_folder(folder: Path) -> list[Path]:
    """Make a folder and those above it; return what was made, the folder first."""
    made = [each for each in (folder, *folder.parents) if not os.path.lexists(each)]
    try:
        folder.mkdir(parents=True)
    except FileExistsError:  # another process has made it meanwhile, and it stays
        raise
    except OSError:
        _remove_empty(made[1:])
        raise
    return made


def remove_folder(made: Sequence[Path]) -> None:
    """Remove a folder with its content, and of those that were made above it the empty ones."""
    for folder in made[:1]:
        shutil.rmtree(folder, ignore_errors=True)
    _remove_empty(made[1:])


def _remove_empty(folders: Sequence[Path]) -> None:
    for folder in folders:
        with suppress(OSError):  # something else has come there
            folder.rmdir()


def check_folder(path: Path) -> None:
    """Raise an OSError if there is no folder for a file, or a folder has its name."""
    if not path.parent.is_dir():
        text = f"there is no folder {path.parent}"
        raise FileNotFoundError(errno.ENOENT, text, os.fspath(path))
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Context with a path to write to, which replaces ``path`` when all is on the disk."""
    check_folder(path)
    unfinished = path.with_name(path.name + UNFINISHED)
    # A killed process may have left it. A link of that name must not be followed: its target is not
    # ours.
    unfinished.unlink(missing_ok=True)
    unfinished.open("xb").close()
    try:
        yield unfinished
        with unfinished.open("rb") as file:
            os.fsync(file.fileno())
        unfinished.replace(path)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise


def write_atomic(path: Path, content: str | bytes) -> None:
    """Write a file that appears when it is complete."""
    with named_errors(path), atomic_file(path) as unfinished:
        unfinished.write_bytes(content.encode() if isinstance(content, str) else content)
