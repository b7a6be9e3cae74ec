"""Run of the drill: a plan that is carried out, and the messages that follow from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from rpud_sim.foundation.terminal import in_words
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.model.engine import EngineError
from rpud_sim.simulation.batch import Batch
from rpud_sim.simulation.block import Block, boundaries_until, boundary
from rpud_sim.simulation.changes import (
    Action,
    Change,
    ChangeError,
    Clear,
    Configure,
    Flush,
    Inject,
    Schedule,
    SetOrigin,
    Stop,
    journal_form,
)
from rpud_sim.simulation.commands import DriveChange
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.control import Control
from rpud_sim.simulation.fields import (
    CommandCounts,
    faults_fields,
    header_fields,
    journal_fields,
    prefixed,
    status_fields,
)
from rpud_sim.simulation.plan import Journal, Plan
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import RecentEnergy
from rpud_sim.simulation.telemetry import Stream, Telemetry
from rpud_sim.simulation.topics import Fields

_UNUSABLE = (ArithmeticError, LookupError, TypeError, ValueError)


class Run:
    """Run from simulation time zero on: simulation, control, telemetry, journal and origin.

    ``advance_to`` carries out the changes of the plan and yields the messages in batches. These are
    the same for the node, an offline bag and the proof of a bag, and do not depend on the number of
    calls. Times are integer nanoseconds of simulation time; the origin is the stamp of time zero.

    Args:
        journal: gets an entry for each change from outside; None for no journal.
        wanted: whether a topic that no fault can touch has had a subscriber; without one its
            messages are not made.
        active: whether commands act from the start; weight on bit and drive are zero otherwise.
        reports: whether there is a report at every second and after each change of the plan.
        on_block: called with each block, for statistics.
        refused: called with a change of the plan that is refused, and why; without it such a change
            raises a ChangeError.
    """

    def __init__(
        self,
        plan: Plan,
        journal: Journal | None = None,
        wanted: Callable[[str], bool] = lambda topic: True,
        *,
        active: bool = True,
        reports: bool = False,
        on_block: Callable[[Block], object] = lambda block: None,
        refused: Callable[[Change, Exception], object] | None = None,
    ) -> None:
        beginning = plan.beginning
        settings = beginning.settings
        self.beginning = beginning  # read-only
        self.settings = settings  # in force; read-only
        self._journal = journal
        self._reports = reports
        self._on_block = on_block
        self._refused = refused
        self._telemetry = Telemetry(settings, beginning.seed, wanted)
        self.simulation = Simulation(
            settings.configuration, beginning.initial_phase, beginning.faults, journal
        )
        # the commands, and the share of them that acts
        self.control = Control(
            self.simulation, settings.command_timeout, settings.command_loss_ramp, active
        )
        self._placed = False  # whether there is an origin
        self._watches = False
        self._schedule = Schedule(plan.changes)
        self._spans = 0
        self._recent_energy = RecentEnergy(settings.configuration.has_feed)
        self._published_faults: object = self.simulation.faults.active

    @property
    def time(self) -> int:
        return self.simulation.time

    @property
    def origin(self) -> int:
        """Stamp of simulation time zero [ns]."""
        return self._telemetry.origin

    @property
    def next_boundary(self) -> int:
        """Time at which the present block ends, unless a caller stops before it [ns]."""
        rate = self.beginning.settings.telemetry_rate
        return boundary(boundaries_until(self.time, rate) + 1, rate)

    @property
    def next_watch(self) -> int:
        """End of the block at which commands have to be watched again [ns], or ``NEVER``."""
        quiet, rate = self.control.quiet_until, self.beginning.settings.telemetry_rate
        if quiet == NEVER:
            return NEVER
        return max(self.next_boundary, boundary(boundaries_until(quiet, rate), rate))

    @property
    def next_change(self) -> int:
        """Time of the next change of the plan [ns]; ``NEVER`` if none is left."""
        return self._schedule.next

    def begin(self, origin: int) -> None:
        """Start the journal, let commands act, and give simulation time zero its stamp [ns]."""
        self.simulation.record("begin", self.beginning.to_journal())
        self.control.act()
        self.set_origin(origin)

    def schedule(self, *changes: Change) -> None:
        """Add changes to the plan, at the present time or later."""
        for change in changes:
            self._schedule.add(change)

    def watch(self) -> None:
        """Take the commands in force as given now; from now on their loss makes the drill safe."""
        self.control.adopt()
        self._watches = True

    def apply(self, action: Action) -> None:
        """Carry out an action now; a ParameterError changes nothing."""
        simulation = self.simulation
        if isinstance(action, Inject):
            simulation.inject(action.fault, action.duration)
        elif isinstance(action, Clear):
            simulation.clear(action.number, action.kind, action.channel)
        elif isinstance(action, Configure):
            self.configure(self.settings.replace(action.parameters))
        elif isinstance(action, SetOrigin):
            self.set_origin(action.origin)
        elif not isinstance(action, Stop | Flush):
            if isinstance(action, DriveChange):
                action = action.on(simulation.applied.drive)
            simulation.configuration.check(action)  # also where commands do not act now
            (self.control if self._watches else simulation).apply(action)

    def set_origin(self, origin: int) -> None:
        """Give simulation time zero a stamp [ns]; motion and commands go on."""
        self._telemetry.origin = origin
        self._placed = True
        self._published_faults = None
        self.simulation.record(*journal_form(SetOrigin(origin)))

    def configure(self, settings: Settings) -> None:
        """Put settings into force that differ only in changeable parameters."""
        self.settings = settings
        self.control.set(settings.command_timeout, settings.command_loss_ramp)
        self.simulation.configure(settings.configuration)

    def advance_to(
        self, time: int, defer: Callable[[Stream], object] | None = None
    ) -> Iterator[Batch]:
        """Advance to a time [ns], carry out the changes up to then, and yield the messages.

        Where nothing changes, a span of many blocks is computed together. Otherwise impacts and the
        samples at the end of a block come first, waveform and trajectory last. With ``defer`` these
        two are not yielded: the caller makes and publishes each stream when it has time.
        """
        while True:
            yield from self._carry_out_due()
            if self.time >= time:
                return
            until = min(time, self._schedule.next)
            if self._watches:
                until = min(until, self.next_watch)
            if self._reports:
                until = min(until, (self.time // SECOND + 1) * SECOND)
            while self.time < until:
                yield from self._advance(until, defer)
            if self._reports and self.time % SECOND == 0:
                yield from self.reports()
            if self._watches:
                yield from self._watch()

    def changes(self) -> Iterator[Batch]:
        """Yield what changed since the last message: journal entries, and the faults once."""
        yield from self.entries()
        yield from self._changed_faults()

    def flush(self, *, ends: bool = False) -> Iterator[Batch]:
        """Yield an entry of the journal, and the rest of waveform and trajectory."""
        self.simulation.record(*journal_form(Flush(ends)))
        yield from self.changes()
        yield from _made(self._telemetry.take_pending())

    def reports(self, state: str = "running") -> list[Batch]:
        """Return the messages of a report: power, and a status with a STATE."""
        return [self.power(), self.status(state)]

    def power(self) -> Batch:
        header = header_fields("power", self.origin + self.time)
        fields = {"header": header, **self._recent_energy.powers()}
        return self._batch(self.time, "power", fields)

    def status(self, state: str = "running", counts: CommandCounts | None = None) -> Batch:
        fields = {
            **status_fields(self.simulation, self.origin, state, counts or CommandCounts()),
            "commands_lost": self.control.commands_lost,
            "journal_entries": self._journal.count if self._journal is not None else 0,
        }
        return self._batch(self.time, "status", fields)

    def entries(self) -> Iterator[Batch]:
        """Yield the journal's entries since the last call."""
        for entry in self._journal.drain() if self._journal is not None else ():
            yield self._batch(entry.time, "journal", journal_fields(entry, self.origin))

    def _advance(self, until: int, defer: Callable[[Stream], object] | None) -> Iterator[Batch]:
        """Advance by a block, or by a span of many, not beyond a time [ns]."""
        simulation, telemetry = self.simulation, self._telemetry
        span = 0
        # Deferred streams are made in parts, between deadlines.
        if defer is None and len(ends := self._undisturbed_ends(until)):
            block = simulation.advance_through(ends)
            self._spans += 1
            span = self._spans
        else:
            end = self.next_boundary
            block = simulation.advance_to(min(end, until))
            if block.end < end:
                simulation.record(*journal_form(Stop()))
                yield from self.entries()
        self._recent_energy.add(block)
        yield from telemetry.batches(block, simulation.faults.since(block.start), span)
        yield from self._changed_faults()
        stream = telemetry.streams(block, span)
        if defer is None:
            yield from _made(stream)
        elif stream is not None:
            defer(stream)
        self._on_block(block)

    def _undisturbed_ends(self, time: int) -> np.ndarray:
        """Return the ends of the blocks that make a span, not beyond a time [ns]; maybe none."""
        now = self.time
        until = min(time, self.simulation.next_scheduled - 1)
        faults = self.simulation.faults
        if faults.active is not self._published_faults or any(
            record.fault.channel for record in faults.since(now)
        ):
            return np.empty(0, np.int64)
        return self._telemetry.span_ends(now, until)

    def _carry_out_due(self) -> Iterator[Batch]:
        yield from self._settled()
        shown = self._shown()
        for change in self._schedule.due(self.time):
            try:
                self.apply(change.action)
            except EngineError:
                raise
            except _UNUSABLE as error:
                self._refuse(change, error)
            if isinstance(change.action, Flush):
                yield from self.flush(ends=change.action.ends)
            else:
                yield from self._settled()
        if self._reports and self._shown() != shown:
            yield from self.reports()

    def _settled(self) -> Iterator[Batch]:
        """Yield what changed, unless its stamps follow from an origin that is still due."""
        if self._placed or self.next_change > self.time:
            yield from self.changes()

    def _refuse(self, change: Change, error: Exception) -> None:
        if self._refused is not None:
            self._refused(change, error)
            return
        raise ChangeError(f"{change.place}{in_words(error)}") from error

    def _shown(self) -> tuple[Any, ...]:
        """Return what a status follows if it changes."""
        simulation = self.simulation
        return simulation.applied, simulation.configuration, simulation.faults.active

    def _watch(self) -> Iterator[Batch]:
        applied = self.simulation.applied
        if self.control.act() or self.simulation.applied is not applied:
            yield from self.changes()
            if self._reports:
                yield from self.reports()

    def _changed_faults(self) -> Iterator[Batch]:
        faults = self.simulation.faults
        if faults.active is not self._published_faults:
            self._published_faults = faults.active
            fields = faults_fields(faults, self.time, self.origin)
            yield self._batch(self.time, "faults", fields)

    def _batch(self, time: int, topic: str, fields: Fields) -> Batch:
        return Batch.of(time, topic, prefixed(fields, self.settings.frame_prefix))


def _made(stream: Stream | None) -> Iterator[Batch]:
    return (batch for batch in stream or () if batch is not None)
