"""Nodes under test: proof that drill and test know them, and their answers to a step."""

from __future__ import annotations

import dataclasses
import time
import warnings
from collections.abc import Collection, Iterable, Mapping

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.graph import DiscoveryProbe, node_name
from rpud_sim.simulation.topics import ALL_COMMAND_TOPICS
from rpud_sim.testing.collector import Collector, StoredTopic

_PATIENCE = 5.0  # with a node that does not answer, or has no services of parameters [s]
# Parts of the identifier of an endpoint, as Fast DDS makes it.
_PARTICIPANT = slice(0, 12)
_PROCESS = slice(0, 8)  # equal for all participants of one process
_PROCESS_ID = slice(4, 6)  # its lower half, the lowest byte first


class DiscoveryHandshake:
    """Nodes that command the drill, call it or answer the test, by their publishers.

    The graph of one process shows who has discovered that process, and not whom the others have
    discovered. A node is discovered when it has answered a request of the drill and one of the
    test, by clients that were made after everything that the node may reach there. ``own`` is the
    node of the test's client.
    """

    def __init__(self, collector: Collector, own: Node) -> None:
        self._collector = collector
        self._own = own
        self._not_tested = {
            own.get_fully_qualified_name(),
            collector.node.get_fully_qualified_name(),
            collector.resolve("drill_node"),
        }
        self._gone: set[bytes] = set()  # participants of ended processes, still remembered
        self._discovered: set[bytes] = set()  # publishers whose nodes have answered
        self._probes: dict[str, DiscoveryProbe] = {}  # of the test, by node
        self._begun: dict[bytes, float] = {}  # when publishers were seen first [s]

    def publishers(self, topic: str) -> dict[bytes, str]:
        """Return the living publishers of a topic, by their identifiers, with their nodes' names.

        The drill and the test are none of them. A name is empty where a publisher has been
        discovered before its node.
        """
        node = self._collector.node
        return self._living(node.get_publishers_info_by_topic(self._collector.resolve(topic)))

    def lacking(self, answering: Mapping[bytes, str]) -> list[str]:
        """Ask the drill for its account, and return the nodes that are not discovered yet.

        ``answering`` are endpoints of other nodes, such as publishers of answers. A node that never
        answers is discovered after a while, with a warning.
        """
        found = dict(answering)
        for topic in ALL_COMMAND_TOPICS:
            found.update(self.publishers(topic))
        for service in self._collector.delivery.services:
            found.update(self._clients(service))
        waiting = {gid: name for gid, name in found.items() if gid not in self._discovered}
        names = {name for name in waiting.values() if name}
        for name in self._probes.keys() - names:
            self._probes.pop(name).close()
        for name in names - self._probes.keys():
            self._probes[name] = DiscoveryProbe(self._own, name)
        # First all of them: each call sends a request.
        unanswered = {name for name in names if not self._probes[name].answered()}
        unanswered.update(self._collector.ask(sorted(names)).unanswered)
        for gid, name in waiting.items():
            patient = time.monotonic() - self._begun.setdefault(gid, time.monotonic()) < _PATIENCE
            if name and name not in unanswered:
                self._discovered.add(gid)
            elif not patient:
                self._discovered.add(gid)
                warnings.warn(
                    f"{name or 'a node without a name'} does not answer get_parameters: its first "
                    "commands or answers may be lost",
                    stacklevel=2,
                )
        return sorted({name for gid, name in waiting.items() if gid not in self._discovered})

    @property
    def unserved(self) -> list[str]:
        """A line for each service that a node under test calls and no node serves."""
        node = self._collector.node
        return sorted(
            f"{name or 'a node'} calls {service}, which no node serves"
            for service, _ in node.get_service_names_and_types()
            if not node.count_services(service)
            for name in set(self._clients(service).values())
        )

    @property
    def subscribed(self) -> set[str]:
        """Absolute names of the topics that nodes under test subscribe to."""
        node = self._collector.node
        topics = [topic for topic, _ in node.get_topic_names_and_types()]
        return {each for each in topics if self._living(node.get_subscriptions_info_by_topic(each))}

    def renew(self) -> None:
        """Have all nodes discovered again: the test subscribes to other topics."""
        self._discovered.clear()
        self._begun.clear()
        for probe in self._probes.values():
            probe.close()
        self._probes.clear()

    def forget(self, processes: Collection[int]) -> None:
        """Forget everything of processes that have ended, by their numbers.

        The middleware remembers a killed process for up to 20 s.
        """
        numbers = {process.to_bytes(8, "little")[:2] for process in processes}
        found = {bytes(each.endpoint_gid) for each in self._published()}
        self._gone.update(gid[_PARTICIPANT] for gid in found if gid[_PROCESS_ID] in numbers)

    def has_endpoints(self, processes: Collection[int]) -> bool:
        """Return whether processes, by their numbers, publish or subscribe to a topic."""
        numbers = {process.to_bytes(8, "little")[:2] for process in processes}
        node = self._collector.node
        topics = [topic for topic, _ in node.get_topic_names_and_types()]
        found = [each for name in topics for each in node.get_subscriptions_info_by_topic(name)]
        found += self._published()
        return any(bytes(each.endpoint_gid)[_PROCESS_ID] in numbers for each in found)

    def part(self) -> None:
        """Forget all processes but the drill and the test: others take their places."""
        found = {bytes(each.endpoint_gid): node_name(each) for each in self._published()}
        kept = {gid[_PROCESS] for gid, name in found.items() if name in self._not_tested}
        self._gone.update(gid[_PARTICIPANT] for gid in found if gid[_PROCESS] not in kept)
        self.renew()

    def _published(self) -> list[TopicEndpointInfo]:
        """Return the publishers of all topics."""
        node = self._collector.node
        topics = [topic for topic, _ in node.get_topic_names_and_types()]
        return [each for topic in topics for each in node.get_publishers_info_by_topic(topic)]

    def _clients(self, service: str) -> dict[bytes, str]:
        """Return the living clients of a service, as ``publishers`` does for a topic.

        By the topic of their requests, as Fast DDS names it: by the name of a node the graph finds
        one of all nodes of that name, also a killed one.
        """
        requests = f"rq{service}Request"
        node = self._collector.node
        return self._living(node.get_publishers_info_by_topic(requests, no_mangle=True))

    def _living(self, endpoints: Iterable[TopicEndpointInfo]) -> dict[bytes, str]:
        """Return the endpoints of other nodes, as far as their processes are known to live."""
        found = {bytes(each.endpoint_gid): node_name(each) for each in endpoints}
        return {
            gid: name
            for gid, name in found.items()
            if gid[_PARTICIPANT] not in self._gone and name not in self._not_tested
        }


