"""Inquiry into recorded drills: their parameters and scenario, without waiting."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

from rpud_sim.bag.manifest import Manifest, installed_versions, machine_name
from rpud_sim.ros.record.journal_scenario import scenario_text
from rpud_sim.ros.record.network_guard import NetworkGuard
from rpud_sim.ros.types import UnknownTypeError, message_class

_STATUS = "rpud_msgs/msg/Status"
_ENTRY = "rpud_msgs/msg/JournalEntry"
_SCENARIO_LIMIT = 100_000  # characters
_JOURNAL = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class DrillInquiry:
    """Finds the drills of recorded topics, and makes the manifest of each.

    A drill is a node that publishes a Status; a restarted one is queried again. Its scenario comes
    from its journal: no file is read, as a stranger could name any. The node needs no executor:
    ``poll`` reads the answers that have come. ``wants`` says whether the drill that publishes on a
    topic belongs to the recording. ``command`` is the command line of the recorder.
    """

    def __init__(
        self,
        node: Node,
        guard: NetworkGuard,
        wants: Callable[[str], bool],
        command: Sequence[str],
    ) -> None:
        self._node = node
        self._guard = guard
        self._wants = wants
        self._command = tuple(command)
        self._known: set[tuple[int, ...]] = set()  # publishers of a status
        self._questions: list[_Questions] = []

    def discover(self) -> None:
        """Find new drills, and begin to ask them."""
        for topic, types in self._node.get_topic_names_and_types():
            if _STATUS not in types or not self._wants(topic):
                continue
            for endpoint in self._node.get_publishers_info_by_topic(topic):
                publisher = tuple(endpoint.endpoint_gid)
                # Discovery finds a publisher before its node.
                if publisher in self._known or endpoint.node_name.startswith("_NODE_NAME_UNKNOWN"):
                    continue
                self._known.add(publisher)
                name = f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
                self._questions.append(_Questions(self._node, name))

    def poll(self) -> list[Manifest]:
        """Return the manifests of the drills that have answered since the last call."""
        answered = []
        for questions in self._questions:
            with self._guard(f"an answer of {questions.name}"):
                if questions.poll():
                    answered.append(questions)
        for questions in answered:
            self._questions.remove(questions)
            self._node.get_logger().info(f"knows the parameters of {questions.name}")
        return [self._manifest(questions) for questions in answered]

    def finish(self) -> list[Manifest]:
        """Return the manifests of drills without an answer; without any drill, an empty one."""
        silent = [self._manifest(questions) for questions in self._questions]
        for questions in self._questions:
            questions.close()
        self._questions.clear()
        return silent if self._known else [self._manifest(None)]

    def _manifest(self, questions: _Questions | None) -> Manifest:
        parameters = (questions.parameters if questions else None) or {}
        return Manifest(
            node=questions.name if questions else "",
            time=time.time_ns(),
            parameters=parameters,
            scenario=questions.scenario if questions else "",
            command=self._command,
            versions=installed_versions(),
            machine=machine_name(),
        )


@dataclass
class _Question:
    client: Client
    service: Any
    request: Any
    number: int | None = None  # of the request, None until it is sent

    def poll(self) -> Any:
        """Send the request once the service is there; return the response once it has come."""
        if self.number is None:
            if self.client.service_is_ready():
                with self.client.handle:
                    self.number = self.client.handle.send_request(self.request)
            return None
        with self.client.handle:
            header, response = self.client.handle.take_response(self.service.Response)
        return None if header is None else response


class _Questions:
    def __init__(self, node: Node, name: str) -> None:
        self.name = name
        self.parameters: dict[str, Any] | None = None
        self._node = node
        self._names: list[str] | None = None
        self._question: _Question | None = self._ask(
            ListParameters, "list_parameters", ListParameters.Request()
        )
        self._begun: str | None = None  # scenario of the journal's latest beginning
        self._journal: Subscription | None = None
        self._entry: Any = None  # type of its messages, if installed
        with suppress(UnknownTypeError):
            self._entry = message_class(_ENTRY)

    @property
    def scenario(self) -> str | None:
        """Scenario of the drill: empty if it has none, None if it is unknown."""
        if self.parameters is not None and not self.parameters.get("scenario"):
            return ""
        return self._begun

    def poll(self) -> bool:
        """Go on; return whether all is answered. After an invalid answer no query follows."""
        response = self._question.poll() if self._question else None
        if response is not None:
            self._stop_asking()
            if self._names is None:
                self._names = list(response.result.names)
                request = GetParameters.Request(names=self._names)
                self._question = self._ask(GetParameters, "get_parameters", request)
            else:
                self.parameters = {}
                values = map(parameter_value_to_python, response.values)
                self.parameters = dict(zip(self._names, map(_plain, values), strict=False))
        if self.parameters is None:
            return False
        if self.parameters.get("scenario"):
            self._read_journal()
            if self._begun is None and self._entry is not None:
                return False
        self.close()
        return True

    def close(self) -> None:
        self._stop_asking()
        if self._journal is not None:
            self._node.destroy_subscription(self._journal)

    def _stop_asking(self) -> None:
        if self._question is not None:
            self._node.destroy_client(self._question.client)
            self._question = None

    def _read_journal(self) -> None:
        if self._journal is None:
            topic = f"{self.name.rpartition('/')[0]}/journal"
            # A subscription alone would create the topic.
            if self._entry is None or not self._node.count_publishers(topic):
                return
            self._journal = self._node.create_subscription(
                self._entry, topic, lambda _: None, _JOURNAL
            )
        journal = self._journal.handle
        with journal:
            while (taken := journal.take_message(self._entry, False)) is not None:
                entry, _ = taken
                if entry.kind == "begin" and len(entry.content) < _SCENARIO_LIMIT:
                    self._begun = scenario_text(entry.content)

    def _ask(self, service: Any, kind: str, request: Any) -> _Question:
        client = self._node.create_client(service, f"{self.name}/{kind}")
        return _Question(client, service, request)


def _plain(value: Any) -> Any:
    return value if value is None or isinstance(value, bool | int | float | str) else list(value)
