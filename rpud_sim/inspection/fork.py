"""Fork of a recorded run: its state at any instant, and how a bag or a drill node goes on."""

from __future__ import annotations

import dataclasses
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import rpud_sim.bag
from rpud_sim.bag import Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection import InspectionError
from rpud_sim.inspection.recorded_drill import RecordedDrill, find_run
from rpud_sim.simulation.changes import Change, Changes, apply_change, apply_parameters
from rpud_sim.simulation.configuration import PARAMETERS, Settings, to_configuration
from rpud_sim.simulation.faults import Fault, FaultError
from rpud_sim.simulation.fields import Bookkeeping
from rpud_sim.simulation.journal import JournalEntry
from rpud_sim.simulation.rerun import JournalError, Rerun, Resumed, Start, repeat_change, resume
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.telemetry import Entry
from rpud_sim.simulation.topics import Fields

# Parameters of a node that a live fork may have otherwise, for they change no bit.
LIVE = ("autostart", "publish_clock", "start_paused", "thread_priority")

# A change of a run, at a time in nanoseconds; it yields messages.
_Event = tuple[int, Callable[[], Iterable[Entry]]]


@dataclasses.dataclass(frozen=True)
class Fork:
    """Recorded run at the instant of a fork, and where it came from."""

    recorded: RecordedDrill  # the run of the bag
    time: int  # instant, in simulation time [ns]
    resumed: Resumed  # the run in its state there
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
    _check_instant(recorded, time, at)
    recorded.check_engine()
    try:
        resumed = resume(recorded.necessary(time), time, stop=stop, report=report)
    except JournalError as error:
        raise InspectionError(f"{recorded.journal}: {error}") from error
    history = tuple(
        (message.publish_time, _fields(message, recorded.codec))
        for message, _ in recorded.history(time)
    )
    origin = {
        "bag": os.fspath(path),
        "run": run,
        "at": time / SECOND,
        "journal": recorded.digest(time),
        "changes": _to_json(changes),
    }
    return Fork(recorded, time, resumed, history, origin)


def live_start(fork: Fork, changes: Changes) -> Start:
    """Return the start of a drill node in the state of a fork.

    Recorded changes after the instant are not repeated, for others command a node. Scheduled ends
    of faults and the rest of the scenario are part of the state. The fork must have stopped at its
    instant; its run is used up.
    """
    run = fork.resumed.run
    settings = begin_changes(run, fork.resumed.settings, changes)
    entries = (*fork.resumed.entries, *run.changes())
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
            dataclasses.replace(planned, delay=fork.time + planned.delay)
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
            apply_change(run, planned.change)
    return settings


def _fields(message: Message, codec: Codec) -> Fields:
    decoded = codec.decode(message.data)
    stamp = decoded.header.stamp
    return {
        "header": {
            "stamp": {"sec": stamp.sec, "nanosec": stamp.nanosec},
            "frame_id": decoded.header.frame_id,
        },
        "sequence": decoded.sequence,
        "kind": decoded.kind,
        "content": decoded.content,
    }


