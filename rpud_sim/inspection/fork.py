"""Fork of a recorded run: it goes on from any instant, with the same or other changes, to a bag."""

from __future__ import annotations

import dataclasses
import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import rpud_sim.bag
from rpud_sim.bag import BagExistsError, BagFormatError, BagReader, BagWriter, QosProfile, Topic
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.losses import RECORD_NAME, Losses, losses_to_record
from rpud_sim.bag.manifest import RECORD_NAME as MANIFEST_RECORD
from rpud_sim.bag.manifest import (
    Manifest,
    installed_versions,
    machine_name,
    manifest_from_record,
)
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.recorded_changes import repeated
from rpud_sim.inspection.recorded_run import ForkError, RecordedRun, find_run
from rpud_sim.inspection.verify.installed_types import installed_codec
from rpud_sim.simulation.changes import Changes, apply_change, apply_parameters
from rpud_sim.simulation.configuration import PARAMETERS, Settings
from rpud_sim.simulation.fields import Bookkeeping, Fields
from rpud_sim.simulation.rerun import JournalError
from rpud_sim.simulation.resumption import Resumed, Start, resume
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.telemetry import Entry
from rpud_sim.simulation.topics import TOPICS

LIVE = ("autostart", "publish_clock", "start_paused", "thread_priority")
"""Parameters of a node that a live fork may have otherwise, for they change no bit."""

# A change of a run, at a time in nanoseconds; it yields messages.
Event = tuple[int, Callable[[], Iterable[Entry]]]


@dataclasses.dataclass(frozen=True)
class Fork:
    """Recorded run at the instant of a fork, and where it came from.

    Args:
        recorded: the run of the bag.
        time: instant, in simulation time [ns].
        resumed: the run in its state there.
        history: messages of the journal up to there, with the times at which they were published.
        origin: the manifest's ``forked_from``.
        scenario: text of the scenario, if the bag has it.
        warnings: one line each.
    """

    recorded: RecordedRun
    time: int
    resumed: Resumed
    history: tuple[tuple[int, Fields], ...]
    origin: Mapping[str, Any]
    scenario: str | None
    warnings: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class ForkedBag:
    """Bag of a fork.

    Args:
        path: of the bag.
        source: bag from which it forks.
        run: number of the run in it.
        at: instant of the fork, in simulation time of that run [s].
        duration: simulated from there on [s].
        messages: that were written, without those of the journal up to the instant.
        changed: whether anything differs from the recorded run.
        warnings: one line each.
    """

    path: str
    source: str
    run: int
    at: float
    duration: float
    messages: int
    changed: bool
    warnings: tuple[str, ...]


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
    """Run a recorded run again up to an instant.

    Args:
        path: of the bag.
        at: instant, in simulation time of the run [s].
        changes: of the fork, for its manifest.
        run: number of the run, from 1.
        topic: of the journal, if the bag holds several.
        stop: whether the run stops exactly at the instant.
        report: called with the seconds that were simulated since its last call.

    Raises:
        BagError: if the bag cannot be read.
        ForkError: if the bag cannot tell the state at that instant.
        EngineError: if the simulation cannot go on.
    """
    with rpud_sim.bag.open(path) as bag:
        recorded = find_run(bag, run, topic)
        scenario = _scenario(bag)
    time = round(at * SECOND)
    _check_instant(recorded, time, at)
    warnings = recorded.version_warnings()
    try:
        resumed = resume(recorded.necessary(time), time, stop=stop, report=report)
    except JournalError as error:
        raise ForkError(f"{recorded.journal}: {error}") from error
    history = tuple(
        (message.publish_time, recorded.fields(message)) for message, _ in recorded.history(time)
    )
    origin = {
        "bag": os.fspath(path),
        "run": run,
        "at": time / SECOND,
        "journal": recorded.digest(time),
        "changes": _to_json(changes),
    }
    return Fork(recorded, time, resumed, history, origin, scenario, tuple(warnings))


