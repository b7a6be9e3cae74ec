"""Bags in scripts: the runs of the drills in them, and every topic."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from rpud_sim.bag import BagReader
from rpud_sim.recorded import compare as _bags
from rpud_sim.recorded.journal import held_journals
from rpud_sim.recorded.runs import runs_of
from rpud_sim.recorded.verify import Verification
from rpud_sim.recorded.verify import verify as _verify_bag
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


class _Place(NamedTuple):
    path: str | os.PathLike[str]
    run: int | None = None
    namespace: str | None = None


@contextmanager
def _place_of(source: str | os.PathLike[str] | DrillRun) -> Iterator[_Place]:
    """Provide where a run is recorded; one in memory is for a while in a temporary bag."""
    if not isinstance(source, DrillRun):
        yield _Place(source)
    elif source.recorded is not None:
        yield _Place(source.recorded.path, source.recorded.number, source.recorded.namespace)
    else:
        with TemporaryDirectory(prefix="rpud_run_") as folder:
            yield _Place(source.save(Path(folder, "run")))


def verify(source: str | os.PathLike[str] | DrillRun) -> Verification:
    """Verify a bag, or the bag of a run; see ``rpud_sim.recorded.verify``."""
    with _place_of(source) as place:
        return _verify_bag(place.path)


def compare(*sources: Any, **options: Any) -> _bags.Comparison:
    """Compare the second of two bags or runs, or of a list of two, with the first one.

    Options are as in ``rpud_sim.recorded.compare``; a run of an open bag is that run of it.
    """
    with ExitStack() as held:
        given = sources[0] if len(sources) == 1 else sources
        places = [held.enter_context(_place_of(each)) for each in given]
        if any(place.run for place in places):
            options.setdefault("run_numbers", [place.run for place in places])
            options.setdefault("namespaces", [place.namespace for place in places])
        return _bags.compare([place.path for place in places], **options)
