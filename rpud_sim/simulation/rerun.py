"""Rerun of a journal: the same messages again, bit for bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from rpud_sim.model.engine import EngineError
from rpud_sim.simulation.checkpoints import Checkpoints
from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import to_configuration
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.journal import Journal, JournalEntry
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.state import set_state
from rpud_sim.simulation.together import Entry, Together


class JournalError(ValueError):
    """Entry that cannot be repeated; the text says which and why, in one line."""


class Rerun:
    """Runs that repeat the entries of a journal.

    The messages are those of the journal's runs with a subscriber on every topic.

    Args:
        journal: of the runs, to go on with another one; None for no journal.
        wanted: whether to make the messages of a topic that no fault can touch.
    """

    def __init__(
        self,
        journal: Journal | None = None,
        wanted: Callable[[str], bool] = lambda topic: True,
    ) -> None:
        self._journal = journal
        self._wanted = wanted
        self._run: Run | None = None
        self._checkpoints = Checkpoints()
        # Whether checkpoints may be unknown that the drill had: it began at a state.
        self._late = False

    @property
    def run(self) -> Run | None:
        """The present run; None before the first."""
        return self._run

    @property
    def time(self) -> int:
        """Simulation time [ns]."""
        return self._run.time if self._run else 0

    @property
    def origin(self) -> int:
        """Stamp of simulation time zero [ns]."""
        return self._run.origin if self._run else 0

    def repeat(self, entry: JournalEntry) -> Iterator[Entry | Together]:
        """Advance to the time of an entry, repeat its change, and yield the messages.

        Where nothing changes, they come many at once.
        """
        try:
            if entry.kind == "begin":
                if entry.sequence == 0:  # another start of the node, which forgot its checkpoints
                    self._checkpoints = Checkpoints()
                    self._late = False
                self._late |= entry.sequence > 0 and self._run is None
                self._run = Run(Beginning.from_journal(entry.content), self._journal, self._wanted)
                return
            if self._run is None:
                if entry.kind == "state":
                    self._late = True
                    self._run = self._run_in_state(entry)
                elif not self._late:
                    raise JournalError("nothing has begun")
                return
            if entry.time < self._run.time:
                raise JournalError(f"its time {entry.time} ns is before that of the one before it")
            yield from self._run.advance_together(entry.time)
            if entry.kind == "restore":
                name = entry.content["name"]
                unknown = self._late and name not in self._checkpoints.names
                # The state of the restored run follows.
                self._run = None if unknown else self._checkpoints.find(name)
                return
            if entry.kind == "save":
                self._checkpoints.save(entry.content["name"], self._run)
            yield from repeat_change(self._run, entry)
        except Exception as error:
            expected = isinstance(error, (ArithmeticError, LookupError, TypeError, ValueError))
            # A state of a stranger may hold what no drill has, which shows anywhere.
            if isinstance(error, EngineError) or not (expected or self._late):
                raise
            reason = str(error) if isinstance(error, ValueError) else f"{error!r:.100}"
            raise JournalError(
                f"journal entry {entry.sequence} ({entry.kind:.20}) cannot be done: {reason}"
            ) from error

    def _run_in_state(self, entry: JournalEntry) -> Run:
        run = Run(Beginning.from_journal(entry.content["beginning"]), self._journal, self._wanted)
        set_state(run, entry.time, entry.content["state"])
        return run

    def advance_to(self, time: int) -> Iterator[Entry | Together]:
        """Advance to a simulation time [ns] and yield the messages, as ``repeat`` does."""
        return self._run.advance_together(time) if self._run else iter(())


def repeat_change(run: Run, entry: JournalEntry) -> Iterator[Entry]:
    """Repeat the change of an entry on a run at the entry's time, and yield the messages.

    Raises:
        ArithmeticError, LookupError, TypeError, ValueError: if the entry cannot be repeated.
    """
    content = entry.content
    simulation = run.simulation
    changes: dict[str, Callable[[], object]] = {
        "weight_on_bit": lambda: simulation.apply(WeightOnBit(content["force"])),
        "drive": lambda: simulation.apply(
            Drive(content["enabled"], content["voltage"], content["frequency"])
        ),
        "feed": lambda: simulation.apply(Feed(content["mode"], content["value"])),
        "configure": lambda: simulation.configure(to_configuration(content["parameters"])),
        "inject": lambda: simulation.inject(Fault(**content["fault"]), content["duration"]),
        "clear": lambda: simulation.clear(content["number"]),
        "clear_all": simulation.clear_all,
        "origin": lambda: run.place(content["origin"]),
        "stop": lambda: None,
        "state": run.note_state,
        "save": lambda: run.note("save", **content),
    }
    if entry.kind in ("flush", "end"):
        yield from run.flush(entry.kind)
    elif entry.kind in changes:
        changes[entry.kind]()
        yield from run.changes()
    else:
        raise JournalError("there is no such kind")