def write_fork(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    at: float,
    duration: float | None = None,
    changes: Changes | None = None,
    *,
    run: int = 1,
    topic: str | None = None,
    report: Callable[[float], object] = lambda seconds: None,
) -> ForkedBag:
    """Go on from an instant of a recorded run, and write a bag of it.

    The recorded changes after the instant are repeated, unless ``changes`` replaces them. Without
    changes the bag holds the messages of the recorded one after the instant, bit for bit. It begins
    with the journal up to the instant, so that it can be verified and forked itself.

    Args:
        path: of the recorded bag.
        out: folder of the new bag.
        at: instant, in simulation time of the run [s].
        duration: to simulate from there on [s]; None up to the end of the recorded run.
        changes: from the instant on; None for none.
        run: number of the run, from 1; resets and restored checkpoints begin new ones.
        topic: of the journal, if the bag holds several.
        report: called with the seconds that were simulated since its last call.

    Raises:
        BagError: if a bag cannot be read or written.
        ForkError: if the bag cannot tell the state at that instant, or what followed.
        ParameterError: if a change at the instant is refused.
        EngineError: if the simulation cannot go on.
    """
    changes = Changes() if changes is None else changes
    if os.path.lexists(out):
        raise BagExistsError(f"{os.fspath(out)} exists already; a bag is never overwritten")
    fork = open_fork(path, at, changes, run=run, topic=topic, stop=not changes.empty, report=report)
    continuation = Continuation(fork, changes, duration)
    first = list(continuation.begin())
    written = _write(out, fork, continuation, first, report)
    return ForkedBag(
        os.fspath(out),
        os.fspath(path),
        run,
        fork.time / SECOND,
        (continuation.end - fork.time) / SECOND,
        written,
        not changes.empty,
        (*fork.warnings, *continuation.warnings),
    )


class Continuation:
    """Messages of a fork, from its instant to its end.

    Args:
        fork: where it begins.
        changes: from there on.
        duration: to simulate [s]; None up to the end of the recorded run.

    Attributes:
        end: simulation time at which it ends [ns].
        warnings: refused changes, one line each.

    Raises:
        ForkError: if the journal does not tell what followed.
    """

    def __init__(self, fork: Fork, changes: Changes, duration: float | None) -> None:
        self.end = _end(fork, duration)
        self.warnings: list[str] = []
        self._fork = fork
        self._changes = changes
        self._run = fork.resumed.run
        # Without commands of its own the fork repeats what the watchdog did.
        self._watches = changes.replaces_commands

    def begin(self) -> Iterator[Entry]:
        """Apply the changes at the instant, and yield their messages and a status.

        Raises:
            ParameterError: if one of them is refused.
        """
        if not self._changes.empty:
            _begin_changes(self._run, self._fork.resumed.settings, self._changes)
            yield from self._run.changes()
        yield self._run.status("running", Bookkeeping())

    def messages(self, report: Callable[[float], object]) -> Iterator[Entry]:
        """Yield the messages after the instant."""
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
        """Let the watchdog act, as the node does between two blocks."""
        applied = self._run.simulation.applied
        if self._run.control.act() or self._run.simulation.applied is not applied:
            yield from self._run.changes()
            yield self._status()

    def _events(self) -> Iterator[Event]:
        fork, run = self._fork, self._run
        events = repeated(fork.recorded, fork.time, self.end, self._changes)
        for entry, repeat in events:
            yield (
                entry.time,
                lambda entry=entry, repeat=repeat: self._try(  # type: ignore[misc]
                    entry.time, lambda: repeat(run)
                ),
            )
        for planned in self._changes.planned:
            if planned.delay:
                time = fork.time + planned.delay
                yield (
                    time,
                    lambda time=time, planned=planned: self._try(  # type: ignore[misc]
                        time, lambda: self._apply(planned.change)
                    ),
                )

    def _apply(self, change: Any) -> Iterator[Entry]:
        apply_change(self._run, change)
        yield from self._run.changes()

    def _try(self, time: int, act: Callable[[], Iterable[Entry]]) -> Iterator[Entry]:
        """Act; a fork may refuse what the recorded run did not, as a node would."""
        try:
            yield from act()
        except ParameterError as error:
            self.warnings.append(f"refused at {time / SECOND:.9g} s: {error}")


def live_start(fork: Fork, changes: Changes) -> Start:
    """Return the start of a drill node in the state of a fork.

    Recorded changes after the instant are not repeated, for others command a node. Scheduled ends
    of faults and the rest of the scenario are part of the state.

    Args:
        fork: that stopped at its instant; its run is used up.
        changes: from there on.

    Raises:
        ParameterError: if a change at the instant is refused.
    """
    run = fork.resumed.run
    settings = _begin_changes(run, fork.resumed.settings, changes)
    entries = (*fork.resumed.entries, *run.changes())
    # The scenario is part of the state, and its file may be another one by now.
    fixed: dict[str, Any] = {"scenario": "", "autostart": True, **_of_node(changes.parameters)}
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


def _of_node(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name in LIVE}


