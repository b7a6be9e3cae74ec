"""Services of the recorder: of rosbag2's types if these are installed, else of others."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from std_srvs.srv import Trigger

from rpud_sim.bag import BagWriter
from rpud_sim.ros.record.recorder_node import Recorder


class RecorderServices:
    """Services that pause, resume and split a recording.

    They are ``~/pause``, ``~/resume``, ``~/toggle_paused``, ``~/is_paused`` and
    ``~/split_bagfile``, of the types of rosbag2_interfaces, else std_srvs/Trigger and
    rpud_msgs/IsPaused. The node needs no executor: ``serve`` does waiting requests.
    """

    def __init__(self, node: Recorder) -> None:
        self._node = node
        intake = node.intake

        def toggle() -> str:
            return resume() if intake.paused else pause()

        def pause() -> str:
            intake.pause()
            return "paused"

        def resume() -> str:
            intake.resume()
            return "resumed"

        def split() -> str:
            intake.do(BagWriter.split)
            return "goes on in a new file"

        self._services = [
            # ``serve`` takes the requests, so nothing ever calls the callback.
            (kind, node.create_service(kind, f"~/{name}", lambda _, response: response), action)
            for name, action in (
                ("pause", pause),
                ("resume", resume),
                ("is_paused", lambda: ""),
                ("toggle_paused", toggle),
                ("split_bagfile", split),
            )
            if (kind := service_type(name)) is not None
        ]

    def serve(self) -> None:
        """Do what was asked for, and answer."""
        for kind, server, action in self._services:
            with self._node.guard("a request"):
                self._serve(kind, server, action)

    def _serve(self, kind: Any, server: Any, action: Callable[[], str]) -> None:
        with server.handle:
            request, header = server.handle.service_take_request(kind.Request)
        if request is None or header is None:
            return
        self._node.receive_all()
        if text := action():
            self._node.get_logger().info(text)
        response = kind.Response()
        answers = {"success": True, "message": text, "paused": self._node.intake.paused}
        for field, value in answers.items():
            if hasattr(response, field):
                setattr(response, field, value)
        server.send_response(response, header)


def service_type(name: str) -> Any:
    """Return the type of a rosbag2 service, or its substitute; None if neither is installed."""
    for package in ("rosbag2_interfaces", "rpud_msgs"):
        with suppress(ImportError, AttributeError):
            return getattr(importlib.import_module(f"{package}.srv"), name.title().replace("_", ""))
    return None if name == "is_paused" else Trigger
