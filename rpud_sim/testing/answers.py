"""Answers that the nodes under test have declared: one step is over when all have come."""

from __future__ import annotations

import dataclasses

from rclpy.topic_endpoint_info import TopicEndpointInfo

from rpud_sim.foundation.time import SECOND
from rpud_sim.testing.collector import Collector
from rpud_sim.testing.discovery_probe import DiscoveryProbe
from rpud_sim.testing.heard_topic import HeardTopic

_UNKNOWN = "_NODE_NAME_UNKNOWN_"  # of a publisher whose node has not been discovered


@dataclasses.dataclass
class _Answer:
    name: str
    kind: str
    count: int
    topic: HeardTopic | None = None
    begun: int = 0  # messages before the step


class Answers:
    """Declared answers of the nodes under test.

    An answer to a step has the stamp that the step has reached, or a later one. A message without a
    stamp answers if it comes after the step has begun. ``own`` is the full name of the test's own
    node, which publishes commands and answers nothing.
    """

    def __init__(self, collector: Collector, own: str) -> None:
        self._collector = collector
        self._own = own
        self._answers: list[_Answer] = []
        self._introduced = False
        self._probes: dict[str, DiscoveryProbe] = {}
        self._dead: set[bytes] = set()  # publishers of ended processes that are still remembered
        self.period = 0  # simulation time between two answers [ns]; 0 without answers
        self.timeout = 0.0  # longest real time for the answers to one step [s]

    @property
    def declared(self) -> bool:
        return bool(self._answers)

    @property
    def introduced(self) -> bool:
        return self._introduced

    @property
    def names(self) -> list[str]:
        return [answer.name for answer in self._answers]

    def declare(
        self, names: tuple[str, ...], kind: str = "", count: int = 1, period: int = 0
    ) -> None:
        """Declare topics with answers, in place of those before."""
        self.period = period if names else 0
        self._introduced = False
        resolve = self._collector.resolve
        self._answers = [_Answer(resolve(name), kind, count) for name in names]

    def connect(self) -> bool:
        """Subscribe as far as publishers are there; return whether all of them know it."""
        for answer in self._answers:
            if answer.topic is None:
                answer.topic = self._collector.subscribe(answer.name, answer.kind)
        living = [self._publishers(answer) for answer in self._answers]
        if not all(living):
            return False
        names = {name for found in living for name in found.values()}
        for name in names - self._probes.keys():
            self._probes[name] = DiscoveryProbe(self._collector.node, name)
        # Of those that are there now: a node without a name yet gets one soon.
        waiting = [name for name in names if not self._probes[name].done()]
        self._introduced = not waiting
        return self._introduced

    def part(self) -> None:
        """Forget the nodes that have answered until now: others take their places.

        The middleware remembers a killed process for up to 20 s.
        """
        for answer in self._answers:
            self._dead.update(self._publishers(answer))
        for probe in self._probes.values():
            probe.close()
        self._probes.clear()
        self._introduced = False

    def begin(self) -> None:
        """Begin a step: what has come until now is no answer to it."""
        for answer in self._answers:
            answer.begun = len(answer.topic) if answer.topic else 0

    def missing(self, stamp: int) -> list[str]:
        """Return a phrase for each topic that has not answered for a stamp [ns]."""
        return [
            self._lack(answer, stamp) for answer in self._answers if not _answered(answer, stamp)
        ]

    def late(self, stamp: int) -> bool:
        """Return whether what is missing has come at all since the step began."""
        return any(
            answer.topic is not None and len(answer.topic) > answer.begun
            for answer in self._answers
            if not _answered(answer, stamp)
        )

    def _publishers(self, answer: _Answer) -> dict[bytes, str]:
        """Return the living publishers, by their identifiers, with the names of their nodes.

        The name is empty where a publisher has been discovered before its node.
        """
        if answer.topic is None or not answer.topic.subscription.get_publisher_count():
            return {}
        found = {
            bytes(each.endpoint_gid): _node_name(each)
            for each in self._collector.node.get_publishers_info_by_topic(answer.name)
        }
        return {
            gid: name for gid, name in found.items() if gid not in self._dead and name != self._own
        }

    def _lack(self, answer: _Answer, stamp: int) -> str:
        topic = answer.topic
        if topic is None:
            return f"{answer.name}, which has no publisher"
        if not len(topic):
            return f"{answer.name}, which has published nothing"
        if not topic.stamped:
            return f"{answer.name}: {len(topic) - answer.begun} of {answer.count} messages"
        return f"{answer.name}, whose last answer is for {topic.stamps[-1] / SECOND:.3f} s"


def _node_name(publisher: TopicEndpointInfo) -> str:
    name = publisher.node_name
    return "" if name == _UNKNOWN else f"{publisher.node_namespace.rstrip('/')}/{name}"


def _answered(answer: _Answer, stamp: int) -> bool:
    topic = answer.topic
    if topic is None:
        return False
    since = topic.stamps[answer.begun :]
    if topic.stamped:
        since = [each for each in since if each >= stamp]
    return len(since) >= answer.count
