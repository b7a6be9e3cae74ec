"""Query of recorded drills for their parameters and scenario, without waiting."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Generator, Mapping, Sequence
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile

from rpud_sim.bag.manifest import MANIFEST_RECORD, Manifest, installed_versions, machine_name
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.graph import UnknownTypeError, message_class, node_name
from rpud_sim.ros.record.recorder_node import Recorder

_STATUS = "rpud_msgs/msg/Status"
_ENTRY = "rpud_msgs/msg/JournalEntry"
_SCENARIO_LIMIT = 100_000  # characters
_JOURNAL = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class ParameterQuery:
    """Finds the drills of recorded topics, and records the manifest of each.

    A drill is a node that publishes a Status; a restarted one is queried again. Its scenario comes
    from its journal: no file is read, as a stranger could name any. The node needs no executor:
    ``poll`` reads the answers that have come. ``command`` is the command line of the recorder.
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
    """Ask a drill for its parameters and its scenario, and keep them as fields of a manifest."""
    listed = yield from _answer(node, name, ListParameters, "list_parameters")
    names = list(listed.result.names)
    response = yield from _answer(node, name, GetParameters, "get_parameters", names=names)
    with node.guard(f"an answer of {name}"):
        values = map(_plain, map(parameter_value_to_python, response.values))
        found["parameters"] = dict(zip(names, values, strict=False))
    if not found.get("parameters", {}).get("scenario"):
        found["scenario"] = ""
        return
    topic = f"{name.rpartition('/')[0]}/journal"
    try:
        kind = message_class(_ENTRY)
    except UnknownTypeError:
        return
    while not node.count_publishers(topic):  # a subscription alone would create the topic
        yield
    journal = node.create_subscription(kind, topic, lambda _: None, _JOURNAL)
    try:
        while found["scenario"] is None:
            yield
            with node.guard(f"an answer of {name}"), journal.handle:
                while (taken := journal.handle.take_message(kind, False)) is not None:
                    entry, _ = taken
                    if entry.kind == "begin" and len(entry.content) < _SCENARIO_LIMIT:
                        found["scenario"] = scenario_text(entry.content)
    finally:
        node.destroy_subscription(journal)


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


def scenario_text(content: str) -> str:
    """Return the scenario of a journal's entry ``begin`` as the text of a file, all faults drawn.

    The text is one JSON object, which YAML reads too; it is empty if no fault was planned. Other
    content raises a ValueError.
    """
    try:
        faults = [_planned(entry) for entry in json.loads(content)["faults"]]
    except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise ValueError(f"no beginning of a journal: {error!r:.100}") from None
    return json.dumps({"faults": faults}, indent=1) + "\n" if faults else ""


def _planned(entry: Mapping[str, Any]) -> dict[str, Any]:
    onset, clear = entry["onset"], entry["clear"]
    planned: dict[str, Any] = {"kind": str(entry["kind"]), "onset": int(onset) / SECOND}
    if entry["channel"]:
        planned["channel"] = str(entry["channel"])
    if clear is not None:
        planned["duration"] = (int(clear) - int(onset)) / SECOND
    if math.isfinite(entry["magnitude"]):
        planned["magnitude"] = float(entry["magnitude"])
    return planned


def _plain(value: Any) -> Any:
    return value if value is None or isinstance(value, bool | int | float | str) else list(value)
