"""Query of recorded drills for their parameters and scenario, without waiting."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile

from rpud_sim.bag.manifest import Manifest, installed_versions, machine_name
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.graph import UnknownTypeError, message_class, node_name
from rpud_sim.ros.record.recorder_node import Recorder

_STATUS = "rpud_msgs/msg/Status"
_ENTRY = "rpud_msgs/msg/JournalEntry"
_SCENARIO_LIMIT = 100_000  # characters
_JOURNAL = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class ParameterQuery:
    """Finds the drills of recorded topics, and makes the manifest of each.

    A drill is a node that publishes a Status; a restarted one is queried again. Its scenario comes
    from its journal: no file is read, as a stranger could name any. The node needs no executor:
    ``poll`` reads the answers that have come. ``command`` is the command line of the recorder.
    """

    def __init__(self, node: Recorder, command: Sequence[str]) -> None:
        self._node = node
        self._command = tuple(command)
        self._known: set[tuple[int, ...]] = set()  # publishers of a status
        self._asked: list[_AskedDrill] = []

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
                    self._asked.append(_AskedDrill(self._node, name))

    def poll(self) -> list[Manifest]:
        """Return the manifests of the drills that have answered since the last call."""
        answered = []
        for drill in self._asked:
            with self._node.guard(f"an answer of {drill.name}"):
                if next(drill.steps, True):
                    answered.append(drill)
        for drill in answered:
            self._asked.remove(drill)
            self._node.get_logger().info(f"knows the parameters of {drill.name}")
        return [self._manifest(drill) for drill in answered]

    def finish(self) -> list[Manifest]:
        """Return the manifests of drills without an answer; without any drill, an empty one."""
        silent = [self._manifest(drill) for drill in self._asked]
        for drill in self._asked:
            drill.steps.close()
        self._asked.clear()
        return silent if self._known else [self._manifest(None)]

    def _manifest(self, drill: _AskedDrill | None) -> Manifest:
        return Manifest(
            node=drill.name if drill else "",
            time=time.time_ns(),
            parameters=(drill.parameters if drill else None) or {},
            scenario=drill.scenario if drill else "",
            command=self._command,
            versions=installed_versions(),
            machine=machine_name(),
        )


class _AskedDrill:
    """Drill that is asked for its parameters and its scenario."""

    def __init__(self, node: Recorder, name: str) -> None:
        self.name = name
        self.parameters: dict[str, Any] | None = None  # None until they are known
        self.scenario: str | None = None  # empty if it has none, None if it is unknown
        self._node = node
        self.steps = self._ask()  # yields False until all is answered

    def _ask(self) -> Generator[bool, None, None]:
        listed = yield from self._answer(ListParameters, "list_parameters")
        names = list(listed.result.names)
        response = yield from self._answer(GetParameters, "get_parameters", names=names)
        self.parameters, self.scenario = {}, ""
        with self._guard():
            values = map(_plain, map(parameter_value_to_python, response.values))
            self.parameters = dict(zip(names, values, strict=False))
        if self.parameters.get("scenario"):
            self.scenario = None
            yield from self._read_journal()

    def _answer(self, kind: Any, name: str, **fields: Any) -> Generator[bool, None, Any]:
        """Send a request once the service is there; return the response once it has come."""
        client = self._node.create_client(kind, f"{self.name}/{name}")
        try:
            while not client.service_is_ready():
                yield False
            with client.handle:
                client.handle.send_request(kind.Request(**fields))
            while True:
                with self._guard(), client.handle:
                    header, response = client.handle.take_response(kind.Response)
                    if header is not None:
                        return response
                yield False
        finally:
            self._node.destroy_client(client)

    def _read_journal(self) -> Generator[bool, None, None]:
        topic = f"{self.name.rpartition('/')[0]}/journal"
        try:
            kind = message_class(_ENTRY)
        except UnknownTypeError:
            return
        while not self._node.count_publishers(topic):  # a subscription alone would create the topic
            yield False
        journal = self._node.create_subscription(kind, topic, lambda _: None, _JOURNAL)
        try:
            while self.scenario is None:
                yield False
                with self._guard(), journal.handle:
                    while (taken := journal.handle.take_message(kind, False)) is not None:
                        entry, _ = taken
                        if entry.kind == "begin" and len(entry.content) < _SCENARIO_LIMIT:
                            self.scenario = scenario_text(entry.content)
        finally:
            self._node.destroy_subscription(journal)

    def _guard(self) -> AbstractContextManager[None]:
        return self._node.guard(f"an answer of {self.name}")


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
