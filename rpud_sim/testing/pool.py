"""Drills that are kept from test to test, because a start takes longer than a reset."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rpud_sim.testing.drill import Drill
from rpud_sim.testing.drill_process import DrillProcess
from rpud_sim.testing.errors import DrillError
from rpud_sim.testing.setup import DrillSetup, drill_setup

_MOST_IDLE = 3  # drills that are kept: each takes some 200 MB

_Key = tuple[str, ...]


class DrillPool:
    """Drills of one process of tests."""

    def __init__(self) -> None:
        self._idle: list[tuple[_Key, Drill]] = []
        self._keys: dict[int, _Key] = {}

    def take(self, setup: DrillSetup, folder: Path | None = None) -> Drill:
        """Return a drill at time zero, as if just started; commands start in ``folder``."""
        key = _key(setup)
        for entry in [entry for entry in self._idle if entry[0] == key]:
            self._idle.remove(entry)
            drill = entry[1]
            try:
                drill.begin(setup.seed, setup.scenario)
            except DrillError:  # it has died, or does not come back: another one takes its place
                drill.close()
            else:
                drill.folder = folder
                self._keys[id(drill)] = key
                return drill
        drill = Drill(DrillProcess(setup.parameters, setup.namespace), folder)
        try:
            drill.begin(setup.seed, setup.scenario)
        except BaseException:
            drill.close()
            raise
        self._keys[id(drill)] = key
        return drill

    def give_back(self, drill: Drill) -> None:
        """Keep a drill for the next test; its processes under test end."""
        key = self._keys.pop(id(drill))
        if not drill.alive:
            drill.close()
            return
        drill.end()
        self._idle.append((key, drill))
        while len(self._idle) > _MOST_IDLE:
            self._idle.pop(0)[1].close()

    def close(self) -> None:
        while self._idle:
            self._idle.pop()[1].close()


@contextlib.contextmanager
def open_drill(folders: Sequence[Path] = (), **options: Any) -> Iterator[Drill]:
    """Start a drill in lockstep, and end it: for test runners other than pytest.

    ``folders`` are those in which relative paths are looked for; commands start in the first one.
    Options are those of the mark ``rpud``.
    """
    setup = drill_setup(options, folders)
    pool = DrillPool()
    drill = pool.take(setup, folders[0] if folders else None)
    try:
        yield drill
    finally:
        drill.close()


def _key(setup: DrillSetup) -> _Key:
    parameters = sorted(f"{name}={value!r}" for name, value in setup.parameters.items())
    return (setup.namespace, *parameters)
