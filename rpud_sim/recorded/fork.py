"""Forks: a recorded plan with other changes from an instant on, as a bag or as a live drill."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from rpud_sim.bag import BagExistsError
from rpud_sim.bag.received_order import open_received
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.batch import Batch, rows_of
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.offline_bag import drill_bag, kept_topics, new_manifest, reported
from rpud_sim.recorded.runs import RecordedRun, run_of
from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.changes import (
    Change,
    ChangeError,
    Configure,
    Flush,
    PlannedChanges,
    in_order,
    journal_form,
)
from rpud_sim.simulation.commands import COMMAND_NAMES
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.plan import Journal, Plan
from rpud_sim.simulation.run import Run

# Parameters of a node that a live fork may have otherwise, for they change no bit.
LIVE = ("autostart", "publish_clock", "start_paused", "thread_priority")

COMMAND_KINDS = tuple(COMMAND_NAMES.values())  # of the journal's entries


@dataclass(frozen=True)
class ForkedBag:
    """Bag of a fork."""

    path: str  # of the bag
    source: str  # bag from which it forks
    run: int  # number of the run in it
    at: float  # start of the fork, in simulation time of that run [s]
    duration: float  # simulated from there on [s]
    messages: int  # written, without the journal's entries up to the instant
    changed: bool  # whether anything differs from the recorded run
    warnings: tuple[str, ...]  # one line each


class Fork:
    """Recorded run, an instant of it in simulation time of the run [s], and what differs then.

    Runs count from 1; ``topic`` chooses one of several journals.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        at: float,
        changes: PlannedChanges,
        run: int = 1,
        topic: str | None = None,
    ) -> None:
        with open_received(path) as bag:
            self.recorded = run_of(bag, run, topic)
        self.time = round(at * SECOND)  # the instant [ns]
        self._changes = changes
        _check_instant(self.recorded, self.time)
        plan = self.recorded.plan
        # A run that continues after its recorded end has not ended there.
        self._before = tuple(
            replace(change, action=Flush()) if isinstance(change.action, Flush) else change
            for change in plan.changes
            if change.time <= self.time
        )
        self._own = tuple(replace(each, time=self.time + each.time) for each in changes.changes)

    @property
    def scenario(self) -> str | None:
        """Text of the scenario, if the bag has it."""
        manifest = self.recorded.manifest
        return manifest.scenario if manifest else None

    @property
    def origin(self) -> dict[str, Any]:
        """Content of the manifest's ``forked_from``."""
        entries = (each.entry for each in self.recorded.entries if each.entry.time <= self.time)
        text = "".join(f"{entry.sequence} {entry.kind} {entry.text}\n" for entry in entries)
        return {
            "bag": self.recorded.path,
            "run": self.recorded.number,
            "at": self.time / SECOND,
            "journal": hashlib.sha256(text.encode()).hexdigest(),
            "changes": {
                "parameters": self._changes.parameters,
                "replaces_commands": self._changes.replaces_commands,
                "planned": [_to_json(change) for change in self._changes.changes],
            },
        }

    def live(self) -> tuple[Plan, Settings]:
        """Return the plan of a drill node that continues live at the instant, and its settings.

        Recorded changes after it are not repeated, for others command a node. The ends of recorded
        faults, and the rest of the scenario, come by themselves.
        """
        beginning = self.recorded.plan.beginning
        own = tuple(filter(None, (_without(change, LIVE) for change in self._own)))
        changes = (*self._before, *own)
        settings = beginning.settings
        for change in changes:
            if isinstance(change.action, Configure) and change.time <= self.time:
                settings = settings.replace(change.action.parameters)
        # The scenario is part of the beginning, and its file may be another one by now.
        of_node = {n: v for n, v in self._changes.parameters.items() if n in LIVE}
        fixed: dict[str, Any] = {"scenario": "", "autostart": True, **of_node}
        plan = Plan(beginning, changes, recorded=True, live_from=self.time)
        return plan, settings.replace(fixed)

    def end(self, duration: float | None) -> int:
        """Return the simulation time at which it ends [ns]; without a duration, as recorded."""
        recorded, time = self.recorded, self.time
        end = recorded.end if duration is None else time + round(duration * SECOND)
        if why := recorded.lacks(None if duration is None else end):
            raise RecordingError(f"{why}; give a --duration that ends before")
        if end <= time:
            at = f"at = {time / SECOND:.9g} s"
            raise RecordingError(f"nothing is left of the recorded run after {at}: give --duration")
        return end

    def after(self, end: int) -> tuple[Change, ...]:
        """Return the changes from the instant on: the fork's own, and those that it repeats.

        What the fork sets by itself is not taken back: recorded changes of these parameters are
        left out, and recorded commands where it has its own.
        """
        changes, recorded = self._changes, self.recorded.plan.changes
        own = {_kind(change) for change in self._own} & {*COMMAND_KINDS}
        dropped = COMMAND_KINDS if changes.replaces_commands else own
        later = [
            _without(change, tuple(changes.parameters))
            for change in recorded[: len(recorded) - self.recorded.closed]
            if self.time < change.time <= end and _kind(change) not in dropped
        ]
        return in_order((*self._own, *filter(None, later)))

    @property
    def reach(self) -> int:
        """Simulation time up to which it is the recorded run [ns]: the instant, if it differs then.

        Otherwise no block is cut there.
        """
        if not self._changes.empty:
            return self.time
        rate = self.recorded.plan.beginning.settings.telemetry_rate
        last = boundary(boundaries_until(self.time, rate), rate)
        return max([last, *(change.time for change in self._before)])

    def run(self, warnings: list[str]) -> Run:
        """Return the recorded run up to the instant, not computed yet; rejections are warnings."""

        def reject(change: Change, error: ChangeError) -> None:
            if change.time == self.time and any(change is each for each in self._own):
                raise error
            if change.time <= self.time or self._changes.empty:
                raise RecordingError(f"{self.recorded.journal}: {error}") from error
            warnings.append(f"rejected at {change.time / SECOND:.9g} s: {error}")

        plan = replace(self.recorded.plan, changes=self._before)
        first = self.recorded.entries[0].entry
        run = Run(plan, Journal(first.sequence), reports=True, rejected=reject)
        run.begin()
        return run

    def go_on(self, run: Run, end: int) -> Iterator[Batch]:
        """Plan how it continues up to a simulation time [ns]; yield the messages at the instant."""
        if self._changes.replaces_commands:
            run.take_over()
        run.schedule(*self.after(end))
        found = [*run.advance_to(run.time)]
        yield from found
        if not any(batch.topic == "status" for batch in found):
            yield from run.reports()


