"""Ledger and schedule of faults: when each begins and ends, to the nanosecond."""

from __future__ import annotations

import dataclasses
import heapq
from collections import deque
from collections.abc import Iterator

from rpud_sim.foundation.quantities import shown
from rpud_sim.foundation.shared import Shared
from rpud_sim.foundation.time import NEVER
from rpud_sim.simulation.faults import Fault, FaultError
from rpud_sim.simulation.scenario import ScheduledFault

# Cleared faults that are kept; older ones are only counted.
MOST_CLEARED = 1000


@dataclasses.dataclass(frozen=True)
class FaultRecord(Shared):
    """Time during which a fault lasted: the ground truth."""

    number: int  # counts the injected faults from 1
    fault: Fault  # that was injected
    onset: int  # simulation time at which it began [ns]
    clear: int | None = None  # simulation time at which it ended, None while it lasts [ns]

    def lasts_at(self, time: int) -> bool:
        """Whether it lasts at a simulation time [ns]: from its onset on, before its end."""
        return self.onset <= time and (self.clear is None or time < self.clear)


class FaultLedger:
    """Faults of a run: those that last, and those that ended.

    Times are integer nanoseconds of simulation time.
    """

    def __init__(self) -> None:
        self._number = 0
        # that last, in order of injection; the same object until one begins or ends; read-only
        self.active: tuple[FaultRecord, ...] = ()
        self._cleared: deque[FaultRecord] = deque(maxlen=MOST_CLEARED)
        self.forgotten = 0  # cleared faults that ``records`` no longer contains; read-only

    @property
    def records(self) -> tuple[FaultRecord, ...]:
        """Faults in order of injection; of cleared ones, the latest ``MOST_CLEARED``."""
        return tuple(sorted((*self._cleared, *self.active), key=lambda record: record.number))

    def since(self, time: int) -> tuple[FaultRecord, ...]:
        """Return faults that last or ended after a time, in order of injection."""
        ended = tuple(record for record in self._cleared if (record.clear or 0) > time)
        if not ended:
            return self.active
        return tuple(sorted((*ended, *self.active), key=lambda record: record.number))

    def inject(self, time: int, fault: Fault) -> int:
        """Let a fault begin and return its number."""
        for record in self.active:
            if (record.fault.kind, record.fault.channel) == (fault.kind, fault.channel):
                raise FaultError(f"{fault} is already there as fault {record.number}")
        self._number += 1
        self.active = (*self.active, FaultRecord(self._number, fault, time))
        return self._number

    def clear(self, time: int, number: int) -> FaultRecord:
        """Let a fault end and return its record."""
        for record in self.active:
            if record.number == number:
                break
        else:
            raise FaultError(f"there is no fault {shown(number)} to clear")
        ended = dataclasses.replace(record, clear=time)
        self.active = tuple(other for other in self.active if other is not record)
        self.forgotten += len(self._cleared) == MOST_CLEARED
        self._cleared.append(ended)
        return ended

    def clear_all(self, time: int) -> None:
        """Let every fault end."""
        for record in self.active:
            self.clear(time, record.number)


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
