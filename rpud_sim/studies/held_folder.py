"""Folder of a study that can be resumed: locked while it runs, and never mixed up with another."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rpud_sim.foundation.whole_folder import UNFINISHED, whole_file

MANIFEST = "manifest.json"
_LONGEST_VALUE = 100  # characters in a message


@contextlib.contextmanager
def held_folder(
    path: Path, manifest: Mapping[str, Any], study: str, refuse: type[Exception]
) -> Iterator[None]:
    """Create or open the folder of a study, and lock it against other processes.

    Args:
        manifest: everything that the study's results depend on, as JSON reads it back.
        study: name of the study and of its command.

    Raises:
        refuse: if it is locked or holds anything but this study; nothing is changed then.
        OSError: if it cannot be created.
    """
    path.mkdir(parents=True, exist_ok=True)
    handle = os.open(path, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise refuse(f"{path}: another rpud {study} is at work there") from None
        _check_or_write(path, manifest, study, refuse)
        yield
    finally:
        os.close(handle)


def _check_or_write(
    folder: Path, manifest: Mapping[str, Any], study: str, refuse: type[Exception]
) -> None:
    path = folder / MANIFEST
    if path.exists():
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            raise refuse(f"{path}: is no manifest of a {study}") from None
        if difference := _difference(found, manifest):
            raise refuse(f"{path}: is of another {study}: {difference}; choose another --out")
        return
    if any(not name.name.endswith(UNFINISHED) for name in folder.iterdir()):
        raise refuse(f"{folder}: is not empty and holds no {study}; choose another --out")
    with whole_file(path) as unfinished:
        unfinished.write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")


def _difference(found: Any, wanted: Any, entry: str = "") -> str:
    """Return the first entry in which two manifests differ, empty if they are equal."""
    if isinstance(found, dict) and isinstance(wanted, dict):
        for name in (*wanted, *(name for name in found if name not in wanted)):
            inner = f"{entry}.{name}" if entry else name
            if difference := _difference(found.get(name), wanted.get(name), inner):
                return difference
        return ""
    if type(found) is type(wanted) and found == wanted:
        return ""
    if isinstance(found, list) and isinstance(wanted, list):
        if len(found) != len(wanted):
            return f"{entry} has {len(found)} entries there and {len(wanted)} here"
        pairs = enumerate(zip(found, wanted, strict=True))
        return next(d for i, (a, b) in pairs if (d := _difference(a, b, f"{entry}[{i}]")))
    return f"{entry} is {_short(found)} there and {_short(wanted)} here"


def _short(value: Any) -> str:
    """Return a value as JSON, cut off where a line would get too long."""
    text = json.dumps(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}..."
