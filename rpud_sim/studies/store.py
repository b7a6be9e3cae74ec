"""Store of a study that can be resumed: its folder, locked while it runs and never mixed up.

A file appears when it is complete, so that a study can be killed at any time. The next call runs
the chunks of work whose files are missing.
"""

from __future__ import annotations

import abc
import contextlib
import fcntl
import json
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Generic, TypeVar

from rpud_sim.foundation.json_text import json_text
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.whole_folder import UNFINISHED, write_whole
from rpud_sim.studies.workers import StudyChunk, run_chunks

MANIFEST = "manifest.json"
_LONGEST_VALUE = 100  # characters in a message

Report = Callable[[int], None]  # called with the number of runs that finished since its last call
_Chunk = TypeVar("_Chunk", bound=StudyChunk)
_Outcome = TypeVar("_Outcome")


class StudyStore(abc.ABC, Generic[_Chunk, _Outcome]):
    """Folder of a study, named as its command, with the outcomes of its chunks."""

    def __init__(self, path: Path, manifest: dict[str, Any], study: str, report: Report) -> None:
        self.path = path
        # All that its results depend on, as JSON reads it back.
        self.manifest = json.loads(json_text(manifest))
        self.simulated = 0  # runs of this call
        self.kept = 0  # runs of earlier calls
        self._study = study
        self._report = report

    @abc.abstractmethod
    def has(self, chunk: _Chunk) -> bool:
        """Whether the outcome of a chunk is there as a whole: a power loss may have torn it."""

    @abc.abstractmethod
    def add(self, chunk: _Chunk, outcome: _Outcome) -> None:
        """Keep the outcome of a chunk."""

    def finish(
        self,
        chunks: Iterable[_Chunk],
        work: Callable[[_Chunk], _Outcome],
        prepare: Callable[[], None],
        workers: int,
        scheduler: str | None = None,
    ) -> None:
        """Run the chunks that are missing, as ``run_chunks`` does; ``prepare`` comes before."""
        missing = []
        for chunk in chunks:
            if self.has(chunk):
                self.kept += chunk.count
                self._report(chunk.count)
            else:
                missing.append(chunk)
        if missing:
            prepare()
            with contextlib.closing(run_chunks(work, missing, workers, scheduler)) as outcomes:
                for chunk, outcome in outcomes:
                    self.add(chunk, outcome)
                    self.simulated += chunk.count
                    self._report(chunk.count)

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Create or open the folder, and lock it against other processes.

        If the folder is refused, nothing in it changes.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        handle = os.open(self.path, os.O_RDONLY)
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                reason = f"{self.path}: another rpud {self._study} is at work there"
                raise ParameterError(reason) from None
            self._check_or_write()
            yield
        finally:
            os.close(handle)

    def _check_or_write(self) -> None:
        path, study = self.path / MANIFEST, self._study
        if path.exists():
            try:
                found = json.loads(path.read_text(encoding="utf-8"))
            except ValueError:
                raise ParameterError(f"{path}: is no manifest of a {study}") from None
            if difference := _difference(found, self.manifest):
                reason = f"is of another {study}: {difference}; choose another --out"
                raise ParameterError(f"{path}: {reason}")
            return
        if any(not name.name.endswith(UNFINISHED) for name in self.path.iterdir()):
            reason = f"is not empty and holds no {study}; choose another --out"
            raise ParameterError(f"{self.path}: {reason}")
        write_whole(path, json_text(self.manifest, indent=2) + "\n")


def _difference(found: Any, wanted: Any) -> str:
    """Return the first entry in which two manifests differ, empty if they are equal."""
    there, here = dict(_entries(found)), dict(_entries(wanted))
    for name in {**here, **there}:
        old, new = (json_text(each.get(name)) for each in (there, here))
        if old != new:
            return f"{name} is {old:.{_LONGEST_VALUE}} there and {new:.{_LONGEST_VALUE}} here"
    return ""


def _entries(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every entry of nested mappings and lists by its path; an empty one is an entry."""
    if not (isinstance(value, (dict, list)) and value):
        yield path, value
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from _entries(inner, f"{path}[{number}]")
    else:
        for name, inner in value.items():
            yield from _entries(inner, f"{path}.{name}" if path else name)
