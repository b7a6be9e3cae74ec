"""Asks drills for their parameters while their topics are recorded, and waits for nobody."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from rpud_sim.bag.manifest import Manifest, installed_versions, machine_name

_STATUS = "rpud_msgs/msg/Status"
_SCENARIO_LIMIT = 100_000  # bytes


class DrillInquiry:
    """Finds the drills of recorded topics, and makes the manifest of each.

    A drill is a node that publishes a Status; one that is started anew is asked again. The node
    that asks needs no executor: `poll` takes the answers that have come.

    Args:
        node: which asks.
        wants: whether the drill that publishes on a topic belongs to the recording.
        command: command line of the recorder.
    """

    def __init__(self, node: Node, wants: Callable[[str], bool], command: Sequence[str]) -> None:
        self._node = node
        self._wants = wants
        self._command = tuple(command)
        self._known: set[tuple[int, ...]] = set()  # publishers of a status
        self._questions: list[_Questions] = []

    def look(self) -> None:
        """Find drills that have appeared, and begin to ask them."""
        for topic, types in self._node.get_topic_names_and_types():
            if _STATUS not in types or not self._wants(topic):
                continue
            for endpoint in self._node.get_publishers_info_by_topic(topic):
                publisher = tuple(endpoint.endpoint_gid)
                # Discovery tells of a publisher before it tells of its node.
                if publisher in self._known or endpoint.node_name.startswith("_NODE_NAME_UNKNOWN"):
                    continue
                self._known.add(publisher)
                name = f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
                self._questions.append(_Questions(self._node, name))

    def poll(self) -> list[Manifest]:
        """Give the manifests of the drills that have answered since the last call."""
        answered = [questions for questions in self._questions if questions.poll()]
        for questions in answered:
            self._questions.remove(questions)
            self._node.get_logger().info(f"knows the parameters of {questions.name}")
        return [self._manifest(questions) for questions in answered]

    def finish(self) -> list[Manifest]:
        """Give the manifests of the drills that did not answer; one without a drill if none did."""
        silent = [self._manifest(questions) for questions in self._questions]
        for questions in self._questions:
            questions.close()
        self._questions.clear()
        return silent if self._known else [self._manifest(None)]

    def _manifest(self, questions: _Questions | None) -> Manifest:
        parameters = questions.parameters if questions else {}
        return Manifest(
            node=questions.name if questions else "",
            time=time.time_ns(),
            parameters=parameters,
            scenario=_text_of(parameters.get("scenario")),
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
        """Send the request as soon as somebody is there; give the response when it has come."""
        if self.number is None:
            if self.client.service_is_ready():
                with self.client.handle:
                    self.number = self.client.handle.send_request(self.request)
            return None
        with self.client.handle:
            header, response = self.client.handle.take_response(self.service.Response)
        return None if header is None else response


class _Questions:
    """Which parameters a node has, and then their values."""

    def __init__(self, node: Node, name: str) -> None:
        self.name = name
        self.parameters: dict[str, Any] = {}
        self._node = node
        self._names: list[str] | None = None
        self._question = self._ask(ListParameters, "list_parameters", ListParameters.Request())

    def poll(self) -> bool:
        """Go on; tell whether all is answered."""
        response = self._question.poll()
        if response is None:
            return False
        self.close()
        if self._names is None:
            self._names = list(response.result.names)
            request = GetParameters.Request(names=self._names)
            self._question = self._ask(GetParameters, "get_parameters", request)
            return False
        values = map(parameter_value_to_python, response.values)
        self.parameters = dict(zip(self._names, map(_plain, values), strict=False))
        return True

    def close(self) -> None:
        """Stop asking."""
        self._node.destroy_client(self._question.client)

    def _ask(self, service: Any, kind: str, request: Any) -> _Question:
        client = self._node.create_client(service, f"{self.name}/{kind}")
        return _Question(client, service, request)


def _plain(value: Any) -> Any:
    """Give an array as the list that JSON has for it."""
    return value if value is None or isinstance(value, bool | int | float | str) else list(value)


def _text_of(path: Any) -> str | None:
    if not path:
        return ""
    file = Path(str(path))
    try:
        if not file.is_file() or file.stat().st_size > _SCENARIO_LIMIT:
            return None
        return file.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None
