"""Schedule of faults: those that begin and end by themselves, at their exact instants."""

from __future__ import annotations

import heapq
from collections.abc import Iterator

from rpud_sim.foundation.time import NEVER
from rpud_sim.simulation.scenario import ScheduledFault


class FaultSchedule:
    """Instants at which faults begin or end by themselves.

    At one instant ends come before beginnings, each in the order in which they were planned. Times
    are integer nanoseconds of simulation time.
    """

    def __init__(self) -> None:
        # Time, whether it begins, number of the plan, and the fault or the number of its record.
        self._plans: list[tuple[int, bool, int, ScheduledFault | int]] = []
        self._count = 0

    @property
    def next_time(self) -> int:
        """Time of the next beginning or end [ns]; ``NEVER`` if none is planned."""
        return self._plans[0][0] if self._plans else NEVER

    def plan_beginning(self, fault: ScheduledFault) -> None:
        """Plan that a fault begins at its onset."""
        self._plan(fault.onset, True, fault)

    def plan_end(self, time: int, number: int) -> None:
        """Plan that the fault of a number ends at a time [ns]."""
        self._plan(time, False, number)

    def pop_due(self, time: int) -> Iterator[ScheduledFault | int]:
        """Yield the faults that begin until a time [ns], and the numbers of those that end."""
        while self.next_time <= time:
            yield heapq.heappop(self._plans)[-1]

    def _plan(self, time: int, begins: bool, fault: ScheduledFault | int) -> None:
        heapq.heappush(self._plans, (time, begins, self._count, fault))
        self._count += 1