def _begin_changes(run: Run, settings: Settings, changes: Changes) -> Settings:
    """Make the changes that come at the instant of the fork; return the settings in force."""
    run.control.adopt()
    settings = apply_parameters(run, settings, changes.parameters)
    for planned in changes.planned:
        if planned.delay == 0:
            apply_change(run, planned.change)
    return settings


def _check_instant(recorded: RecordedRun, time: int, at: float) -> None:
    start, end = recorded.start / SECOND, recorded.end / SECOND
    if recorded.start <= time <= recorded.end:
        return
    given = f"--at = {at:.9g} s"
    if time > recorded.end and recorded.torn:
        raise ForkError(
            f"{given}: the journal is complete up to {end:.9g} s alone: {recorded.torn}"
        )
    which = f"run {recorded.number} of {recorded.runs}" if recorded.runs > 1 else "the run"
    raise ForkError(f"{given} is outside {which} of the bag: [{start:.9g}, {end:.9g}] s")


def _end(fork: Fork, duration: float | None) -> int:
    recorded = fork.recorded
    end = recorded.end if duration is None else fork.time + round(duration * SECOND)
    if recorded.torn and (duration is None or end > recorded.end):
        raise ForkError(
            f"the journal is complete up to {recorded.end / SECOND:.9g} s alone: {recorded.torn}; "
            "give a --duration that ends before"
        )
    if end <= fork.time:
        raise ForkError(
            f"nothing is left of the recorded run after --at = {fork.time / SECOND:.9g} s: give "
            "--duration"
        )
    return end


def _write(
    out: str | os.PathLike[str],
    fork: Fork,
    continuation: Continuation,
    first: list[Entry],
    report: Callable[[float], object],
) -> int:
    """Write the bag; return the number of messages after the history."""
    prefix = fork.recorded.prefix
    codecs = {name: installed_codec(topic.type) for name, topic in TOPICS.items()}
    zero, published = _clock(fork)
    instant = zero + fork.time
    count = 0
    with BagWriter(out) as bag:
        bag.add_record(MANIFEST_RECORD, _manifest(fork).to_record())
        for name, topic in TOPICS.items():
            # The offers of the node's publishers, as a recorder discovers them.
            offer = QosProfile(durability="transient_local" if topic.latched else "volatile")
            bag.add_topic(
                Topic(f"{prefix}{name}", topic.type, find_type_hash(topic.type), (offer,)),
                find_definition(topic.type),
            )

        def write(name: str, fields: Fields, log_time: int, publish_time: int) -> None:
            bag.write(f"{prefix}{name}", codecs[name].encode(fields), log_time, publish_time)

        # As a recorder that begins at the instant would get the latched topics.
        for (_, fields), publish_time in zip(fork.history, published, strict=True):
            write("journal", fields, instant, publish_time)
        faults = fork.resumed.faults
        for _, name, fields in (*((faults,) if faults else ()), *fork.resumed.entries, *first):
            write(name, fields, instant, instant)
        between = fork.resumed.run.time < fork.time
        for time, name, fields in continuation.messages(report):
            if between and time <= fork.time:  # of the block in which the instant lies, before it
                continue
            write(name, fields, zero + time, zero + time)
            count += 1
        losses = {f"{prefix}{name}": Losses() for name in TOPICS}
        bag.add_record(RECORD_NAME, losses_to_record(losses))
    return count


def _clock(fork: Fork) -> tuple[int, list[int]]:
    """Return the bag's clock at simulation time zero, and when the history was published [ns].

    Publishing times show which run a message belongs to: with runs before, every entry is before
    all that follows.
    """
    zero = max(0, fork.resumed.run.origin)
    count = len(fork.history) if fork.recorded.before else 0
    zero += max(0, count - zero - fork.time)
    instant = zero + fork.time
    return zero, [
        min(publish_time, instant - max(0, count - place))
        for place, (publish_time, _) in enumerate(fork.history)
    ]


def _manifest(fork: Fork) -> Manifest:
    beginning = fork.resumed.run.beginning
    return Manifest(
        parameters={**fork.resumed.settings.values(), "seed": beginning.seed},
        scenario=fork.scenario,
        command=tuple(sys.argv),
        versions=installed_versions(),
        machine=machine_name(),
        forked_from=fork.origin,
    )


def _scenario(bag: BagReader) -> str | None:
    try:
        records = bag.records(MANIFEST_RECORD)
        return manifest_from_record(records[0]).scenario if records else None
    except BagFormatError:
        return None


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
