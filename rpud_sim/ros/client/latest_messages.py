"""Latest message of each topic of a drill that a client follows."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from itertools import pairwise
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rpud_msgs.msg import CommandResults, Status

from rpud_sim.ros.client.listening_node import ClientError, ListeningNode
from rpud_sim.ros.graph import message_class
from rpud_sim.ros.received import ReceivedTopic
from rpud_sim.ros.threads import raised
from rpud_sim.simulation.topics import TOPICS

RESULTS = "command_results"
FOLLOWED = ("status", "faults", "journal", RESULTS)  # that every client has
Observer = Callable[[str, Any, int], object]  # takes topic, message, and publishing time [ns]

_LATCHED = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class LatestMessages:
    """Messages by topic, decoded at their first use; results of commands go to ``take_results``."""

    def __init__(
        self, listening: ListeningNode, take_results: Callable[[CommandResults], object]
    ) -> None:
        self._listening, self._take_results = listening, take_results
        self._received: dict[str, ReceivedTopic] = {}
        self._latest: dict[str, Any] = {}  # a message, or its bytes before its first use
        self._observers: dict[str, Observer] = {}
        self._numbers = deque([0], maxlen=100)  # of the latest statuses, by their publisher
        self._shown = 0  # number of the status that a step returned; those before are older

    def __contains__(self, topic: str) -> bool:
        return topic in self._latest

    def __getitem__(self, topic: str) -> Any:
        """Return the latest message of a topic that has one; a ClientError if it is malformed."""
        latest = self._latest[topic]
        if isinstance(latest, bytes):
            try:
                latest = deserialize_message(latest, self._received[topic].kind)
            except RuntimeError as error:  # rclpy raises it at a malformed message
                raise ClientError(f"the latest message of {topic}: {raised(error)}") from error
            self._latest[topic] = latest
        return latest

    @property
    def status_number(self) -> int:
        """Number that its publisher has given to the latest status; 0 before the first."""
        return self._numbers[-1]

    @property
    def numbers_fall(self) -> bool:
        """Whether the statuses come from several publishers: the number of one alone grows."""
        return any(after <= before for before, after in pairwise(self._numbers))

    def follow(self, topics: Iterable[str], observer: Observer | None = None) -> None:
        """Subscribe to latched topics that are not followed yet; an observer replaces another."""
        for topic in topics:
            if topic not in self._received:
                kind = CommandResults if topic == RESULTS else message_class(TOPICS[topic].type)
                sink = partial(self._receive, topic)
                self._received[topic] = self._listening.subscribe(kind, topic, sink, _LATCHED)
            if observer is not None:
                self._observers[topic] = observer

    def show(self, number: int, status: Status) -> None:
        """Take a status from the response of a step; those before may be on their way."""
        if self.status_number < number:
            self._shown = number
            self._latest["status"] = status

    def _receive(self, topic: str, data: bytes, published: int, _: int) -> None:
        if topic == "status":
            number = self._received[topic].number or 0
            if number < self.status_number:  # of another process
                self._shown = 0
            self._numbers.append(number)
            if number < self._shown:
                return
        self._latest[topic] = data
        if topic == RESULTS:
            self._take_results(self[topic])
        if topic in self._observers:
            self._observers[topic](topic, self[topic], published)
