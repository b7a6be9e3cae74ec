"""Run of the drill: the simulation, the share of the commands that acts, and its messages."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from rpud_sim.simulation.block import Block, boundaries_until, boundary
from rpud_sim.simulation.commands import Control
from rpud_sim.simulation.configuration import Settings, to_settings, to_values
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.fields import Bookkeeping, faults_fields, journal_fields, status_fields
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.plans import Scenario, ScheduledFault
from rpud_sim.simulation.scenario_file import scenario_of
from rpud_sim.simulation.simulation import Simulation, initial_phases
from rpud_sim.simulation.state import write_state
from rpud_sim.simulation.statistics import RecentEnergy
from rpud_sim.simulation.telemetry import Entry, Stream, Telemetry, Together, messages_of
from rpud_sim.simulation.versions import ENGINE, engine_versions


@dataclasses.dataclass(frozen=True)
class Beginning:
    """Beginning of a run; equal beginnings give the same bits."""

    settings: Settings  # all parameters
    initial_phase: float = 0.0  # phase of the vibration at time zero [cycles]
    seed: int = 0  # of random numbers of faulty signals
    # faults that begin by themselves, with all values drawn; None for none
    scenario: Scenario | None = None

    @staticmethod
    def drawn(settings: Settings, seed: int | None = None) -> Beginning:
        """Return the beginning that a seed draws; None for the seed of the settings."""
        seed = settings.seed if seed is None else seed
        [phase] = initial_phases(1, seed or None)
        return Beginning(settings, phase, seed, scenario_of(settings, seed))

    def to_journal(self) -> dict[str, Any]:
        """Return the content of a journal's entry ``begin``."""
        return {
            "parameters": self.settings.values(),
            "initial_phase": self.initial_phase,
            "seed": self.seed,
            "faults": [
                {**vars(planned.fault), "onset": planned.onset, "clear": planned.clear}
                for planned in (self.scenario.faults if self.scenario else ())
            ],
            "engine": ENGINE,
            "made_by": engine_versions(),
        }

    @staticmethod
    def from_journal(content: Mapping[str, Any]) -> Beginning:
        """Return the beginning of a journal's entry ``begin``, the inverse of ``to_journal``.

        Raises:
            ArithmeticError, LookupError, TypeError, ValueError: if the content is unusable.
        """
        faults = [
            ScheduledFault(
                planned["onset"],
                planned["clear"],
                Fault(planned["kind"], planned["channel"], planned["magnitude"]),
            )
            for planned in content["faults"]
        ]
        seed = content["seed"]
        settings = to_settings(content["parameters"])
        phase = float(content["initial_phase"])
        return Beginning(settings, phase, seed, Scenario(seed, tuple(faults)))


