"""Thread of a playback, and the services that reach it."""

from __future__ import annotations

import importlib
import threading
from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import Any, TypeVar

from std_srvs.srv import Trigger

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.replay.playback import Playback, RefusedError
from rpud_sim.ros.replay.replayer_node import Replayer
from rpud_sim.ros.threads import Requests, StoppedError, raised, schedule_thread

Result = TypeVar("Result")

_LONGEST_SLEEP = 3600.0  # s; the system call refuses more than some decades
_SHORTEST_SLEEP = 2e-4  # s; messages of less than this come together, and wake their listeners once


class PlaybackThread:
    """Thread that plays, by real-time priority unless 0; others reach the playback by ``do``."""

    def __init__(self, playback: Playback, priority: int = 0) -> None:
        self._playback = playback
        self._priority = priority
        self._wake = threading.Event()
        self._requests = Requests(self._wake.set)
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="playback", daemon=True)

    def start(self) -> None:
        self._thread.start()

    @property
    def running(self) -> bool:
        return self._thread.is_alive()

    def do(self, action: Callable[[Playback], Result]) -> Result:
        """Have something done between two messages; return its result, raise what it raises."""
        return self._requests.do(lambda: action(self._playback))

    def stop(self) -> None:
        self._playback.stop()
        self._wake.set()

    def join(self) -> None:
        """Wait for the end, and raise what it ended with."""
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        schedule_thread(self._priority)
        try:
            self._playback.begin()
            while True:
                self._wake.clear()
                self._requests.serve()
                delay = self._playback.advance()
                if delay is None:
                    break
                if delay > 0:
                    self._wake.wait(min(max(delay, _SHORTEST_SLEEP), _LONGEST_SLEEP))
        except Exception as error:
            self._error = error
        finally:
            self._requests.close()
            self._playback.close()


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


def offer_services(node: Replayer, thread: PlaybackThread) -> None:
    """Offer the services of ``ros2 bag play`` below the node's name, with their meanings.

    They are ``pause``, ``resume``, ``toggle_paused``, ``is_paused``, ``get_rate``, ``set_rate``,
    ``seek``, ``play_next``, ``burst``, ``stop`` and ``play``, of the types of rosbag2_interfaces.
    Without that package the types are std_srvs/Trigger and those of rpud_msgs, which also return
    the reason of a refusal. There is no ``play`` then: a running replay refuses it, and the program
    ends with its replay.
    """
    for name, kind in service_types().items():
        node.create_service(kind, f"~/{name}", partial(_answer, node, thread, name))


def _answer(node: Replayer, thread: PlaybackThread, name: str, request: Any, response: Any) -> Any:
    try:
        result = thread.do(lambda playback: _ACTIONS[name](playback, request))
        fields = {"success": True, **(result or {})}
    except (RefusedError, StoppedError) as error:
        reason = "the replay has ended" if isinstance(error, StoppedError) else str(error)
        node.get_logger().warning(f"{name} is refused: {reason}")
        fields = {"success": False, "message": reason}
    except Exception as error:  # out of the executor it would leave a client without answer
        reason = raised(error)
        node.count_failure(f"{name}: {reason}")
        fields = {"success": False, "message": reason}
    for field, value in fields.items():
        if hasattr(response, field):  # not every type has all of them
            setattr(response, field, value)
    return response


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
