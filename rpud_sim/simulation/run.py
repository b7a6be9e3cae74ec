"""Run of the drill: a plan that is carried out, and the messages that follow from it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from rpud_sim.foundation.terminal import error_text
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.messages.batch import Batch, Fields
from rpud_sim.model.engine import Buffers, EngineError
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
    injected,
    journal_form,
)
from rpud_sim.simulation.commands import Command, Drive, DriveChange, MountMotion
from rpud_sim.simulation.configuration import Settings, to_values
from rpud_sim.simulation.control import Control
from rpud_sim.simulation.faults import check_supported
from rpud_sim.simulation.fields import (
    CommandCounts,
    faults_fields,
    header_fields,
    journal_fields,
    prefixed,
    status_fields,
)
from rpud_sim.simulation.metrics import RecentEnergy
from rpud_sim.simulation.plan import Journal, Plan
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.telemetry import Stream, Telemetry

_UNUSABLE = (ArithmeticError, LookupError, TypeError, ValueError)
# Length of a block of a run without messages [ns]: a cache holds the motion of so much.
SILENT_BLOCK = 2 * SECOND


class Run:
    """Run from simulation time zero on, the one door of a drill.

    ``apply`` is the only way in, ``advance_to`` the only way out: it carries out the changes that
    are due and yields the messages in batches. These are the same for the node, an offline bag and
    the verification of a bag, and do not depend on the number of calls. Times are integer
    nanoseconds of simulation time; the origin is the stamp of time zero.

    Args:
        journal: gets an entry for each change from outside; None for no journal.
        wanted: whether a topic that no fault can touch has had a subscriber; without one its
            messages are not made. None for a run without messages.
        active: whether commands act from the start; weight on bit and drive are zero otherwise.
        reports: whether there is a report at every second and after each scheduled change.
        on_block: called with each block, for metrics.
        rejected: called with a scheduled change that is rejected, and why; without it the
            ChangeError is raised.
        buffers: of the engine, shared with other runs: a block is valid until the next one.
    """

    def __init__(
        self,
        plan: Plan,
        journal: Journal | None = None,
        wanted: Callable[[str], bool] | None = lambda topic: True,
        *,
        active: bool = True,
        reports: bool = False,
        on_block: Callable[[Block], object] = lambda block: None,
        rejected: Callable[[Change, ChangeError], object] | None = None,
        buffers: Buffers | None = None,
    ) -> None:
        beginning = plan.beginning
        settings = beginning.settings
        self.beginning = beginning  # read-only
        self.settings = settings  # active; read-only
        self._journal = journal
        self._reports = reports
        self._on_block = on_block
        self._rejected = rejected
        self._silent = wanted is None
        self._wanted = wanted or (lambda topic: False)
        self._telemetry = Telemetry(settings, beginning.seed, self._wanted)
        self._simulation = Simulation(settings.configuration, beginning.initial_phase, buffers)
        self._control = Control(self._simulation, self._put, settings, active)
        self._watches = False  # whether commands may be lost: from ``take_over`` on
        self._recorded, self._live_from = plan.recorded, plan.live_from
        self._placed = False  # whether there is an origin
        self._schedule = Schedule(plan.changes)
        # Faults that begin and end by themselves: they cut no block and have no entry.
        self._own = Schedule(beginning.faults)
        for change, fault in injected(beginning.faults):
            with _placed_errors(change.place):
                check_supported(fault, settings.configuration)
        self._groups = 0
        self._recent_energy = RecentEnergy(settings.configuration.has_feed)
        self._published_faults: object = self._simulation.faults.active

    @property
    def simulation(self) -> Simulation:
        """The drill, to be read."""
        return self._simulation

    @property
    def time(self) -> int:
        return self._simulation.time

    @property
    def origin(self) -> int:
        """Stamp of simulation time zero [ns]."""
        return self._telemetry.origin

    @property
    def active(self) -> bool:
        """Whether commands act."""
        return self._control.active

    @property
    def commands_lost(self) -> bool:
        """Whether commands stopped arriving, so that the watchdog makes the drill safe."""
        return self._control.commands_lost

    @property
    def next_boundary(self) -> int:
        """Time at which the current block ends, unless a caller stops before it [ns]."""
        rate = self.beginning.settings.telemetry_rate
        return boundary(boundaries_until(self.time, rate) + 1, rate)

    @property
    def next_action_time(self) -> int:
        """Time from which ``watch`` changes something without a command [ns], or ``NEVER``."""
        return self._control.next_action_time if self._watches else NEVER

    @property
    def next_watch(self) -> int:
        """End of the block at which commands have to be watched again [ns], or ``NEVER``."""
        if (due := self.next_action_time) == NEVER:
            return NEVER
        rate = self.beginning.settings.telemetry_rate
        return max(self.next_boundary, boundary(boundaries_until(due, rate), rate))

    @property
    def next_change(self) -> int:
        """Time of the next scheduled change [ns]; ``NEVER`` if none is left."""
        return self._schedule.next

    def begin(self, origin: int | None = None) -> None:
        """Start the journal, let commands act, and give time zero its stamp [ns], now or later."""
        content = self.beginning.to_journal()
        if self._live_from:
            content["live_from"] = self._live_from  # messages up to there were not published
        self._record("begin", content)
        self._control.apply_share()
        if origin is not None:
            self.apply(SetOrigin(origin))

    def schedule(self, *changes: Change) -> None:
        """Add changes at the current time or later."""
        for change in changes:
            self._schedule.add(change)

    def take_over(self) -> None:
        """Take the commands active as given now; from now on their loss makes the drill safe."""
        self._control.take_over()
        self._watches = True

    def activate(self, active: bool) -> None:
        """Let commands act, or make drive and weight on bit zero."""
        self._control.activate(active)

    def apply(self, action: Action, place: str = "") -> tuple[int, ...]:
        """Carry out an action now; return the numbers of the faults that begin or end.

        An action that cannot be carried out raises a ChangeError, whose text begins with
        ``place``, and changes nothing.
        """
        with _placed_errors(place):
            if isinstance(action, Inject):
                number = self._inject(action)
                self._record(*journal_form(action))
                return (number,)
            if isinstance(action, Clear):
                active = [record.number for record in self._simulation.faults.active]
                self._record(*journal_form(self._simulation.clear(action)))
                left = {record.number for record in self._simulation.faults.active}
                return tuple(number for number in active if number not in left)
            if isinstance(action, Configure):
                self._configure(self.settings.replace(action.parameters))
            elif isinstance(action, SetOrigin):
                self._telemetry.origin = action.origin
                self._placed = True
                self._published_faults = None
                self._record(*journal_form(action))
            elif not isinstance(action, Stop | Flush):
                self._command(action)
        return ()

    def watch(self) -> bool:
        """Apply the share of the commands that acts now; return whether it changes."""
        applied = self._simulation.applied
        return self._control.apply_share() or self._simulation.applied is not applied

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
            if self.next_action_time <= self.time and self.watch():
                yield from self.changes()
                if self._reports:
                    yield from self.reports()
            until = min(time, self._schedule.next, self.next_watch)
            if self._reports:
                until = min(until, (self.time // SECOND + 1) * SECOND)
            while self.time < until:
                yield from self._advance(until, defer)
            if self._reports and self.time % SECOND == 0:
                yield from self.reports()

    def finish(self, time: int) -> None:
        """Advance to a time [ns], and discard the messages."""
        for _ in self.advance_to(time):
            pass

    def changes(self) -> Iterator[Batch]:
        """Yield what changed since the last message: journal entries, and the faults once."""
        if self._silent:
            return
        yield from self.entries()
        yield from self._changed_faults()

    def flush(self, *, ends: bool = False) -> Iterator[Batch]:
        """Yield an entry of the journal, and the rest of waveform and trajectory."""
        self._record(*journal_form(Flush(ends)))
        yield from self.changes()
        yield from _made(self._telemetry.take_pending())

    def reports(self, state: str = "running") -> list[Batch]:
        """Return the messages of a report: power if it is wanted, and a status with a STATE."""
        return [*([self.power()] if self._wanted("power") else []), self.status(state)]

    def power(self) -> Batch:
        header = header_fields("power", self.origin + self.time)
        fields = {"header": header, **self._recent_energy.powers()}
        return self._batch(self.time, "power", fields)

    def status(self, state: str = "running", counts: CommandCounts | None = None) -> Batch:
        fields = {
            **status_fields(self._simulation, self.origin, state, counts or CommandCounts()),
            "commands_lost": self.commands_lost,
            "journal_entries": self._journal.count if self._journal is not None else 0,
        }
        return self._batch(self.time, "status", fields)

    def entries(self) -> Iterator[Batch]:
        """Yield the journal's entries since the last call."""
        for entry in self._journal.drain() if self._journal is not None else ():
            yield self._batch(entry.time, "journal", journal_fields(entry, self.origin))

    def _advance(self, until: int, defer: Callable[[Stream], object] | None) -> Iterator[Batch]:
        """Advance by a block, or by a span of many, not beyond a time [ns]."""
        simulation, telemetry = self._simulation, self._telemetry
        if self._silent:
            self._on_block(self._block_to(min(until, self.time + SILENT_BLOCK)))
            return
        group = 0
        # Deferred streams are made in parts, between deadlines.
        if defer is None and len(ends := self._undisturbed_ends(until)):
            block = simulation.advance_through(ends)
            self._groups += 1
            group = self._groups
        else:
            end = self.next_boundary
            block = self._block_to(min(end, until))
            if block.end < end:
                self._record(*journal_form(Stop()))
                yield from self.entries()
        self._recent_energy.add(block)
        yield from telemetry.batches(block, simulation.faults.since(block.start), group)
        yield from self._changed_faults()
        stream = telemetry.streams(block, group)
        if defer is None:
            yield from _made(stream)
        elif stream is not None:
            defer(stream)
        self._on_block(block)

    def _block_to(self, end: int) -> Block:
        """Advance to a time [ns], with the faults that begin and end by themselves until then."""
        while (time := self._own.next) <= end:
            self._simulation.move_to(time)
            for change in self._own.due(time):
                self._carry_out_own(change)
        return self._simulation.advance_to(end)

    def _carry_out_own(self, change: Change) -> None:
        action = change.action
        if isinstance(action, Clear):
            if any(record.number == action.number for record in self._simulation.faults.active):
                self._simulation.clear(action)
            return
        assert isinstance(action, Inject)
        try:
            with _placed_errors(change.place):
                self._inject(action)
        except ChangeError as error:
            if self._watches or not self._recorded:  # what was recorded rejected it, too
                self._reject(change, error)

    def _undisturbed_ends(self, time: int) -> np.ndarray:
        """Return the ends of the blocks that make a span, not beyond a time [ns]; maybe none."""
        now = self.time
        until = min(time, self._own.next - 1)
        faults = self._simulation.faults
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
                self.apply(change.action, change.place)
            except ChangeError as error:
                self._reject(change, error)
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

    def _reject(self, change: Change, error: ChangeError) -> None:
        if self._rejected is None:
            raise error
        self._rejected(change, error)

    def _inject(self, action: Inject) -> int:
        number = self._simulation.inject(action.fault)
        if action.duration:
            self._own.add(Change(self.time + action.duration, Clear(number)), first=True)
        return number

    def _configure(self, settings: Settings) -> None:
        """Apply settings that differ only in changeable parameters."""
        before, values = (to_values(each.configuration) for each in (self.settings, settings))
        changed = {name: value for name, value in values.items() if value != before[name]}
        self.settings = settings
        self._control.configure(settings)
        self._simulation.configure(settings.configuration)
        self._record("configure", {"parameters": changed})

    def _command(self, command: Command | DriveChange) -> None:
        applied = self._control.given if self._watches else self._simulation.applied
        if isinstance(command, DriveChange):
            command = command.on(applied.drive)
        elif isinstance(command, MountMotion):
            command = command.acting(self.time)
        # Also where commands do not act now.
        after = command.after(applied.drive) if isinstance(command, Drive) else command
        self._simulation.check(after)
        if self._watches:
            self._control.apply(command)
        else:
            self._put(command)

    def _put(self, command: Command) -> None:
        """Apply a command, with an entry in the journal if that changes anything."""
        if isinstance(command, MountMotion):
            command = command.acting(self.time)
        if self._simulation.apply(command):
            self._record(*journal_form(command))

    def _record(self, kind: str, content: Mapping[str, Any]) -> None:
        if self._journal is not None:
            self._journal.record(self.time, kind, content)

    def _shown(self) -> tuple[Any, ...]:
        """Return what a status follows if it changes."""
        simulation = self._simulation
        return simulation.applied, simulation.configuration, simulation.faults.active

    def _changed_faults(self) -> Iterator[Batch]:
        faults = self._simulation.faults
        if faults.active is not self._published_faults:
            self._published_faults = faults.active
            fields = faults_fields(faults, self.time, self.origin)
            yield self._batch(self.time, "faults", fields)

    def _batch(self, time: int, topic: str, fields: Fields) -> Batch:
        return Batch.of(time, topic, prefixed(fields, self.settings.frame_prefix))


@contextlib.contextmanager
def _placed_errors(place: str) -> Iterator[None]:
    """Raise a ChangeError that begins with a place for a change that cannot be carried out."""
    try:
        yield
    except EngineError:
        raise
    except _UNUSABLE as error:
        raise ChangeError(f"{place}{error_text(error)}") from error


def _made(stream: Stream | None) -> Iterator[Batch]:
    return (batch for batch in stream or () if batch is not None)
