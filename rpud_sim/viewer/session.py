"""One browser: what it looks at, what it has acknowledged, and what it asks for."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.quantities import for_browser
from rpud_sim.viewer.frames import encode
from rpud_sim.viewer.store import ClientState, Store, StoreError, View

PERIOD = 0.1  # between frames, at least [s]
LONGEST_REQUEST = 4096  # bytes

_MOST_WIDTH = 4000  # px
_MOST_NAME = 256  # characters
_MOST_CHOICES = 32
_GREATEST = 1e12  # number that a page sends: the difference of any two can be divided finely

# Calls a function in the one thread in which stores work.
Work = Callable[..., Awaitable[Any]]


class RequestError(ValueError):
    """Request that no page of this program sends; the text says what is wrong."""


class Session:
    """Frames for one browser, and its requests.

    A frame is sent when the one before was acknowledged, so that a slow browser gets fewer, and
    delays nobody.
    """

    def __init__(
        self, store: Store, work: Work, send: Callable[[bytes], Awaitable[object]], drill: str
    ) -> None:
        self._store = store
        self._work = work
        self._send = send
        self._client = ClientState(drill=drill)
        self._is_open = False
        self._number = 0
        self._acknowledged = asyncio.Event()
        self._refused = (0, "")

    async def run(self) -> None:
        """Send frames until the browser has gone, or there is nothing more to send."""
        first: dict[str, Any] = {"mode": self._store.mode, "quantities": for_browser()}
        refused = 0
        clock = asyncio.get_running_loop().time
        try:
            await self._work(self._open)
            while True:
                due = clock() + PERIOD
                frame = {**first, **await self._work(self._fields)}
                if refused != self._refused[0]:
                    frame["refused"], refused = self._refused, self._refused[0]
                if frame:
                    first = {}
                    await self._deliver(frame)
                await asyncio.sleep(due - clock())
        except StoreError as error:
            await self._deliver({**first, "error": str(error)})
        except Exception as error:
            await self._deliver({**first, "error": f"the server has failed: {_one_line(error)}"})
            raise
        finally:
            await self._work(self._close)

    # In the thread of the store, so that a browser which goes at any time is closed once

    def _open(self) -> None:
        self._store.open(self._client)
        self._is_open = True

    def _close(self) -> None:
        if self._is_open:
            self._store.close(self._client)

    def _fields(self) -> dict[str, Any]:
        fields = self._store.frame(self._client) or {}
        if "section" in fields:
            self._client.section = False
        return fields

    def _change_drill(self, drill: str) -> None:
        other = ClientState(drill, self._client.view)
        try:
            self._store.open(other)
        except StoreError as error:
            raise ParameterError(str(error)) from None
        before, self._client = self._client, other
        self._store.close(before)

    # Requests

    async def hear(self, message: str | bytes) -> None:
        """Do what a browser asks; RequestError for what no page sends."""
        try:
            await self._do(json.loads(message))
        except ParameterError as error:
            self._refused = self._refused[0] + 1, str(error)
        except (AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
            raise RequestError(f"wrong request: {_one_line(error)}") from None

    async def _do(self, asked: Any) -> None:
        client = self._client
        match next(iter(asked), None):
            case "ack":
                if asked["ack"] == self._number:
                    self._acknowledged.set()
            case "view" | "choices":
                if "view" in asked:
                    client.view = _view(client.view, asked["view"])
                if "choices" in asked:
                    client.choices = _choices(asked["choices"])
            case "playhead":
                client.playhead = _number(asked["playhead"])
            case "section":
                client.section = bool(asked["section"])
            case "drill":
                await self._work(self._change_drill, _text(asked["drill"]))
            case "seek":
                if asked["seek"] not in ("next", "previous"):
                    raise ValueError("seek")
                content = {"to": asked["seek"], "from": _number(asked["from"])}
                await self._work(self._store.request, client, "seek", content)
            case "act":
                arguments = asked.get("arguments", {})
                if not isinstance(arguments, dict):
                    raise ValueError("arguments")
                content = {"name": _text(asked["act"]), "arguments": arguments}
                await self._work(self._store.request, client, "act", content)
            case name:
                raise ValueError(name)

    async def _deliver(self, frame: dict[str, Any]) -> None:
        """Send a frame and wait until it has been shown."""
        self._number += 1
        self._acknowledged.clear()
        await self._send(encode({"number": self._number, **frame}))
        if "error" not in frame:
            await self._acknowledged.wait()


def _view(before: View, asked: dict[str, Any]) -> View:
    width = before.width
    if "width" in asked:
        width = int(min(max(_number(asked["width"]), 1.0), _MOST_WIDTH))
    if "follow" in asked:
        follow = _number(asked["follow"])
        if follow <= 0.0:
            raise ValueError("follow")
        return View(follow, width=width)
    if "start" in asked:
        start, end = _number(asked["start"]), _number(asked["end"])
        if not start < end:
            raise ValueError("start and end")
        return View(None, start, end, width)
    return replace(before, width=width)


def _choices(asked: dict[str, Any]) -> dict[str, str]:
    if len(asked) > _MOST_CHOICES:
        raise ValueError("choices")
    return {_text(plot): _text(choice) for plot, choice in asked.items()}


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("this is not a number")
    if not abs(value) <= _GREATEST:
        raise ValueError("this number is too great, or none")
    return float(value)


def _text(value: Any) -> str:
    if not isinstance(value, str) or len(value) > _MOST_NAME:
        raise ValueError("this is not a name")
    return value


def _one_line(error: BaseException) -> str:
    return printable(" ".join(f"{type(error).__name__}: {error}".split()))[:_MOST_NAME]
