"""Drill node in the process of another program, such as ``rpud run``."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from typing import Any

import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.logging import get_logger
from rclpy.parameter import Parameter
from rclpy.validate_namespace import validate_namespace

from rpud_sim.ros.drill.drill_node import NAME, DrillNode
from rpud_sim.ros.drill.namesakes import NamesakeSearch
from rpud_sim.ros.starting import name_error, start_ros
from rpud_sim.ros.stopping import StopRequest
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.rerun import Start

_DISCOVERY_TIME = 5.0  # that the middleware may take to connect a recorder's subscriptions [s]


class NamesakeError(RuntimeError):
    """Drill of the same name that runs already; the message is one line."""


@contextmanager
def open_drill(
    values: Mapping[str, Any],
    namespace: str,
    duration: float | None = None,
    *,
    allow_duplicate: bool = False,
    start: Start | None = None,
) -> Iterator[DrillNode]:
    """Start ROS and a drill node in this process, neither configured nor active; shut both down.

    ``values`` are parameters by name. After ``duration`` in simulation time [s] it has finished;
    None for never. With ``allow_duplicate`` it drills beside a drill of the same name, which is a
    NamesakeError otherwise. ``start`` is a state to begin in, whose settings are ``values``; None
    for time zero.
    """
    settings = to_settings(values)
    try:
        validate_namespace(f"/{namespace.removeprefix('/')}")
    except InvalidNamespaceException as error:
        raise name_error(error) from error
    start_ros()
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        if not allow_duplicate:
            search = stack.enter_context(closing(NamesakeSearch(NAME, namespace)))
            # Meanwhile, so that the search costs no time.
            compile_kernels(settings.configuration.parameters, get_logger(NAME).info)
            if search.finish():
                raise NamesakeError(
                    f"a drill named {search.name} runs already: choose another --namespace, "
                    "or give --allow-duplicate"
                )
        overrides = [
            Parameter(name, value=float(value) if _is_whole(value) else value)
            for name, value in values.items()
        ]
        yield DrillNode(duration, start, namespace=namespace, parameter_overrides=overrides)


def await_recorder(node: DrillNode, stop: StopRequest) -> None:
    """Wait until every topic of the drill has a subscriber; log the topics that have none."""
    end = time.monotonic() + _DISCOVERY_TIME
    while node.unheard and time.monotonic() < end and not stop.wait(0.01):
        pass
    if node.unheard and not stop.requested:
        node.get_logger().warning(f"not heard by the recorder: {', '.join(node.unheard)}")


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
