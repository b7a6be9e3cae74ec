"""ROS graph: message types by name, names of nodes, and who has discovered whom."""

from __future__ import annotations

import importlib
import os
import re
import time
from collections.abc import Mapping
from contextlib import suppress
from math import inf
from pathlib import Path
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.type_support import check_for_type_support

from rpud_sim.foundation.quantities import (
    ExpectedError,
    ParameterError,
    did_you_mean,
    short_repr,
)
from rpud_sim.messages.encoder import CODES, Members
from rpud_sim.messages.encoder import Sequence as SequenceOf

CLOCK = "/clock"
STATUS = "rpud_msgs/msg/Status"  # type of the topic that only drills publish

_TYPE_NAME = re.compile(r"([A-Za-z]\w*)/([a-z]+)/([A-Za-z]\w*)")
_ARRAY = re.compile(r"sequence<(.+?)(?:, *\d+)?>|(.+)\[\d+\]")
_UNKNOWN = "_NODE_NAME_UNKNOWN_"  # as rcl calls it
_STANDING = "TtZX"  # states of a process that does nothing: stopped, or ended
_REPETITION = 0.05  # of a probe's request [s]


class UnknownTypeError(ExpectedError):
    """Message type that is not installed."""


def resolve_topic(node: Node, name: Any) -> str:
    """Return the absolute name of a topic; one that ROS does not allow is a ParameterError."""
    try:
        return str(node.resolve_topic_name(name))
    except TypeError:
        reason = "it is not UTF-8" if isinstance(name, str) else "it is not a text"
    except RuntimeError as error:  # RCLError: "failed to resolve name: REASON, at FILE:LINE"
        reason = str(error).partition(": ")[2].rpartition(", at ")[0]
    raise ParameterError(f"topic = {short_repr(name)} is not allowed: {reason}")


def message_class(type_name: str) -> Any:
    """Import the class of a message type such as ``std_msgs/msg/String``."""
    match = _TYPE_NAME.fullmatch(type_name)
    if match is None:
        raise UnknownTypeError(f"type {type_name!r} is not of the form package/msg/Name")
    package, kind, name = match.groups()
    try:
        module = importlib.import_module(f"{package}.{kind}")
        if (message := getattr(module, name, None)) is not None:
            check_for_type_support(message)
            return message
        hint = did_you_mean(name, [each for each in vars(module) if each[0].isupper()])
        reason = f"{package} has no {kind} of this name{hint}"
    except ModuleNotFoundError:
        reason = f"there is no {package}.{kind} in this environment"
    except Exception as error:  # a foreign package may raise anything while it is loaded
        reason = " ".join(str(error).split())
    raise UnknownTypeError(f"type {type_name} is not installed here: {reason}")


def type_name(message: Any) -> str:
    """Return the type of a message class, such as ``std_msgs/msg/String``."""
    package, kind, *_ = message.__module__.split(".")
    return f"{package}/{kind}/{message.__name__}"


def members_of(message: Any) -> Members:
    """Return the members of a message class for an encoder, or raise an UnknownTypeError."""
    members = message.get_fields_and_field_types().items()
    return Members(tuple((name, _member(described)) for name, described in members))


def _member(described: str) -> Any:
    if described in CODES:
        return CODES[described]
    if (element := element_of(described)) and described == f"sequence<{element}>":
        return SequenceOf(_member(element))
    return members_of(member_class(described))


def element_of(described: str) -> str:
    """Return the type of the elements of a field of this type; empty if it is not an array."""
    match = _ARRAY.fullmatch(described)
    return "" if match is None else match[1] or match[2]


def member_class(described: str) -> Any:
    """Import the class of a field of this type, such as ``std_msgs/String``."""
    return message_class(described.replace("/", "/msg/"))


