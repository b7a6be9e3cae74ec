"""Recorded topic: its subscription, and its received, lost and damaged messages."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from rpud_sim.bag import Message
from rpud_sim.bag.losses import Losses, SequenceGaps
from rpud_sim.ros.qos import RECORDING_DEPTH

_ENCAPSULATION = 4  # bytes before the fields of every message (CDR)
_MATCHING = 3.0  # s in which a publisher that was found should be connected
_DISCOVERY = 3.5  # s in which every publisher is found; the middleware announces itself every 3 s
_EARLIEST = 946_684_800_000_000_000  # the year 2000 [ns since the epoch]
_LATEST = 2**63 - 1  # in a bag [ns since the epoch]
_AHEAD = 86_400_000_000_000  # that our clock may be set back while a message waits [ns]


def is_damaged(data: bytes, log_time: int, publish_time: int) -> bool:
    """Return whether these cannot be a message and its times [ns since the epoch].

    The middleware delivers such messages from shared memory that a killed process has left behind.
    A publisher's clock may be off, or missing: its time need only fit into a bag.
    """
    now = time.time_ns()
    # A computer without a battery for its clock may live in 1970 as a whole.
    earliest = min(_EARLIEST, max(1, now - _AHEAD))
    times_fit = earliest <= log_time <= now + _AHEAD and 0 <= publish_time <= _LATEST
    return len(data) < _ENCAPSULATION or not times_fit


@dataclass
class RecordedTopic:
    """Topic with its subscription and its counts."""

    name: str
    type: str
    message: Any
    subscription: Subscription
    request: QoSProfile  # QoS of the subscription
    gaps: SequenceGaps  # of the middleware's sequence numbers
    # publishers that were found last
    endpoints: list[TopicEndpointInfo] = field(default_factory=list)
    declared: bool = False  # whether the bag has its declaration
    numbered: bool = True  # whether the middleware numbers its messages
    # other types of the topic, which are not recorded
    further_types: set[str] = field(default_factory=set)
    # when it was subscribed first, by the monotonic clock [s]
    subscribed_at: float = field(default_factory=time.monotonic)
    damaged: int = 0  # messages that were damaged
    received_at: float = float("-inf")  # when a message came last, by the monotonic clock [s]
    # since when fewer publishers are connected than there are, by that clock [s]
    unmatched: float | None = None
    renewals: int = 0  # subscriptions that were renewed as a publisher was silent
    _uncounted: int = 0  # damaged messages whose numbers are a gap in the next ones
    _latest: dict[tuple[int, int | None, int], None] = field(default_factory=dict)

    def losses(self, refused: int) -> Losses:
        """Return the losses; ``refused`` are messages that did not fit into the queue."""
        return Losses(self.gaps.missing if self.numbered else None, refused, self.damaged)

    def misses(self, offers: Sequence[QoSProfile]) -> bool:
        """Return whether a publisher of these offers should have connected by now, and has not."""
        fitting = sum(
            qos_check_compatible(offer, self.request)[0] != QoSCompatibility.ERROR
            for offer in offers
        )
        now = time.monotonic()
        if self.subscription.handle.get_publisher_count() >= fitting:
            self.unmatched = None
        elif self.unmatched is None:
            self.unmatched = now
        elif now >= self.unmatched + _MATCHING * 2 ** min(self.renewals, 5):
            self.unmatched = None
            return True
        return False

    def note_silence(self) -> None:
        """Count from the first message of each publisher, if none has been found in all the time.

        Those that come are new: what they send before they know the subscription is lost.
        """
        settled = time.monotonic() >= self.subscribed_at + _DISCOVERY
        volatile = self.request.durability != DurabilityPolicy.TRANSIENT_LOCAL
        if settled and volatile and not self.endpoints:
            self.gaps.from_first = True

    def accept(self, data: bytes, info: dict[str, Any], *, counts: bool) -> Message | None:
        """Return the message, None if damaged or repeated; ``counts`` makes a gap a loss."""
        log_time = info["received_timestamp"] or time.time_ns()
        publish_time = info["source_timestamp"]
        if is_damaged(data, log_time, publish_time):
            self.damaged += 1
            self._uncounted += 1
            return None
        number = info["publication_sequence_number"]
        if self._is_repeated(publish_time, number, data):
            return None
        self.received_at = time.monotonic()
        self._note(number, counts)
        return Message(self.name, log_time, publish_time, data)

    def _is_repeated(self, publish_time: int, number: int | None, data: bytes) -> bool:
        if self.request.durability != DurabilityPolicy.TRANSIENT_LOCAL:
            return False
        key = publish_time, number, hash(data)  # publishers may have no clock
        if key in self._latest:
            return True
        self._latest[key] = None
        if len(self._latest) > RECORDING_DEPTH:
            del self._latest[next(iter(self._latest))]
        return False

    def _note(self, number: int | None, counts: bool) -> None:
        if number is None:
            self.numbered = False
            return
        before = self.gaps.missing
        self.gaps.note(number)
        found = self.gaps.missing - before
        if not counts:
            self.gaps.missing = before
        elif found:
            self.gaps.missing -= min(found, self._uncounted)
            self._uncounted = 0
