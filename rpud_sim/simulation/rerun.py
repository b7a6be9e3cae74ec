"""Rerun of a journal: the same messages again, bit for bit; checkpoints, and starts of forks."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown
from rpud_sim.foundation.time import split_fraction
from rpud_sim.model.engine import EngineError
from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import Settings, to_configuration, to_values
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.journal import Journal, JournalEntry
from rpud_sim.simulation.plans import Planned
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.state import read_state
from rpud_sim.simulation.telemetry import Entry, Together
from rpud_sim.simulation.topics import Fields

# Checkpoints that are kept. One takes well below a megabyte at the default rates.
MOST_CHECKPOINTS = 16

_NAME = re.compile(r"[A-Za-z0-9_.-]{1,64}")


class CheckpointError(ParameterError):
    """Checkpoint that cannot be saved or restored; the text says why, in one line."""


class Checkpoints:
    """Named states of runs, in memory; at most ``MOST_CHECKPOINTS``."""

    def __init__(self) -> None:
        self._runs: dict[str, Run] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the checkpoints, the oldest first."""
        return tuple(self._runs)

    def save(self, name: str, run: Run) -> None:
        if not (isinstance(name, str) and _NAME.fullmatch(name)):
            raise CheckpointError(
                f"{shown(name)} is no name of a checkpoint: 1 to 64 letters, digits, _, . and -"
            )
        if name not in self._runs and len(self._runs) >= MOST_CHECKPOINTS:
            raise CheckpointError(
                f"{shown(name)} would be one more than {MOST_CHECKPOINTS} checkpoints: "
                f"give the name of one to replace, such as {next(iter(self._runs))}"
            )
        state = run.copy()
        self._runs.pop(name, None)
        self._runs[name] = state

    def find(self, name: str) -> Run:
        """Return a new run in the state of a checkpoint, which stays."""
        if name not in self._runs:
            known = did_you_mean(name, self._runs) if self._runs else "none was saved"
            raise CheckpointError(f"there is no checkpoint {shown(name)}; {known}")
        run = self._runs[name].copy()
        run.begin_streams()  # what was pending is of the time before the checkpoint
        return run


class JournalError(ValueError):
    """Entry that cannot be repeated; the text says which and why, in one line."""


class Rerun:
    """Runs that repeat the entries of a journal.

    The messages are those of the journal's runs with a subscriber on every topic. A ``journal``
    goes on with another one; ``wanted`` as of ``Run``.
    """

    def __init__(
        self, journal: Journal | None = None, wanted: Callable[[str], bool] = lambda topic: True
    ) -> None:
        self._journal = journal
        self._wanted = wanted
        self.run: Run | None = None  # the present one; None before the first; read-only
        self._checkpoints = Checkpoints()
        # Whether checkpoints may be unknown that the drill had: it began at a state.
        self._late = False

    @property
    def time(self) -> int:
        return self.run.time if self.run else 0

    @property
    def origin(self) -> int:
        return self.run.origin if self.run else 0

    def repeat(self, entry: JournalEntry) -> Iterator[Entry | Together]:
        """Advance to the time of an entry, repeat its change, and yield the messages."""
        try:
            yield from self._repeat(entry)
        except Exception as error:
            expected = isinstance(error, (ArithmeticError, LookupError, TypeError, ValueError))
            # A state of a stranger may hold what no drill has, which shows anywhere.
            if isinstance(error, EngineError) or not (expected or self._late):
                raise
            reason = str(error) if isinstance(error, ValueError) else f"{error!r:.100}"
            raise JournalError(
                f"journal entry {entry.sequence} ({entry.kind:.20}) cannot be done: {reason}"
            ) from error

    def _repeat(self, entry: JournalEntry) -> Iterator[Entry | Together]:
        content = entry.content
        if entry.kind == "begin":
            if entry.sequence == 0:  # another start of the node, which forgot its checkpoints
                self._checkpoints = Checkpoints()
                self._late = False
            self._late |= entry.sequence > 0 and self.run is None
            self.run = Run(Beginning.from_journal(content), self._journal, self._wanted)
        elif self.run is None and entry.kind == "state":
            self._late = True
            beginning = Beginning.from_journal(content["beginning"])
            run = Run(beginning, self._journal, self._wanted)
            _set_state(run, entry.time, content["state"])
            self.run = run
        elif self.run is None and not self._late:
            raise JournalError("nothing has begun")
        elif self.run is not None:
            if entry.time < self.run.time:
                raise JournalError(f"its time {entry.time} ns is before that of the one before it")
            yield from self.run.advance_together(entry.time)
            if entry.kind == "restore":
                name = content["name"]
                unknown = self._late and name not in self._checkpoints.names
                # The state of the restored run follows.
                self.run = None if unknown else self._checkpoints.find(name)
                return
            if entry.kind == "save":
                self._checkpoints.save(content["name"], self.run)
            yield from repeat_change(self.run, entry)

    def advance_to(self, time: int) -> Iterator[Entry | Together]:
        return self.run.advance_together(time) if self.run else iter(())


def repeat_change(run: Run, entry: JournalEntry) -> Iterator[Entry]:
    """Repeat the change of an entry on a run at the entry's time, and yield the messages."""
    if entry.kind in ("flush", "end"):
        yield from run.flush(entry.kind)
    elif (change := _CHANGES.get(entry.kind)) is not None:
        change(run, entry.content)
        yield from run.changes()
    else:
        raise JournalError("there is no such kind")


# What the content of an entry changes, by its kind.
_CHANGES: Mapping[str, Callable[[Run, Mapping[str, Any]], object]] = {
    "weight_on_bit": lambda run, command: run.simulation.apply(WeightOnBit(command["force"])),
    "drive": lambda run, command: run.simulation.apply(
        Drive(command["enabled"], command["voltage"], command["frequency"])
    ),
    "feed": lambda run, command: run.simulation.apply(Feed(command["mode"], command["value"])),
    "configure": lambda run, content: run.simulation.configure(
        to_configuration(content["parameters"])
    ),
    "inject": lambda run, content: run.simulation.inject(
        Fault(**content["fault"]), content["duration"]
    ),
    "clear": lambda run, content: run.simulation.clear(content["number"]),
    "clear_all": lambda run, content: run.simulation.clear_all(),
    "origin": lambda run, content: run.place(content["origin"]),
    "stop": lambda run, content: None,
    "state": lambda run, content: run.note_state(),
    "save": lambda run, content: run.note("save", **content),
}


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


def _set_state(run: Run, time: int, state: Mapping[str, Any]) -> None:
    """Put a new run into a state of a run with the same beginning; any error says it is none."""
    beginning = to_values(run.beginning.settings.configuration)
    configuration = to_configuration({**beginning, **state["parameters"]})
    run.simulation._plant.engine.drain()  # impacts of time zero are no part of it
    read_state(run, state["run"], configuration)
    run.faults_published = bool(state["faults_published"])
    plant = run.simulation._plant
    began = plant.engine._state[0]
    if (
        run.time != time
        or plant._instant != split_fraction(time)
        or not plant.next_step > time
        or not 0 <= began["seconds"] + began["fraction"] <= sum(plant._instant)
    ):
        raise ValueError("its times do not agree")
