"""Recorded changes after an instant, repeated on a run that may have gone another way."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

from rpud_sim.inspection.recorded_run import ForkError, RecordedRun
from rpud_sim.simulation.changes import Changes
from rpud_sim.simulation.configuration import to_configuration
from rpud_sim.simulation.faults import Fault, FaultError
from rpud_sim.simulation.journal import JournalEntry
from rpud_sim.simulation.rerun import JournalError, Rerun, repeat_change
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.together import Entry

Repeat = Callable[[Run], Iterable[Entry]]


def repeated(
    recorded: RecordedRun, time: int, end: int, changes: Changes
) -> Iterator[tuple[JournalEntry, Repeat]]:
    """Yield the recorded entries between two times [ns], and how to repeat each on the forked run.

    What a fork sets by itself is not taken back: recorded changes of these parameters are left out,
    and recorded commands where it has its own.
    """
    later = [entry for entry in recorded.later(time) if entry.time <= end]
    dropped = {
        kind
        for kind, name in (
            ("weight_on_bit", "weight_on_bit"),
            ("drive", "drive_enabled"),
            ("feed", ""),
        )
        if changes.replaces_commands or name in changes.parameters
    }
    cleared = {}
    if changes.planned and any(entry.kind == "clear" for entry in later):
        cleared = _cleared_faults(recorded.necessary(time), later)
    for entry in later:
        if entry.kind in dropped:
            continue
        if entry.kind == "configure" and changes.parameters:
            yield entry, partial(_configure, entry, changes)
        elif entry.kind == "clear" and entry.sequence in cleared:
            yield entry, partial(_clear, cleared[entry.sequence])
        else:
            yield entry, partial(_repeat, entry, strict=changes.empty)


def _repeat(entry: JournalEntry, run: Run, *, strict: bool) -> Iterator[Entry]:
    try:
        yield from repeat_change(run, entry)
    except FaultError as error:
        if strict:
            raise ForkError(f"journal entry {entry.sequence} cannot be done: {error}") from error
        raise
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise ForkError(f"journal entry {entry.sequence} cannot be done: {error!r:.100}") from error


def _configure(entry: JournalEntry, changes: Changes, run: Run) -> Iterator[Entry]:
    values = entry.content["parameters"]
    own = {name: value for name, value in changes.parameters.items() if name in values}
    run.simulation.configure(to_configuration({**values, **own}))
    yield from run.changes()


def _clear(fault: Fault, run: Run) -> Iterator[Entry]:
    """Clear a recorded fault, which may have another number in the forked run."""
    for record in run.simulation.faults.active:
        if (record.fault.kind, record.fault.channel) == (fault.kind, fault.channel):
            run.simulation.clear(record.number)
            yield from run.changes()
            return
    raise FaultError(f"there is no {fault} to clear")


def _cleared_faults(
    before: Sequence[JournalEntry], later: Iterable[JournalEntry]
) -> dict[int, Fault]:
    rerun = Rerun(wanted=lambda topic: False)
    found: dict[int, Fault] = {}
    try:
        for entry in before:
            _exhaust(rerun.repeat(entry))
        for entry in later:
            _exhaust(rerun.advance_to(entry.time))
            for record in rerun.run.simulation.faults.active if rerun.run else ():
                if entry.kind == "clear" and record.number == entry.content["number"]:
                    found[entry.sequence] = record.fault
            _exhaust(rerun.repeat(entry))
    except (JournalError, LookupError, TypeError) as error:
        raise ForkError(f"the journal cannot be repeated: {error}") from error
    return found


def _exhaust(messages: Iterable[object]) -> None:
    for _ in messages:
        pass
