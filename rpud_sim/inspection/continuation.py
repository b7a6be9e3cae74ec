"""Continuation of a fork: the messages from its instant to its end."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.fork import Fork, begin_changes
from rpud_sim.inspection.recorded_changes import repeated
from rpud_sim.inspection.recorded_run import ForkError
from rpud_sim.simulation.changes import Changes, apply_change
from rpud_sim.simulation.fields import Bookkeeping
from rpud_sim.simulation.together import Entry

# A change of a run, at a time in nanoseconds; it yields messages.
Event = tuple[int, Callable[[], Iterable[Entry]]]


class Continuation:
    """Messages of a fork, from its instant on for a duration [s].

    Without a duration it goes up to the end of the recorded run. A journal that does not hold what
    followed raises a ForkError.
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