@dataclasses.dataclass
class _Answer:
    name: str
    count: int
    topic: StoredTopic | None = None
    begun: int = 0  # messages before the step

    @property
    def heard(self) -> int:
        return len(self.topic) if self.topic else 0

    def lack(self, stamp: int) -> str:
        """Return a phrase for what is missing for a stamp [ns]; empty for nothing."""
        topic, since = self.topic, self.heard - self.begun
        if topic is None:
            return f"{self.name}, which has no publisher"
        found = topic.stamps[self.begun :].count(stamp) if topic.stamped else since
        if found >= self.count:
            return ""
        if not self.heard:
            return f"{self.name}, which has published nothing"
        if not topic.stamped:
            return f"{self.name}: {since} of {self.count} messages"
        return f"{self.name}, whose last answer is for {topic.stamps[-1] / SECOND:.3f} s"


class Answers:
    """Declared answers of the nodes under test.

    An answer to a step has the stamp that the step has reached: a later one is of before a reset,
    or of another clock. A message without a stamp answers if it comes after the step has begun.
    """

    def __init__(self, collector: Collector, handshake: DiscoveryHandshake) -> None:
        self._collector = collector
        self._handshake = handshake
        self._answers: list[_Answer] = []
        self.discovered = False  # whether the nodes that answer know the test and the drill
        self.period = 0  # simulation time between two answers [ns]; 0 without answers
        self.timeout = 0.0  # longest real time for the answers to one step [s]

    @property
    def declared(self) -> bool:
        return bool(self._answers)

    @property
    def names(self) -> list[str]:
        return [answer.name for answer in self._answers]

    def declare(self, names: tuple[str, ...], count: int = 1, period: int = 0) -> None:
        """Declare topics with answers, instead of those before."""
        self.period = period if names else 0
        self.discovered = False
        self._handshake.renew()
        resolve = self._collector.resolve
        self._answers = [_Answer(resolve(name), count) for name in names]

    def connect(self) -> bool:
        """Subscribe as far as publishers are there; return whether each topic has one."""
        for answer in self._answers:
            if answer.topic is None:
                answer.topic = self._collector.subscribe(answer.name)
                if answer.topic is not None:  # what nodes knew before is not enough
                    self._handshake.renew()
        return all(self._publishers(answer) for answer in self._answers)

    @property
    def publishers(self) -> dict[bytes, str]:
        """Living publishers of all answers, by their identifiers, with the names of their nodes."""
        return {gid: name for each in self._answers for gid, name in self._publishers(each).items()}

    def too_many_publishers(self) -> str:
        """Return a phrase for a topic with more publishers than awaited messages; empty if none."""
        for answer in self._answers:
            if answer.topic and answer.topic.subscription.get_publisher_count() > answer.count:
                names = sorted(name or "a node" for name in self._publishers(answer).values())
                if len(names) > answer.count:
                    return (
                        f"{answer.name} has {len(names)} publishers, {' and '.join(names)}, and "
                        f"count={answer.count} awaits as many messages: give count={len(names)}"
                    )
        return ""

    def begin(self) -> None:
        """Begin a step: what has come until now is not an answer to it."""
        for answer in self._answers:
            answer.begun = answer.heard

    def missing(self, stamp: int) -> list[str]:
        """Return a phrase for each topic that has not answered for a stamp [ns]."""
        return [lack for answer in self._answers if (lack := answer.lack(stamp))]

    @property
    def none_received(self) -> bool:
        """Whether a topic has had no message at all."""
        return not all(answer.heard for answer in self._answers)

    def late(self, stamp: int) -> bool:
        """Return whether what is missing has come at all since the step began."""
        return any(each.heard > each.begun for each in self._answers if each.lack(stamp))

    def _publishers(self, answer: _Answer) -> dict[bytes, str]:
        if answer.topic is None or not answer.topic.subscription.get_publisher_count():
            return {}
        return self._handshake.publishers(answer.name)