class Run:
    """Run from simulation time zero on: simulation, control, telemetry, journal and origin.

    ``advance_to`` yields the messages as ``(time, topic, fields)``. They are the same for the node,
    an offline bag and the proof of a bag, and do not depend on the number of calls. Times are
    integer nanoseconds of simulation time; the origin is the stamp of time zero.

    Args:
        journal: gets an entry for each change from outside; None for no journal.
        wanted: whether a topic that no fault can touch has had a subscriber; without one its
            messages are not made.
        active: whether commands act from the start; weight on bit and drive are zero otherwise.
        on_block: called with each block, for statistics.
    """

    def __init__(
        self,
        beginning: Beginning,
        journal: Journal | None = None,
        wanted: Callable[[str], bool] = lambda topic: True,
        active: bool = True,
        on_block: Callable[[Block], object] = lambda block: None,
    ) -> None:
        settings = beginning.settings
        self.beginning = beginning  # read-only
        self._journal = journal
        self._wanted = wanted
        self._on_block = on_block
        self._telemetry = Telemetry(settings, beginning.seed, wanted)
        self.simulation = Simulation(
            settings.configuration, beginning.initial_phase, beginning.scenario, journal
        )
        # the commands, and the share of them that acts
        self.control = Control(
            self.simulation, settings.command_timeout, settings.command_loss_ramp, active
        )
        self._recent_energy = RecentEnergy(settings.configuration.has_feed)
        # power that the steps of the arm lost in the second before the last status [W]; NaN
        # without a feed
        self.coupling_power = math.nan
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

    def begin(self, origin: int) -> None:
        """Start the journal, let commands act, and give simulation time zero its stamp [ns]."""
        self.note("begin", **self.beginning.to_journal())
        self.control.act()
        self.place(origin)

    def copy(
        self,
        journal: Journal | None = None,
        wanted: Callable[[str], bool] | None = None,
        on_block: Callable[[Block], object] | None = None,
    ) -> Run:
        """Return a run in the same state, with other arguments of ``Run`` where given."""
        own = (self.beginning, self._journal, self._wanted, self._on_block)
        others = (None, journal, wanted, on_block)
        pairs: Iterable[tuple[Any, Any]] = zip(own, others, strict=True)
        return copy.deepcopy(self, {id(one): other or one for one, other in pairs if one})

    def note_state(self, *, due: bool = False) -> None:
        """Append the state to the journal, so that a reader can begin there; ``due`` if it is time.

        Nothing may be under way: the entries before it have acted, and those after it have not.
        """
        if self._journal is not None and (self._journal.state_due or not due):
            self.note("state", beginning=self.beginning.to_journal(), state=self.state())

    def state(self) -> dict[str, Any]:
        """Return the state between two blocks, as values for JSON."""
        begun = to_values(self.beginning.settings.configuration)
        now = to_values(self.simulation.configuration)
        return {
            "parameters": {name: value for name, value in now.items() if value != begun[name]},
            "faults_published": self.faults_published,
            "run": write_state(self),
        }

    @property
    def faults_published(self) -> bool:
        return self._published_faults is self.simulation.faults.active

    @faults_published.setter
    def faults_published(self, published: bool) -> None:
        self._published_faults = self.simulation.faults.active if published else None

    def begin_streams(self) -> None:
        """Let waveform and trajectory begin here; what is pending of them is not published."""
        self._telemetry.drop_pending()

    def place(self, origin: int) -> None:
        """Give simulation time zero a stamp [ns]; motion and commands go on."""
        self._telemetry.origin = origin
        self._published_faults = None
        self.note("origin", origin=origin)

    def configure(self, settings: Settings) -> None:
        """Put settings into force that differ only in changeable parameters."""
        self.control.set(settings.command_timeout, settings.command_loss_ramp)
        self.simulation.configure(settings.configuration)

    def advance_to(
        self, time: int, defer: Callable[[Stream], object] | None = None
    ) -> Iterator[Entry]:
        """Advance to a time [ns], block by block, and yield the messages.

        Impacts and the samples at the end of a block come first, waveform and trajectory last. With
        ``defer`` these two are not yielded: the caller makes and publishes each stream when it has
        time.
        """
        yield from self.changes()
        simulation = self.simulation
        while simulation.time < time:
            end = self.next_boundary
            block = simulation.advance_to(min(end, time))
            if block.end < end:
                self.note("stop")
                yield from self.entries()
            self._recent_energy.add(block)
            yield from self._telemetry.prompt(block, simulation.faults.since(block.start))
            yield from self._changed_faults()
            stream = self._telemetry.streams(block)
            if defer is None:
                yield from messages_of(stream)
            elif stream is not None:
                defer(stream)
            self._on_block(block)

    def advance_together(self, time: int) -> Iterator[Entry | Together]:
        """Advance to a time [ns]; where nothing changes, the messages come many at once."""
        yield from self.changes()
        simulation = self.simulation
        while simulation.time < time:
            if not len(ends := self._undisturbed_ends(time)):
                yield from self.advance_to(min(self.next_boundary, time))
                continue
            block = simulation.advance_through(ends)
            self._recent_energy.add(block)
            yield self._telemetry.together(block)
            self._on_block(block)

    def _undisturbed_ends(self, time: int) -> np.ndarray:
        now = self.time
        until = min(time, self.simulation.next_scheduled - 1)
        faults = self.simulation.faults
        if faults.active is not self._published_faults or any(
            record.fault.channel for record in faults.since(now)
        ):
            return np.empty(0, np.int64)
        return self._telemetry.ends_together(now, until)

    def changes(self) -> Iterator[Entry]:
        """Yield what changed since the last message: journal entries, and the faults once."""
        self.note_state(due=True)
        yield from self.entries()
        yield from self._changed_faults()

    def flush(self, kind: str = "flush") -> Iterator[Entry]:
        """Yield a journal entry, ``flush`` or ``end``, and the rest of waveform and trajectory."""
        self.note(kind)
        yield from self.entries()
        yield from self._changed_faults()
        yield from self._telemetry.flush()

    def status(self, state: str, bookkeeping: Bookkeeping) -> Entry:
        fields = status_fields(self.simulation, self.origin, state, bookkeeping)
        entries = self._journal.count if self._journal is not None else 0
        powers = self._recent_energy.powers()
        self.coupling_power = powers.pop("coupling_power")
        return self.time, "status", {**fields, **powers, "journal_entries": entries}

    def note(self, kind: str, **content: Any) -> None:
        self.simulation.note(kind, **content)

    def entries(self) -> Iterator[Entry]:
        """Yield the journal's entries since the last call."""
        for entry in self._journal.drain() if self._journal is not None else ():
            yield entry.time, "journal", journal_fields(entry, self.origin)

    def _changed_faults(self) -> Iterator[Entry]:
        faults = self.simulation.faults
        if faults.active is not self._published_faults:
            self._published_faults = faults.active
            yield self.time, "faults", faults_fields(faults, self.time, self.origin)
