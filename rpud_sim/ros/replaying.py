"""When each message of a replay is due. No ROS; times of the bag are integer nanoseconds."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from rpud_sim.bag import Message
from rpud_sim.ros.stopping import StopRequest

_LONGEST_SLEEP = 3600.0  # s; the system call refuses more than some decades


@dataclass(frozen=True)
class Timeline:
    """Lays the bag's time on the monotonic clock: `bag_time` [ns] is due at `began` [s]."""

    bag_time: int
    began: float
    rate: float

    def delay(self, bag_time: int) -> float:
        """Give the time from now until `bag_time` [ns] is due [s]; negative where it is late."""
        return (bag_time - self.bag_time) / (self.rate * 1e9) - (time.monotonic() - self.began)

    def sleep_until(self, bag_time: int, stop: StopRequest) -> bool:
        """Sleep until `bag_time` [ns] is due; tell whether a stop was requested before."""
        while (delay := self.delay(bag_time)) > 0 and not stop.requested:
            stop.wait(min(delay, _LONGEST_SLEEP))
        return stop.requested


def with_ticks(
    messages: Iterable[Message], start: int, period: float | None
) -> Iterator[tuple[int, Message | None]]:
    """Yield messages with their log times and, as None, a tick each `period` [ns] from `start` on.

    A `period` of None gives no ticks. The last tick is not after the last message.
    """
    count = 0
    for message in messages:
        if period is not None:
            while (tick := start + round(count * period)) <= message.log_time:
                yield tick, None
                count += 1
        yield message.log_time, message
