"""Services of the recorder: of rosbag2's types if these are installed, else of others."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from rpud_sim.ros.record.intake import Intake
from rpud_sim.ros.record.network_guard import NetworkGuard


class RecorderServices:
    """Services that pause, resume and split a recording.

    Services: ``~/pause``, ``~/resume``, ``~/toggle_paused``, ``~/is_paused``, ``~/split_bagfile``,
    of the types of rosbag2_interfaces, else std_srvs/Trigger and
    rpud_msgs/IsPaused. The node needs no executor: ``serve`` does waiting requests.

    Args:
        node: that owns them.
        intake: that they act on.
        catch_up: hands the intake all that was received before a request.
    """

    def __init__(
        self, node: Node, guard: NetworkGuard, intake: Intake, catch_up: Callable[[], None]
    ) -> None:
        self._node = node
        self._guard = guard
        self._catch_up = catch_up
        self._intake = intake
        actions: dict[str, Callable[[], tuple[bool, str]]] = {
            "Pause": self._pause,
            "Resume": self._resume,
            "IsPaused": lambda: (True, ""),
            "TogglePaused": lambda: self._resume() if intake.paused else self._pause(),
            "SplitBagfile": self._split,
        }
        self._services = []
        for kind, action in actions.items():
            service = service_type(kind)
            if service is None:
                continue
            name = "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in kind)
            # ``serve`` takes the requests, so nothing ever calls the callback.
            handle = node.create_service(service, f"~/{name[1:]}", lambda _, response: response)
            self._services.append((service, handle, action))

    def serve(self) -> None:
        """Do what was asked for, and answer."""
        for service, server, action in self._services:
            with self._guard("a request"):
                self._serve(service, server, action)

    def _serve(self, service: Any, server: Any, action: Callable[[], tuple[bool, str]]) -> None:
        with server.handle:
            request, header = server.handle.service_take_request(service.Request)
        if request is None or header is None:
            return
        self._catch_up()
        success, text = action()
        if text:
            self._node.get_logger().info(text)
        response = service.Response()
        answers = {"success": success, "message": text, "paused": self._intake.paused}
        for field, value in answers.items():
            if hasattr(response, field):
                setattr(response, field, value)
        server.send_response(response, header)

    def _pause(self) -> tuple[bool, str]:
        self._intake.pause()
        return True, "paused"

    def _resume(self) -> tuple[bool, str]:
        self._intake.resume()
        return True, "resumed"

    def _split(self) -> tuple[bool, str]:
        self._intake.split()
        return True, "goes on in a new file"


def service_type(kind: str) -> Any:
    """Return the type of a rosbag2 service, or its substitute; None if neither is installed."""
    for package in ("rosbag2_interfaces", "rpud_msgs"):
        with suppress(ImportError, AttributeError):
            return getattr(importlib.import_module(f"{package}.srv"), kind)
    return None if kind == "IsPaused" else Trigger
