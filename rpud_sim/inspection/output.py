"""New folders for the results of an inspection, and the reasons why a result cannot be written."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rpud_sim.foundation.whole_folder import whole_folder


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


def output_reason(out: str | os.PathLike[str], error: OSError) -> str:
    """Return in one line why ``out`` cannot be written."""
    if isinstance(error, FileExistsError):
        return f"{error.filename or os.fspath(out)} exists already; nothing is overwritten"
    return f"cannot write {os.fspath(out)}: {error.strerror or error}"
