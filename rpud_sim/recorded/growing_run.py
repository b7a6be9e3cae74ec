"""Run that continues: the messages of its topics, computed when they are asked for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from rpud_sim.messages.batch import Batch
from rpud_sim.simulation.changes import Change
from rpud_sim.simulation.plan import Plan
from rpud_sim.simulation.run import Run


class GrowingRun:
    """Run that advances with the changes that become known, after the changes of a plan.

    A topic that is asked for the first time is computed from the beginning, and from then on
    together with the others and with ``topics``.
    """

    def __init__(self, plan: Plan, topics: Iterable[str] = ()) -> None:
        self._beginning, self._changes = plan, [*plan.changes]
        # messages that nobody has, by topic
        self._new: dict[str, list[Batch]] = {topic: [] for topic in topics}
        self.run = Run(plan, None, self._new.__contains__)  # to be read

    def advance(self, changes: Sequence[Change], end: int) -> None:
        """Carry out further changes, and advance to a time [ns]."""
        self.run.schedule(*changes)
        self._changes += changes
        for batch in self.run.advance_to(end):
            if batch.topic in self._new:
                self._new[batch.topic].append(batch)

    def new(self, topic: str) -> list[Batch]:
        """Return the messages of a topic since the last call."""
        if topic not in self._new:
            plan = replace(self._beginning, changes=tuple(self._changes))
            again = Run(plan, None, {topic}.__contains__).advance_to(self.run.time)
            self._new[topic] = [each for each in again if each.topic == topic]
        found, self._new[topic] = self._new[topic], []
        return found
