"""New folders for the results of an inspection, and the reasons why a result cannot be written."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rpud_sim.foundation.whole_folder import whole_file, whole_folder


@contextmanager
def new_folder(out: str | os.PathLike[str], failure: type[Exception]) -> Iterator[Path]:
    """Yield a folder that appears as ``out`` when it is complete, and not at all after an error.

    If ``out`` exists or cannot be written, it raises ``failure`` with the reason in one line.
    """
    try:
        with whole_folder(out) as folder:
            yield folder
    except OSError as error:
        raise failure(output_reason(out, error)) from error


def check_new_file(out: str | os.PathLike[str], failure: type[Exception]) -> None:
    """Raise ``failure`` if ``out`` exists, or its folder does not."""
    if os.path.lexists(out):
        raise failure(output_reason(out, FileExistsError()))
    if not Path(out).parent.is_dir():
        raise failure(f"cannot write {out}: there is no folder {Path(out).parent}")


def write_new_file(out: str | os.PathLike[str], text: str, failure: type[Exception]) -> None:
    """Write a file that is there when it is complete, and not at all after an error."""
    check_new_file(out, failure)
    try:
        with whole_file(Path(out)) as unfinished:
            unfinished.write_text(text, encoding="utf-8")
    except OSError as error:
        raise failure(output_reason(out, error)) from error


def output_reason(out: str | os.PathLike[str], error: OSError) -> str:
    """Return in one line why ``out`` cannot be written."""
    if isinstance(error, FileExistsError):
        return f"{error.filename or os.fspath(out)} exists already; nothing is overwritten"
    return f"cannot write {os.fspath(out)}: {error.strerror or error}"