def _check_instant(recorded: RecordedDrill, time: int, at: float) -> None:
    start, end = recorded.start / SECOND, recorded.end / SECOND
    if recorded.start <= time <= recorded.end:
        return
    given = f"--at = {at:.9g} s"
    if time > recorded.end and recorded.torn:
        raise InspectionError(
            f"{given}: the journal is complete up to {end:.9g} s alone: {recorded.torn}"
        )
    which = f"run {recorded.number} of {recorded.runs}" if recorded.runs > 1 else "the run"
    raise InspectionError(f"{given} is outside {which} of the bag: [{start:.9g}, {end:.9g}] s")


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
    followed raises a InspectionError.
    """

    def __init__(self, fork: Fork, changes: Changes, duration: float | None) -> None:
        self.end = _end(fork, duration)  # simulation time at which it ends [ns]
        self.warnings: list[str] = []  # refused changes, one line each
        self._fork = fork
        self._changes = changes
        self._run = fork.resumed.run
        # Without commands of its own the fork repeats what the watchdog did.
        self._watches = changes.replaces_commands

    def begin(self) -> Iterator[Entry]:
        """Apply the changes at the instant, and yield their messages and a status."""
        if not self._changes.empty:
            begin_changes(self._run, self._fork.resumed.settings, self._changes)
            yield from self._run.changes()
        yield self._run.status("running", Bookkeeping())

    def messages(self, report: Callable[[float], object]) -> Iterator[Entry]:
        run = self._run
        events = deque(sorted(self._events(), key=lambda event: event[0]))
        while True:
            time = min(events[0][0] if events else self.end, self.end)
            while run.time < time:
                before = run.time
                yield from run.advance_to(min(run.next_boundary, time))
                report((run.time - before) / SECOND)
                if run.time % SECOND == 0:
                    yield self._status()
                if self._watches:
                    yield from self._watch()
            if not events or events[0][0] > self.end:
                break
            changed = False
            while events and events[0][0] == time:
                before_change = run.simulation.applied, run.simulation.configuration
                faults = run.simulation.faults.active
                yield from events.popleft()[1]()
                after = run.simulation.applied, run.simulation.configuration
                changed |= after != before_change or run.simulation.faults.active is not faults
            if changed:
                yield self._status()
        yield from run.flush("end")
        yield run.status("stopped", Bookkeeping())

    def _status(self) -> Entry:
        lost = self._run.control.commands_lost if self._watches else False
        return self._run.status("running", Bookkeeping(commands_lost=lost))

    def _watch(self) -> Iterator[Entry]:
        applied = self._run.simulation.applied
        if self._run.control.act() or self._run.simulation.applied is not applied:
            yield from self._run.changes()
            yield self._status()

    def _events(self) -> Iterator[_Event]:
        fork, run = self._fork, self._run
        for time, repeat in _repeated(fork, self.end, self._changes):
            yield time, partial(self._try, time, repeat)
        for planned in self._changes.planned:
            if planned.delay:
                time = fork.time + planned.delay
                yield time, partial(self._try, time, partial(_apply, planned.change, run))

    def _try(self, time: int, act: Callable[[], Iterable[Entry]]) -> Iterator[Entry]:
        """Act; a fork may refuse what the recorded run did not, as a node would."""
        try:
            yield from act()
        except ParameterError as error:
            self.warnings.append(f"refused at {time / SECOND:.9g} s: {error}")


def _end(fork: Fork, duration: float | None) -> int:
    recorded = fork.recorded
    end = recorded.end if duration is None else fork.time + round(duration * SECOND)
    if recorded.torn and (duration is None or end > recorded.end):
        raise InspectionError(
            f"the journal is complete up to {recorded.end / SECOND:.9g} s alone: {recorded.torn}; "
            "give a --duration that ends before"
        )
    if end <= fork.time:
        raise InspectionError(
            f"nothing is left of the recorded run after --at = {fork.time / SECOND:.9g} s: give "
            "--duration"
        )
    return end


def _repeated(fork: Fork, end: int, changes: Changes) -> Iterator[_Event]:
    """Yield the recorded changes between the instant and a time [ns], repeated on the forked run.

    What a fork sets by itself is not taken back: recorded changes of these parameters are left out,
    and recorded commands where it has its own.
    """
    recorded, run = fork.recorded, fork.resumed.run
    later = [entry for entry in recorded.later(fork.time) if entry.time <= end]
    kinds = (("weight_on_bit", "weight_on_bit"), ("drive", "drive_enabled"), ("feed", ""))
    dropped = {
        kind for kind, name in kinds if changes.replaces_commands or name in changes.parameters
    }
    cleared = {}
    if changes.planned and any(entry.kind == "clear" for entry in later):
        cleared = _cleared_faults(recorded.necessary(fork.time), later)
    for entry in later:
        if entry.kind in dropped:
            continue
        if entry.kind == "configure" and changes.parameters:
            yield entry.time, partial(_configure, entry, changes, run)
        elif entry.kind == "clear" and entry.sequence in cleared:
            yield entry.time, partial(_clear, cleared[entry.sequence], run)
        else:
            yield entry.time, partial(_repeat, entry, run, strict=changes.empty)


def _apply(change: Change, run: Run) -> Iterator[Entry]:
    apply_change(run, change)
    yield from run.changes()


def _repeat(entry: JournalEntry, run: Run, *, strict: bool) -> Iterator[Entry]:
    refused = f"journal entry {entry.sequence} cannot be done"
    try:
        yield from repeat_change(run, entry)
    except FaultError as error:
        if strict:
            raise InspectionError(f"{refused}: {error}") from error
        raise
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise InspectionError(f"{refused}: {error!r:.100}") from error


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
