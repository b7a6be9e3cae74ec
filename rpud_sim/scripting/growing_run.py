"""Columns of a run that continues: only what is new since the last time is computed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rpud_sim.recorded.drill_tables import rows_of
from rpud_sim.simulation.changes import SetOrigin
from rpud_sim.simulation.plan import Journal, Plan
from rpud_sim.simulation.run import Run

# Topics with messages that a run has only at its end.
_AT_END = ("waveform", "trajectory", "power", "status", "journal")


class _Topic:
    """Topic of the run, up to the time that was asked for last."""

    def __init__(self, topic: str, plan: Plan) -> None:
        self._topic = topic
        self._run = Run(
            Plan(plan.beginning, recorded=plan.recorded), Journal(), {topic}.__contains__
        )
        self._run.begin(0)
        self._scheduled = 0  # changes of the plan
        self._columns: Mapping[str, np.ndarray] = rows_of(topic, ())

    def columns(self, plan: Plan, end: int) -> Mapping[str, np.ndarray] | None:
        """Return the columns up to a time [ns]; None if the run is beyond it."""
        run = self._run
        if end < run.time:
            return None
        while self._scheduled < len(plan.changes) and plan.changes[self._scheduled].time < end:
            change = plan.changes[self._scheduled]
            self._scheduled += 1
            if not isinstance(change.action, SetOrigin):  # as in the bag of a run
                run.schedule(change)
        new = [each for each in run.advance_to(end) if each.topic == self._topic]
        if new:
            further, known = rows_of(self._topic, new), self._columns
            self._columns = {n: np.concatenate([known[n], further[n]]) for n in known}
        return self._columns


class GrowingRun:
    """Topics of a run that continues; a copy starts empty."""

    def __init__(self) -> None:
        self._topics: dict[str, _Topic] = {}

    def columns(self, topic: str, plan: Plan, end: int) -> Mapping[str, np.ndarray] | None:
        """Return the columns of a topic of the plan's run that ends at a time [ns].

        None if a longer run begins with other messages, or the run is beyond that time.
        """
        if topic in _AT_END:
            return None
        if topic not in self._topics:
            self._topics[topic] = _Topic(topic, plan)
        return self._topics[topic].columns(plan, end)

    def __reduce__(self) -> Any:
        return GrowingRun, ()
