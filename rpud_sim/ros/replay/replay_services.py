"""Services that control a replay: those of ``ros2 bag play`` if its interfaces are installed."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from types import ModuleType
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.replay.playback import Playback, RefusedError
from rpud_sim.ros.replay.playback_thread import PlaybackThread
from rpud_sim.ros.requests import StoppedError
from rpud_sim.ros.serving import raised


def _seek(playback: Playback, request: Any) -> None:
    playback.seek(int(request.time.sec) * SECOND + int(request.time.nanosec))


def _play(playback: Playback, request: Any) -> None:
    raise RefusedError("the replay has begun")


# They return fields of the response.
_ACTIONS: dict[str, Callable[[Playback, Any], dict[str, Any] | None]] = {
    "pause": lambda playback, request: playback.pause(),
    "resume": lambda playback, request: playback.resume(),
    "toggle_paused": lambda playback, request: playback.toggle_paused(),
    "is_paused": lambda playback, request: {"paused": playback.paused},
    "get_rate": lambda playback, request: {"rate": playback.rate},
    "set_rate": lambda playback, request: playback.set_rate(request.rate),
    "seek": _seek,
    "play_next": lambda playback, request: playback.play_next(),
    "burst": lambda playback, request: {"actually_burst": playback.burst(request.num_messages)},
    "stop": lambda playback, request: playback.stop(),
    "play": _play,
}


class ReplayServices:
    """Services below the node's name, with the names and meanings of ``ros2 bag play``.

    They are ``pause``, ``resume``, ``toggle_paused``, ``is_paused``, ``get_rate``, ``set_rate``,
    ``seek``, ``play_next``, ``burst``, ``stop`` and ``play``, of the types of rosbag2_interfaces.
    Without that package the types are std_srvs/Trigger and those of rpud_msgs, which also return
    the reason of a refusal. There is no ``play`` then: a running replay refuses it, and the program
    ends with its replay. ``failed`` is called with one line if a request raises an error.
    """

    def __init__(self, node: Node, thread: PlaybackThread, failed: Callable[[str], None]) -> None:
        self._thread = thread
        self._failed = failed
        self._logger = node.get_logger()
        for name, kind in service_types().items():
            node.create_service(kind, f"~/{name}", self._answering(name))

    def _answering(self, name: str) -> Callable[[Any, Any], Any]:
        def answer(request: Any, response: Any) -> Any:
            try:
                result = self._thread.do(lambda playback: _ACTIONS[name](playback, request))
                fields = {"success": True, **(result or {})}
            except (RefusedError, StoppedError) as error:
                reason = "the replay has ended" if isinstance(error, StoppedError) else str(error)
                self._logger.warning(f"{name} is refused: {reason}")
                fields = {"success": False, "message": reason}
            except Exception as error:  # out of the executor it would leave a client without answer
                reason = raised(error)
                self._failed(f"{name}: {reason}")
                fields = {"success": False, "message": reason}
            for field, value in fields.items():
                if hasattr(response, field):  # not every type has all of them
                    setattr(response, field, value)
            return response

        return answer


def service_types() -> dict[str, Any]:
    if rosbag2 := _installed("rosbag2_interfaces.srv"):
        return {name: getattr(rosbag2, _type_name(name)) for name in _ACTIONS}
    types = dict.fromkeys(("pause", "resume", "toggle_paused", "play_next", "stop"), Trigger)
    if own := _installed("rpud_msgs.srv"):
        for name in ("is_paused", "get_rate", "set_rate", "seek", "burst"):
            types[name] = getattr(own, _type_name(name))
    return types


def _installed(module: str) -> ModuleType | None:
    try:
        return importlib.import_module(module)
    except ImportError:
        return None


def _type_name(name: str) -> str:
    return name.title().replace("_", "")