def write_fork(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    at: float,
    duration: float | None = None,
    changes: PlannedChanges | None = None,
    *,
    run: int = 1,
    topic: str | None = None,
    report: Callable[[float], object] = lambda seconds: None,
) -> ForkedBag:
    """Continue from an instant of a recorded run, and write a bag of it.

    The recorded changes after the instant are repeated, unless ``changes`` replaces them. Without
    changes the bag holds the messages of the recorded one after the instant, bit for bit. It begins
    with the journal up to the instant, so that it can be verified and forked itself.

    Args:
        at: instant, in simulation time of the run [s].
        duration: to simulate from there on [s]; None up to the end of the recorded run.
        changes: from the instant on; None for none.
        run: number of the run, from 1; resets begin new ones.
        topic: of the journal, if the bag holds several.
    """
    changes = PlannedChanges() if changes is None else changes
    if os.path.lexists(out):
        raise BagExistsError(f"{os.fspath(out)} exists already; a bag is never overwritten")
    fork = Fork(path, at, changes, run, topic)
    end, warnings = fork.end(duration), list[str]()
    forked = fork.run(warnings)
    kept: list[Batch] = []
    faults: list[Batch] = []
    for batch in reported(forked, fork.reach, report):
        kept += [batch] if batch.topic == "journal" else []
        faults = [batch] if batch.topic == "faults" else faults
    values = forked.settings.values()
    manifest = new_manifest(values, fork.scenario, fork.origin)
    zero = max(0, forked.origin)
    instant = zero + fork.time
    with drill_bag(out, fork.recorded.prefix, kept_topics(values), manifest) as writer:
        # As a recorder that begins at the instant would get the latched topics.
        writer.write(kept, zero, received=instant)
        writer.write((*faults, *fork.go_on(forked, end)), zero, received=instant)
        before = writer.count
        # Without the messages of the block in which the instant lies, before it.
        if forked.time < fork.time:
            until = min(forked.next_boundary, end)
            writer.write(_later(reported(forked, until, report), fork.time), zero)
        writer.write(reported(forked, end, report), zero)
        writer.write(forked.flush(ends=True), zero)
        writer.write(forked.reports("stopped"), zero)
        count = writer.count - before
    return ForkedBag(
        os.fspath(out),
        os.fspath(path),
        run,
        fork.time / SECOND,
        (end - fork.time) / SECOND,
        count,
        not changes.empty,
        tuple(warnings),
    )


def _later(batches: Iterable[Batch], time: int) -> Iterator[Batch]:
    for row in rows_of(batches):
        if row[0] > time:
            yield Batch.of(*row)


def _kind(change: Change) -> str:
    return journal_form(change.action)[0]


def _without(change: Change, names: Collection[str]) -> Change | None:
    """Return a change without some parameters; None if it has no other."""
    if not isinstance(change.action, Configure):
        return change
    given = change.action.parameters
    kept = {n: v for n, v in given.items() if n not in names}
    return replace(change, action=Configure(kept)) if kept or not given else None


def _to_json(change: Change) -> dict[str, Any]:
    kind, content = journal_form(change.action)
    return {"delay": change.time / SECOND, "kind": kind, **content}


def _check_instant(recorded: RecordedRun, time: int) -> None:
    if 0 <= time <= recorded.end:
        return
    end, at = recorded.end / SECOND, time / SECOND
    if why := recorded.lacks(time):
        raise RecordingError(f"at = {at:.9g} s: {why}")
    which = f"run {recorded.number} of {recorded.runs} of the bag"
    raise RecordingError(f"at = {at:.9g} s is outside {which}: [0, {end:.9g}] s", code=2)
