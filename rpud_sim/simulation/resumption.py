"""Resumption of a recorded run: its journal is run again up to an instant."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.changes import Planned
from rpud_sim.simulation.configuration import Settings, to_values
from rpud_sim.simulation.fields import Fields
from rpud_sim.simulation.journal import Journal, JournalEntry
from rpud_sim.simulation.rerun import JournalError, Rerun
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.together import Entry, Together


@dataclasses.dataclass(frozen=True)
class Resumed:
    """Recorded run at an instant."""

    run: Run  # with a journal that goes on with the number after the recorded entries
    settings: Settings  # in force
    faults: Entry | None  # the last message of the topic ``faults``
    # of the journal that the resumption itself added: the stop at the instant
    entries: tuple[Entry, ...]


def resume(
    entries: Sequence[JournalEntry],
    time: int,
    *,
    stop: bool,
    report: Callable[[float], object] = lambda seconds: None,
) -> Resumed:
    """Run a journal again up to an instant.

    Args:
        entries: up to that instant, at least one; all of them are repeated.
        time: simulation time of the instant in the last of their runs [ns].
        stop: whether the run stops exactly there, which its journal notes between two blocks.
            Otherwise it stops at the end of the last block before it.
        report: called with the seconds that were simulated since its last call.

    Raises:
        JournalError: if an entry cannot be repeated.
        EngineError: if the simulation cannot go on.
    """
    listening: list[bool] = []
    journal = Journal(states=False)  # the recorded ones are repeated
    rerun = Rerun(journal, lambda topic: bool(listening))
    faults: Entry | None = None
    reached = 0

    def hear(messages: Iterable[Entry | Together]) -> list[Entry]:
        nonlocal faults, reached
        heard = []
        for message in messages:
            if isinstance(message, Together):
                pass  # neither faults nor entries of the journal
            elif message[1] == "faults":
                faults = message
            elif message[1] == "journal":
                heard.append(message)
            if rerun.time >= reached + SECOND:
                report((rerun.time - reached) / SECOND)
                reached = rerun.time
        return heard

    for entry in entries:
        hear(rerun.repeat(entry))
        reached = min(reached, rerun.time)  # a restored checkpoint, or the next run
    run = rerun.run
    if run is None:
        raise JournalError("nothing has begun")
    rate = run.beginning.settings.telemetry_rate
    last = boundary(boundaries_until(time, rate), rate)
    if last > run.time:
        hear(run.advance_together(last))
    journal.restart(entries[-1].sequence + 1)
    stops = hear(run.advance_to(time)) if stop else []
    listening.append(True)
    configuration = run.simulation.configuration
    settings = run.beginning.settings.replace(to_values(configuration))
    return Resumed(run, settings, faults, tuple(stops))


@dataclasses.dataclass(frozen=True)
class Start:
    """Start of a drill in the state of a fork, in place of time zero."""

    run: Run  # in that state; it is copied
    settings: Settings  # in force
    journal: tuple[Fields, ...]  # messages of the journal up to there
    # changes that come by themselves; delays count from simulation time zero
    planned: tuple[Planned, ...] = ()
    # where the state came from, for the journal
    forked_from: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def next_journal(self) -> Journal:
        """Return a journal that goes on after the messages."""
        journal = Journal()
        journal.restart(int(self.journal[-1]["sequence"]) + 1)
        return journal
