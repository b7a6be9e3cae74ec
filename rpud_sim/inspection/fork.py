"""Fork of a recorded run: its state at any instant, and how a bag or a drill node goes on."""

from __future__ import annotations

import dataclasses
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from operator import itemgetter
from typing import Any

import rpud_sim.bag
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection import InspectionError
from rpud_sim.inspection.recorded_drill import RecordedDrill, find_run
from rpud_sim.inspection.recorded_journal import Recorded
from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.configuration import PARAMETERS, Settings, to_configuration, to_values
from rpud_sim.simulation.faults import Fault, FaultError
from rpud_sim.simulation.fields import Bookkeeping, header_fields
from rpud_sim.simulation.journal import Journal, JournalEntry
from rpud_sim.simulation.plans import Agenda, Changes, apply_change, apply_parameters
from rpud_sim.simulation.rerun import JournalError, Rerun, Start, repeat_change
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.telemetry import Entry, Together
from rpud_sim.simulation.topics import Fields

# Parameters of a node that a live fork may have otherwise, for they change no bit.
LIVE = ("autostart", "publish_clock", "start_paused", "thread_priority")


@dataclasses.dataclass(frozen=True)
class Fork:
    """Recorded run at the instant of a fork, and where it came from."""

    recorded: RecordedDrill  # the run of the bag
    time: int  # instant, in simulation time [ns]
    # in its state there, with a journal that goes on with the number after the recorded entries
    run: Run
    settings: Settings  # in force
    # last message of the topic ``faults``, and entries of the journal for the stop at the instant
    entries: tuple[Entry, ...]
    # messages of the journal up to there, with the times at which they were published
    history: tuple[tuple[int, Fields], ...]
    origin: Mapping[str, Any]  # the manifest's ``forked_from``

    @property
    def scenario(self) -> str | None:
        """Text of the scenario, if the bag has it."""
        manifest = self.recorded.manifest
        return manifest.scenario if manifest else None


def open_fork(
    path: str | os.PathLike[str],
    at: float,
    changes: Changes,
    *,
    run: int = 1,
    topic: str | None = None,
    stop: bool,
    report: Callable[[float], object] = lambda seconds: None,
) -> Fork:
    """Run a recorded run again up to an instant, in simulation time of the run [s].

    Runs count from 1; ``topic`` chooses one of several journals. ``stop`` is exactly at the
    instant.
    """
    with rpud_sim.bag.open(path) as bag:
        recorded = find_run(bag, run, topic)
    time = round(at * SECOND)
    _check_instant(recorded, time)
    recorded.check_engine()
    try:
        resumed = _resume(recorded.necessary(time), time, stop, report)
    except JournalError as error:
        raise InspectionError(f"{recorded.journal}: {error}") from error
    history = tuple((each.message.publish_time, _fields(each)) for each in recorded.history(time))
    origin = {
        "bag": os.fspath(path),
        "run": run,
        "at": time / SECOND,
        "journal": recorded.digest(time),
        "changes": _to_json(changes),
    }
    return Fork(recorded, time, *resumed, history, origin)


def _resume(
    entries: Sequence[JournalEntry], time: int, stop: bool, report: Callable[[float], object]
) -> tuple[Run, Settings, tuple[Entry, ...]]:
    """Run a journal again up to a simulation time of the last of its runs [ns].

    ``entries`` are all up to there, at least one. With ``stop`` the run stops exactly there, which
    its journal notes between two blocks; otherwise at the end of the last block before. ``report``
    is called with the seconds that were simulated since its last call.
    """
    wanted: set[str] = set()
    journal = Journal(states=False)  # the recorded ones are repeated
    rerun = Rerun(journal, lambda topic: bool(wanted))
    kept: dict[str, Entry] = {}  # the last of each topic
    reached = 0

    def hear(messages: Iterable[Entry | Together]) -> None:
        nonlocal reached
        for message in messages:
            if not isinstance(message, Together):  # which has neither faults nor entries
                kept[message[1]] = message
            if rerun.time >= reached + SECOND:
                report((rerun.time - reached) / SECOND)
                reached = rerun.time

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
    kept.pop("journal", None)
    if stop:
        hear(run.advance_to(time))
    wanted.add("all")
    settings = run.beginning.settings.replace(to_values(run.simulation.configuration))
    return run, settings, tuple(kept[name] for name in ("faults", "journal") if name in kept)