def filled(message: Any, values: Mapping[str, Any]) -> Any:
    """Set the fields of a message and of the messages in it, and return it."""
    for name, value in values.items():
        if isinstance(value, dict):
            filled(getattr(message, name), value)
            continue
        if isinstance(value, list) and value and isinstance(value[0], dict):
            kind = member_class(element_of(message.get_fields_and_field_types()[name]))
            value = [filled(kind(), each) for each in value]
        setattr(message, name, value)
    return message


def node_name(endpoint: TopicEndpointInfo) -> str:
    """Return the full name of an endpoint's node; empty where that is not discovered yet."""
    name = endpoint.node_name
    return "" if name == _UNKNOWN else f"{endpoint.node_namespace.rstrip('/')}/{name}"


def has_lost_subscriber(node: Node, topic: str) -> bool:
    """Return whether a process on this machine that subscribes to a topic has ended, or is stopped.

    The middleware remembers one that was killed for up to 20 s. Fast DDS begins identifiers with
    vendor and machine, and continues with the lower half of the process's number. A process in
    another container beside this one cannot be seen, and counts as ended.
    """
    own = os.getpid().to_bytes(8, "little")[:2]
    offers = [bytes(e.endpoint_gid) for e in node.get_publishers_info_by_topic(topic)]
    machines = {gid[:4] for gid in offers if gid[4:6] == own}
    requests = [bytes(e.endpoint_gid) for e in node.get_subscriptions_info_by_topic(topic)]
    running = set[bytes]()
    for entry in Path("/proc").glob("[0-9]*/status"):
        with suppress(OSError, LookupError):  # it has just ended
            lines = entry.read_text().split("\n")
            values = {
                name: rest.split() for name, _, rest in (line.partition(":") for line in lines)
            }
            if values["State"][0] not in _STANDING:
                # A process in a container has a number there, too.
                running.update(int(n).to_bytes(8, "little")[:2] for n in values["NSpid"])
    return any(gid[:4] in machines and gid[4:6] not in running for gid in requests)


class ClockSources:
    """Publishers of ``/clock``; it warns where there are several, between whose times it jumps."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._count = 1

    def look(self) -> None:
        """Warn if there are more than at the last look."""
        names = [node_name(e) or "?" for e in self._node.get_publishers_info_by_topic(CLOCK)]
        if len(names) > max(1, self._count):
            self._node.get_logger().warning(
                f"{CLOCK} has {len(names)} publishers, {' and '.join(sorted(names))}: time jumps "
                "between theirs; stop all but one"
            )
        self._count = len(names)


class RepeatedRequest:
    """Request that is sent again after each period [s], as its response may be dropped."""

    def __init__(self, client: Client, request: Any, period: float) -> None:
        self._client = client
        self._request = request
        self._period = period
        self._futures: list[Future] = []
        self._sent = -inf

    def answered(self) -> Future | None:
        """Return a future with the response; None before it, and to be called again then."""
        for future in self._futures:
            if future.done():
                return future
        now = time.monotonic()
        if not self._futures or now - self._sent > self._period:
            self._futures.append(self._client.call_async(self._request))
            self._sent = now
        return None

    def close(self) -> None:
        for future in self._futures:
            self._client.remove_pending_request(future)


class DiscoveryProbe:
    """Request to a node, by a client that is made after the subscriptions.

    Discovery announces the readers of a process in order: a node that has answered knows them all.
    """

    def __init__(self, node: Node, name: str) -> None:
        self._node = node
        self._client: Client | None = node.create_client(GetParameters, f"{name}/get_parameters")
        self._request = RepeatedRequest(self._client, GetParameters.Request(), _REPETITION)

    def answered(self) -> bool:
        """Return whether the node has answered; to be called again until it has."""
        # The middleware may not call the service ready while it remembers one that has ended.
        if self._client is not None and self._request.answered():
            self.close()
        return self._client is None

    def close(self) -> None:
        if self._client is not None:
            self._node.destroy_client(self._client)
            self._client = None
