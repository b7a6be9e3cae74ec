"""Queries of recorded drills, without waiting: their parameters, and missing journal entries."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping, Sequence
from math import inf
from typing import TYPE_CHECKING, Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.parameter import parameter_value_to_python
from rclpy.serialization import deserialize_message, serialize_message

from rpud_sim.bag import Message
from rpud_sim.bag.own_records import MANIFEST_RECORD, Manifest, installed_versions, machine_name
from rpud_sim.ros.graph import STATUS, node_name
from rpud_sim.ros.received import is_damaged
from rpud_sim.ros.record.recorder_node import Recorder

if TYPE_CHECKING:
    from rpud_msgs.msg import JournalEntry

_JOURNAL = "rpud_msgs/msg/JournalEntry"
_SERVICE = "rpud_msgs/srv/GetJournal"
_REPETITION = 1.0  # of a request: a server drops the response for a client that it does not know
_POLL_PERIOD = 0.005  # [s]

Steps = Generator[None, None, None]


class ParameterQuery:
    """Finds the drills of recorded topics by their status, and records the manifest of each.

    The text of a scenario stays unknown: no file is read, as anybody could name any.
    """

    def __init__(self, node: Recorder, command: Sequence[str]) -> None:
        self._node = node
        self._command = tuple(command)
        self._known: set[tuple[int, ...]] = set()  # publishers of a status
        # What is known of drills that are asked, and the steps of asking them.
        self._asked: list[tuple[dict[str, Any], Steps]] = []

    def discover(self) -> None:
        """Find new drills, and begin to ask them."""
        for topic, types in self._node.get_topic_names_and_types():
            if STATUS not in types or not self._node.wants_drill(topic):
                continue
            for endpoint in self._node.get_publishers_info_by_topic(topic):
                publisher = tuple(endpoint.endpoint_gid)
                # Discovery finds a publisher before its node.
                if publisher not in self._known and (name := node_name(endpoint)):
                    self._known.add(publisher)
                    found = {"node": name, "scenario": None}
                    self._asked.append((found, self._ask(name, found)))

    def poll(self) -> None:
        """Record the manifests of the drills that have answered since the last call."""
        waiting, self._asked = self._asked, []
        for found, steps in waiting:
            with self._node.guard(f"an answer of {found['node']}"):
                if next(steps, found) is None:
                    self._asked.append((found, steps))
                    continue
            self._node.get_logger().info(f"knows the parameters of {found['node']}")
            self._record(found)

    def finish(self) -> None:
        """Record the manifests of drills without an answer; without any drill, an empty one."""
        for found, steps in self._asked:
            steps.close()
            self._record(found)
        if not self._known:
            self._record({})

    def _record(self, found: Mapping[str, Any]) -> None:
        manifest = Manifest(
            time=time.time_ns(),
            command=self._command,
            versions=installed_versions(),
            machine=machine_name(),
            **found,
        )
        self._node.intake.add_record(MANIFEST_RECORD, manifest.to_record())

    def _ask(self, name: str, found: dict[str, Any]) -> Steps:
        """Ask a drill for its parameters, and keep them as fields of a manifest."""
        responses: list[Any] = []
        for kind, service in (ListParameters, "list"), (GetParameters, "get"):
            names = list(responses[0].result.names) if responses else None
            request = kind.Request(names=names) if names is not None else kind.Request()
            client = self._node.create_client(kind, f"{name}/{service}_parameters")
            try:
                responses.append((yield from _response(self._node, client, kind, request)))
            finally:
                self._node.destroy_client(client)
        with self._node.guard(f"an answer of {name}"):
            listed, response = responses
            values = map(_plain, map(parameter_value_to_python, response.values))
            found["parameters"] = dict(zip(listed.result.names, values, strict=False))
            found["scenario"] = None if found["parameters"].get("scenario") else ""


class JournalQuery:
    """Asks drills for the entries of their journals that the bag lacks, and records them.

    They are missing if the recorder starts late, has stalled or was paused.
    """

    def __init__(self, node: Recorder) -> None:
        self._node = node
        # By topic: the entry with the greatest number, and what came with each number. Publishing
        # times do not distinguish a late entry from another start, as a clock may be set back.
        self._latest: dict[str, JournalEntry] = {}
        self._seen: dict[str, dict[int, int]] = {}
        self._asking: list[tuple[str, Steps]] = []  # topics, and the steps of asking
        self._status: dict[str, bytes] = {}  # the latest one of each drill, by its journal's topic
        self._answered_at = -inf  # when a drill answered last, by the monotonic clock [s]
        node.intake.observe(self._find_gap)

    def poll(self) -> None:
        """Record the entries that have come since the last call; a pause would discard them."""
        if self._node.intake.paused:
            return
        waiting, self._asking = self._asking, []
        for topic, steps in waiting:
            with self._node.guard(f"an answer about {topic}"):
                if next(steps, self) is None:
                    self._asking.append((topic, steps))

    def finish(self, seconds: float) -> None:
        """Ask for what the last status counts, too; wait for drills that answer in some seconds."""
        for topic, data in self._status.items():
            with self._node.guard(f"the last status beside {topic}"):
                status = self._node.topics[topic.removesuffix("journal") + "status"]
                counted = int(deserialize_message(data, status.kind).journal_entries)
                before = self._latest.get(topic)
                if before is not None and before.sequence + 1 < counted:
                    self._asking.append((topic, self._ask(topic, before, None, counted)))
        self._answered_at = time.monotonic()
        self.poll()
        while (
            time.monotonic() < self._answered_at + seconds
            and not self._node.intake.paused
            and any(self._services(topic) for topic, _ in self._asking)
        ):
            time.sleep(_POLL_PERIOD)
            self.poll()
        for topic, steps in self._asking:
            steps.close()
            self._node.get_logger().warning(f"{topic} lacks entries that no drill has returned")

    def _services(self, topic: str) -> set[str]:
        """Return the services of the topic's namespace that return journals.

        Names of nodes would not do: after a standstill the middleware may not know them again.
        """
        prefix = topic.rpartition("/")[0] + "/"
        services = self._node.get_service_names_and_types()
        return {name for name, types in services if _SERVICE in types and name.startswith(prefix)}

    def _find_gap(self, message: Message) -> None:
        topic = self._node.topics.get(message.topic)
        if topic is not None and topic.type == STATUS:
            self._status[f"{message.topic.rpartition('/')[0]}/journal"] = message.data
        if topic is None or topic.type != _JOURNAL:
            return
        with self._node.guard(f"an entry of {message.topic}"):
            entry = deserialize_message(message.data, topic.kind)
            before = self._latest.get(message.topic)
            seen = self._seen.setdefault(message.topic, {})
            if before is not None and entry.sequence <= before.sequence:
                if seen.get(int(entry.sequence)) == hash(message.data):
                    return  # it came late, or again, from another subscription
                before = None  # another start of the drill
                seen.clear()
            seen[int(entry.sequence)] = hash(message.data)
            self._latest[message.topic] = entry
            if entry.sequence > (before.sequence + 1 if before else 0):
                steps = self._ask(message.topic, before, entry, int(entry.sequence))
                self._asking.append((message.topic, steps))

    def _ask(
        self, topic: str, before: JournalEntry | None, after: JournalEntry | None, end: int
    ) -> Steps:
        """Ask the drills of a topic for what is missing between two entries, until one has it.

        ``end`` is the number of the second one, which may be missing, too.
        """
        from rpud_msgs.srv import GetJournal  # others are recorded without it

        node = self._node
        clients: dict[str, Client] = {}  # by the names of their services
        others = set[str]()  # services of another journal
        try:
            while True:
                for name in self._services(topic) - clients.keys():
                    clients[name] = node.create_client(GetJournal, name)
                for name in clients.keys() - others:
                    if clients[name].service_is_ready():
                        if (yield from self._fill(topic, clients[name], before, after, end)):
                            return
                        others.add(name)
                yield
        finally:
            for client in clients.values():
                node.destroy_client(client)

    def _fill(
        self,
        topic: str,
        client: Client,
        before: JournalEntry | None,
        after: JournalEntry | None,
        end: int,
    ) -> Generator[None, None, bool]:
        """Record what is missing between two entries; return False if it is another journal."""

        def page(first: int) -> Generator[None, None, list[tuple[JournalEntry, int]]]:
            kind: Any = client.srv_type
            response = yield from _response(self._node, client, kind, kind.Request(first=first))
            self._answered_at = time.monotonic()
            return list(zip(response.entries, response.publish_times, strict=True))

        first = 0
        if after is not None and [entry for entry, _ in (yield from page(end))[:1]] != [after]:
            return False
        if before is not None:
            # Another one if the drill has been started again, and its beginning did not come.
            found = [entry for entry, _ in (yield from page(int(before.sequence)))[:1]]
            if after is None and found != [before]:
                return False
            first = int(before.sequence) + 1 if found == [before] else 0
        missing = wanted = end - first
        while first < end:
            entries = [each for each in (yield from page(first)) if first <= each[0].sequence < end]
            if not entries:
                break
            for entry, published in entries:
                now = self._node.reception.now()
                message = Message(topic, now, int(published), serialize_message(entry))
                if not is_damaged(message.data, time.time_ns(), message.publish_time):
                    self._seen[topic][int(entry.sequence)] = hash(message.data)
                    self._node.intake.put(message, observed=False)
            missing -= len(entries)
            first = int(entries[-1][0].sequence) + 1
        logger = self._node.get_logger()
        logger.info(f"fetched {wanted - missing} missing entries of {topic} from the drill")
        if missing:
            logger.warning(f"the drill has dropped {missing} entries of {topic}")
        if before is not None:  # what came before the recorder is not lost
            gaps = self._node.topics[topic].gaps
            gaps.missing = max(0, gaps.missing - (wanted - missing))
        return True


def _response(
    node: Recorder, client: Client, kind: Any, request: Any
) -> Generator[None, None, Any]:
    """Send a request once the service is there, again where needed; return the response."""
    numbers = set[int]()
    due = -inf
    while True:
        if time.monotonic() >= due and client.service_is_ready():
            due = time.monotonic() + _REPETITION
            with client.handle:
                numbers.add(client.handle.send_request(request))
        with node.guard(f"an answer of {client.srv_name}"), client.handle:
            header, response = client.handle.take_response(kind.Response)
            if header is not None and header.request_id.sequence_number in numbers:
                return response
        yield


def _plain(value: Any) -> Any:
    return value if value is None or isinstance(value, bool | int | float | str) else list(value)