def live_start(fork: Fork, changes: Changes) -> Start:
    """Return the start of a drill node in the state of a fork.

    Recorded changes after the instant are not repeated, for others command a node. Scheduled ends
    of faults and the rest of the scenario are part of the state. The fork must have stopped at its
    instant; its run is used up.
    """
    run = fork.run
    settings = begin_changes(run, fork.settings, changes)
    entries = (*fork.entries, *run.changes())
    # The scenario is part of the state, and its file may be another one by now.
    of_node = {name: value for name, value in changes.parameters.items() if name in LIVE}
    fixed: dict[str, Any] = {"scenario": "", "autostart": True, **of_node}
    if run.beginning.seed <= PARAMETERS["seed"].allowed.maximum:  # type: ignore[union-attr]
        fixed["seed"] = run.beginning.seed
    return Start(
        run,
        settings.replace(fixed),
        (
            *(fields for _, fields in fork.history),
            *(fields for _, name, fields in entries if name == "journal"),
        ),
        tuple(
            planned._replace(delay=fork.time + planned.delay)
            for planned in changes.planned
            if planned.delay
        ),
        fork.origin,
    )


def begin_changes(run: Run, settings: Settings, changes: Changes) -> Settings:
    """Make the changes that come at the instant of the fork; return the settings in force."""
    run.control.adopt()
    settings = apply_parameters(run, settings, changes.parameters)
    for planned in changes.planned:
        if planned.delay == 0:
            apply_change(run.control, planned.change)
    return settings


def _fields(recorded: Recorded) -> Fields:
    own = {name: getattr(recorded.fields, name) for name in ("sequence", "kind", "content")}
    return {"header": header_fields("journal", recorded.stamp), **own}


def _check_instant(recorded: RecordedDrill, time: int) -> None:
    if recorded.start <= time <= recorded.end:
        return
    start, end, at = (each / SECOND for each in (recorded.start, recorded.end, time))
    if time > recorded.end and recorded.torn:
        why = f"complete up to {end:.9g} s alone: {recorded.torn}"
        raise InspectionError(f"--at = {at:.9g} s: the journal is {why}")
    which = f"run {recorded.number} of {recorded.runs} of the bag"
    raise InspectionError(f"--at = {at:.9g} s is outside {which}: [{start:.9g}, {end:.9g}] s")


def _to_json(changes: Changes) -> dict[str, Any]:
    return {
        "parameters": dict(changes.parameters),
        "replaces_commands": changes.replaces_commands,
        "planned": [
            {
                "delay": planned.delay / SECOND,
                type(planned.change).__name__: dataclasses.asdict(planned.change),
            }
            for planned in changes.planned
        ],
    }


