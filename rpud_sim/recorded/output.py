"""New files and folders for the results of an inspection, and the damages that it skipped."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rpud_sim.bag import BagFormatError, BagReader
from rpud_sim.foundation.atomic_folder import EXISTS, atomic_folder, check_folder, write_atomic
from rpud_sim.foundation.user_files import named_errors
from rpud_sim.recorded import RecordingError


@contextmanager
def new_folder(out: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a folder that appears as ``out`` when it is complete, and not at all after an error."""
    with named_errors(out, RecordingError), atomic_folder(out) as folder:
        yield folder


def check_new_file(out: str | os.PathLike[str]) -> None:
    """Raise a RecordingError if ``out`` exists, or its folder does not."""
    if os.path.lexists(out):
        raise RecordingError(f"{os.fspath(out)}: {EXISTS}")
    with named_errors(out, RecordingError):
        check_folder(Path(out))


def write_new_file(out: str | os.PathLike[str], text: str) -> None:
    """Write a file that is there when it is complete, and not at all after an error."""
    check_new_file(out)
    with named_errors(out, RecordingError):
        write_atomic(Path(out), text)


class SkippedParts:
    """Damaged parts that an analysis of a bag skips; the account begins with the bag's own."""

    def __init__(self, bag: BagReader) -> None:
        self._parts = bag.damages
        self._messages: dict[str, tuple[int, str]] = {}

    def add(self, topic: str, reason: str) -> None:
        count, first = self._messages.get(topic, (0, reason))
        self._messages[topic] = count + 1, first

    def records(self, bag: BagReader, name: str) -> list[dict[str, str]]:
        """Return the metadata records of a name; none if they are damaged."""
        try:
            return bag.records(name)
        except BagFormatError as error:
            self.add_record(name, error)
            return []

    def add_record(self, name: str, error: BagFormatError) -> None:
        self._parts[f"record {name}"] = str(error)

    @property
    def texts(self) -> dict[str, str]:
        """Amount and reason of what is skipped, by topic or record."""
        messages = {
            topic: f"{count} of its messages: {reason}"
            for topic, (count, reason) in self._messages.items()
        }
        return {**self._parts, **messages}
