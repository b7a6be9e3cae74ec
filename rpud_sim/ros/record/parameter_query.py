"""Query of recorded drills for their parameters, without waiting."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping, Sequence
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python

from rpud_sim.bag.metadata import MANIFEST_RECORD, Manifest, installed_versions, machine_name
from rpud_sim.ros.graph import node_name
from rpud_sim.ros.record.recorder_node import Recorder

_STATUS = "rpud_msgs/msg/Status"


class ParameterQuery:
    """Finds the drills of recorded topics, and records the manifest of each.

    A drill is a node that publishes a Status; a restarted one is queried again. The text of its
    scenario stays unknown: no file is read, as a stranger could name any, and its journal has the
    faults. The node needs no executor: ``poll`` reads the answers that have come. ``command`` is
    the command line of the recorder.
    """

    def __init__(self, node: Recorder, command: Sequence[str]) -> None:
        self._node = node
        self._command = tuple(command)
        self._known: set[tuple[int, ...]] = set()  # publishers of a status
        # What is known of drills that are asked, and the steps of asking them.
        self._asked: list[tuple[dict[str, Any], Generator[None, None, None]]] = []

    def discover(self) -> None:
        """Find new drills, and begin to ask them."""
        for topic, types in self._node.get_topic_names_and_types():
            if _STATUS not in types or not self._node.wants_drill(topic):
                continue
            for endpoint in self._node.get_publishers_info_by_topic(topic):
                publisher = tuple(endpoint.endpoint_gid)
                # Discovery finds a publisher before its node.
                if publisher not in self._known and (name := node_name(endpoint)):
                    self._known.add(publisher)
                    found = {"node": name, "scenario": None}
                    self._asked.append((found, _ask(self._node, name, found)))

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


def _ask(node: Recorder, name: str, found: dict[str, Any]) -> Generator[None, None, None]:
    """Ask a drill for its parameters, and keep them as fields of a manifest."""
    listed = yield from _answer(node, name, ListParameters, "list_parameters")
    names = list(listed.result.names)
    response = yield from _answer(node, name, GetParameters, "get_parameters", names=names)
    with node.guard(f"an answer of {name}"):
        values = map(_plain, map(parameter_value_to_python, response.values))
        found["parameters"] = dict(zip(names, values, strict=False))
        found["scenario"] = None if found["parameters"].get("scenario") else ""


def _answer(
    node: Recorder, drill: str, kind: Any, name: str, **fields: Any
) -> Generator[None, None, Any]:
    """Send a request once the service is there; return the response once it has come."""
    client = node.create_client(kind, f"{drill}/{name}")
    try:
        while not client.service_is_ready():
            yield
        with client.handle:
            client.handle.send_request(kind.Request(**fields))
        while True:
            with node.guard(f"an answer of {drill}"), client.handle:
                header, response = client.handle.take_response(kind.Response)
                if header is not None:
                    return response
            yield
    finally:
        node.destroy_client(client)


def _plain(value: Any) -> Any:
    return value if value is None or isinstance(value, bool | int | float | str) else list(value)
