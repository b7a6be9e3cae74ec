"""Bags in scripts: the runs of the drills in them, and every topic."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path

from rpud_sim.bag import BagReader
from rpud_sim.recorded.journal import held_journals
from rpud_sim.recorded.runs import runs_of
from rpud_sim.scripting.runs import DrillRun


class DrillBag(BagReader):
    """Open bag with the runs of its drills; topics of any type have ``arrays`` and ``frame``."""

    def __repr__(self) -> str:
        return f"<DrillBag {os.fspath(self.path)}: {len(self.readable_topics)} topics>"

    def __fspath__(self) -> str:
        return os.fspath(self.path)

    def __reduce__(self) -> tuple[type[DrillBag], tuple[Path]]:
        return DrillBag, (self.path,)  # a copy opens it again

    @cached_property
    def runs(self) -> tuple[DrillRun, ...]:
        """Runs of the drills in their order; a reset begins a new one.

        Raises:
            RecordingError: if the bag holds no journal, or one of another engine.
        """
        return tuple(
            DrillRun(run.plan, run.end, self, run)
            for topic in held_journals(self)
            for run in runs_of(self, topic)
        )


def open(path: str | os.PathLike[str]) -> DrillBag:
    """Open a bag for reading; ``path`` is its directory or one MCAP file of it."""
    return DrillBag(path)