class Continuation:
    """Messages of a fork, from its instant on for a duration [s].

    Without a duration it goes up to the end of the recorded run. A journal that does not hold what
    followed raises an InspectionError. The recorded changes are repeated, but what the fork sets by
    itself is not taken back: changes of these parameters are left out, and recorded commands where
    it has its own.
    """

    def __init__(self, fork: Fork, changes: Changes, duration: float | None) -> None:
        self.end = _end(fork, duration)  # simulation time at which it ends [ns]
        self.warnings: list[str] = []  # refused changes, one line each
        self._fork = fork
        self._changes = changes
        self._run = fork.run
        # Without commands of its own the fork repeats what the watchdog did.
        self._watches = changes.replaces_commands
        self._cleared: dict[int, Fault] = {}  # by the number of the journal's entry

    def begin(self) -> Iterator[Entry]:
        """Apply the changes at the instant, and yield their messages and a status."""
        if not self._changes.empty:
            begin_changes(self._run, self._fork.settings, self._changes)
            yield from self._run.changes()
        yield self._run.status("running", Bookkeeping())

    def messages(self, report: Callable[[float], object]) -> Iterator[Entry]:
        run = self._run
        events = Agenda(sorted(self._events(), key=itemgetter(0)))
        while True:
            time = min(events.next, self.end)
            while run.time < time:
                before = run.time
                yield from run.advance_to(min(run.next_boundary, time))
                report((run.time - before) / SECOND)
                if run.time % SECOND == 0:
                    yield self._status()
                if self._watches:
                    yield from self._watch()
            if events.next > self.end:
                break
            shown = self._shown()
            for happens in events.due(time):
                try:
                    yield from happens() or ()
                    yield from run.changes()
                except ParameterError as error:  # a node would refuse it as well
                    self.warnings.append(f"refused at {time / SECOND:.9g} s: {error}")
            if self._shown() != shown:
                yield self._status()
        yield from run.flush("end")
        yield run.status("stopped", Bookkeeping())

    def _shown(self) -> tuple[Any, ...]:
        """Return what a status follows if it changes."""
        simulation = self._run.simulation
        return simulation.applied, simulation.configuration, simulation.faults.active

    def _status(self) -> Entry:
        lost = self._run.control.commands_lost if self._watches else False
        return self._run.status("running", Bookkeeping(commands_lost=lost))

    def _watch(self) -> Iterator[Entry]:
        applied = self._run.simulation.applied
        if self._run.control.act() or self._run.simulation.applied is not applied:
            yield from self._run.changes()
            yield self._status()

    def _events(self) -> Iterator[tuple[int, Callable[[], Iterable[Entry] | None]]]:
        """Yield times [ns] and what happens then; it may give messages."""
        recorded, time, changes = self._fork.recorded, self._fork.time, self._changes
        later = [entry for entry in recorded.later(time) if entry.time <= self.end]
        kinds = (("weight_on_bit", "weight_on_bit"), ("drive", "drive_enabled"), ("feed", ""))
        dropped = {
            kind for kind, name in kinds if changes.replaces_commands or name in changes.parameters
        }
        if changes.planned and any(entry.kind == "clear" for entry in later):
            self._cleared = _cleared_faults(recorded.necessary(time), later)
        for entry in later:
            if entry.kind not in dropped:
                yield entry.time, partial(self._repeat, entry)
        for planned in changes.planned:
            if planned.delay:
                yield time + planned.delay, partial(apply_change, self._run.control, planned.change)

    def _repeat(self, entry: JournalEntry) -> Iterator[Entry]:
        own = self._changes.parameters
        refused = f"journal entry {entry.sequence} cannot be done"
        try:
            if entry.kind == "configure" and own:
                values = entry.content["parameters"]
                kept = {name: value for name, value in own.items() if name in values}
                self._run.simulation.configure(to_configuration({**values, **kept}))
            elif entry.sequence in self._cleared:
                self._clear(self._cleared[entry.sequence])
            else:
                yield from repeat_change(self._run, entry)
        except ParameterError as error:
            if self._changes.empty:
                raise InspectionError(f"{refused}: {error}") from error
            raise
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            raise InspectionError(f"{refused}: {error!r:.100}") from error

    def _clear(self, fault: Fault) -> None:
        """Clear a recorded fault, which may have another number in the forked run."""
        simulation, wanted = self._run.simulation, (fault.kind, fault.channel)
        active = simulation.faults.active
        found = [r.number for r in active if (r.fault.kind, r.fault.channel) == wanted]
        if not found:
            raise FaultError(f"there is no {fault} to clear")
        simulation.clear(found[0])


def _end(fork: Fork, duration: float | None) -> int:
    recorded = fork.recorded
    end = recorded.end if duration is None else fork.time + round(duration * SECOND)
    if recorded.torn and (duration is None or end > recorded.end):
        raise InspectionError(
            f"the journal is complete up to {recorded.end / SECOND:.9g} s alone: {recorded.torn}; "
            "give a --duration that ends before"
        )
    if end <= fork.time:
        at = f"--at = {fork.time / SECOND:.9g} s"
        raise InspectionError(f"nothing is left of the recorded run after {at}: give --duration")
    return end


def _cleared_faults(
    before: Iterable[JournalEntry], later: Iterable[JournalEntry]
) -> dict[int, Fault]:
    """Return the faults that recorded entries clear, by the numbers of these entries."""
    rerun = Rerun(wanted=lambda topic: False)
    found: dict[int, Fault] = {}
    try:
        for entry in before:
            deque(rerun.repeat(entry), 0)
        for entry in later:
            deque(rerun.advance_to(entry.time), 0)
            for record in rerun.run.simulation.faults.active if rerun.run else ():
                if entry.kind == "clear" and record.number == entry.content["number"]:
                    found[entry.sequence] = record.fault
            deque(rerun.repeat(entry), 0)
    except (JournalError, LookupError, TypeError) as error:
        raise InspectionError(f"the journal cannot be repeated: {error}") from error
    return found
