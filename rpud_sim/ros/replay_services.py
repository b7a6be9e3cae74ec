"""Services that control a replay, those of `ros2 bag play` where its interfaces are installed."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from types import ModuleType
from typing import Any

from rclpy.node import Node
from rpud_msgs import srv as own
from std_srvs.srv import Trigger

from rpud_sim.ros.playback import NANOSECONDS, Playback, RefusedError
from rpud_sim.ros.playback_thread import PlaybackThread
from rpud_sim.ros.requests import StoppedError


class ReplayServices:
    """`~/pause`, `resume`, `toggle_paused`, `is_paused`, `get_rate`, `set_rate`, `seek`,
    `play_next`, `burst`, `stop` and `play`, with names and meanings of `ros2 bag play`.

    Where the package rosbag2_interfaces is installed the types are its own. Elsewhere they are
    std_srvs/Trigger and those of rpud_msgs, which also say why something is refused, and there is
    no `play`: it begins a replay that has ended, which ends this program.
    """

    def __init__(self, node: Node, thread: PlaybackThread) -> None:
        self._thread = thread
        self._logger = node.get_logger()
        handlers: dict[str, Callable[[Any], dict[str, Any]]] = {
            "pause": lambda request: self._do(Playback.pause),
            "resume": lambda request: self._do(Playback.resume),
            "toggle_paused": lambda request: self._do(Playback.toggle_paused),
            "is_paused": lambda request: {"paused": thread.do(lambda playback: playback.paused)},
            "get_rate": lambda request: {"rate": thread.do(lambda playback: playback.rate)},
            "set_rate": lambda request: self._do(lambda playback: playback.set_rate(request.rate)),
            "seek": lambda request: self._do(lambda playback: playback.seek(_stamp(request.time))),
            "play_next": lambda request: self._do(Playback.play_next),
            "burst": self._burst,
            "stop": lambda request: self._do(Playback.stop),
            "play": self._play,
        }
        types = _types(list(handlers))
        for name, kind in types.items():
            node.create_service(kind, f"~/{name}", self._answering(name, handlers[name]))

    def _answering(
        self, name: str, handler: Callable[[Any], dict[str, Any]]
    ) -> Callable[[Any, Any], Any]:
        def answer(request: Any, response: Any) -> Any:
            try:
                fields = {"success": True, **handler(request)}
            except (RefusedError, StoppedError) as error:
                reason = "the replay has ended" if isinstance(error, StoppedError) else str(error)
                self._logger.warning(f"{name} is refused: {reason}")
                fields = {"success": False, "message": reason}
            for field, value in fields.items():
                if hasattr(response, field):  # not every type has all of them
                    setattr(response, field, value)
            return response

        return answer

    def _do(self, action: Callable[[Playback], None]) -> dict[str, Any]:
        self._thread.do(action)
        return {}

    def _burst(self, request: Any) -> dict[str, Any]:
        count = int(request.num_messages)
        return {"actually_burst": self._thread.do(lambda playback: playback.burst(count))}

    def _play(self, request: Any) -> dict[str, Any]:
        raise RefusedError("the replay has begun")


def _types(names: list[str]) -> dict[str, Any]:
    try:
        rosbag2: ModuleType = importlib.import_module("rosbag2_interfaces.srv")
    except ImportError:
        return {
            name: getattr(own, _type_name(name), Trigger) for name in names if name != "play"
        }
    return {name: getattr(rosbag2, _type_name(name)) for name in names}


def _type_name(name: str) -> str:
    return name.title().replace("_", "")


def _stamp(time: Any) -> int:
    return int(time.sec) * NANOSECONDS + int(time.nanosec)
