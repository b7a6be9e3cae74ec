"""One browser: what it looks at, what it asks for, and the frames that it gets."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import ParameterError, for_browser
from rpud_sim.foundation.terminal import printable

PERIOD = 0.1  # between frames, at least [s]
LONGEST_REQUEST = 4096  # bytes

_MOST_WIDTH = 4000  # px
_MOST_NAME = 256  # characters
_MOST_CHOICES = 32
_ALIGNED = 8  # bytes
_GREATEST = 1e12  # number that a page sends: the difference of any two can be divided finely

# Calls a function in the one thread in which stores work.
Work = Callable[..., Awaitable[Any]]


class StoreError(RuntimeError):
    """Something that a store cannot show; the text is one line, and the page ends with it."""


@dataclass(frozen=True)
class View:
    """Range of time that a browser shows: the last seconds, or from ``start`` to ``end``."""

    follow: float | None = 20.0  # s; None for a fixed range
    start: float = 0.0  # s
    end: float = 0.0  # s
    width: int = 1000  # of a plot [px]


@dataclass
class ClientState:
    """What one browser looks at, and the store's own notes of what it has sent there."""

    drill: str = ""  # namespace; empty for the store's own choice
    view: View = View()
    choices: Mapping[str, str] = field(default_factory=dict)  # identifiers of choices by plot
    playhead: float | None = None  # s; None if it has none
    section: bool = True  # whether the newest block is wanted; a frame with a section clears it
    sent: dict[str, Any] = field(default_factory=dict)  # belongs to the store

    def is_due(self, name: str, key: Any, period: float = 0.0) -> bool:
        """Return whether a field has changed and is older than a period [s]; it is sent then."""
        before, at = self.sent.get(name, (None, -math.inf))
        if key == before or time.monotonic() - at < period:
            return False
        self.sent[name] = key, time.monotonic()
        return True


class Store:
    """Data that browsers look at. All methods are called from one thread, which may be any."""

    mode = ""  # ``live`` or ``recorded``

    def open(self, client: ClientState) -> None:
        """Note one more browser; StoreError if there is nothing to show."""

    def frame(self, client: ClientState) -> dict[str, Any] | None:
        """Return fields of the next frame without ``number``; None if nothing is new."""
        raise NotImplementedError

    def request(self, client: ClientState, name: str, content: Any) -> None:
        """Do what a browser asks: ``act`` and its arguments, or ``seek``; ParameterError if not."""


def encode(frame: Mapping[str, Any]) -> bytes:
    """Return the bytes of a frame: a header in JSON, and arrays in binary.

    They are ``uint32 n`` (little-endian), n bytes of the header, zeros up to a multiple of 8, and
    the arrays, each filled up to a multiple of 8. In the header an array is ``{"$": [offset,
    length, type]}``: the offset counts from the first array [bytes], the type is ``f4`` or ``f8``.

    Its values are plain ones, mappings, sequences and one-dimensional arrays. Times need double
    precision, and have it; other arrays become single. Equal arrays are sent once. A scalar that is
    not finite becomes null.
    """
    arrays: dict[bytes, int] = {}  # offsets by content
    size = 0

    def plain(value: Any) -> Any:
        nonlocal size
        if isinstance(value, np.ndarray):
            kind = "f8" if value.dtype == np.float64 else "f4"
            data = _filled(np.ascontiguousarray(value, f"<{kind}").tobytes())
            if data not in arrays:
                arrays[data] = size
                size += len(data)
            return {"$": [arrays[data], len(value), kind]}
        if isinstance(value, Mapping):
            return {printable(str(key)): plain(each) for key, each in value.items()}
        if isinstance(value, list | tuple):
            return [plain(each) for each in value]
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, float) and not math.isfinite(value):
            return None
        return printable(value) if isinstance(value, str) else value

    header = json.dumps(plain(frame), separators=(",", ":"), allow_nan=False).encode()
    return b"".join([_filled(len(header).to_bytes(4, "little") + header), *arrays])


def _filled(data: bytes) -> bytes:
    return data + bytes(-len(data) % _ALIGNED)


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
        self._number = 0
        self._acknowledged = asyncio.Event()
        self._refused = (0, "")

    async def run(self) -> None:
        """Send frames until the browser has gone, or there is nothing more to send."""
        first: dict[str, Any] = {"mode": self._store.mode, "quantities": for_browser()}
        refused = 0
        clock = asyncio.get_running_loop().time
        try:
            await self._work(self._store.open, self._client)
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

    def _fields(self) -> dict[str, Any]:
        fields = self._store.frame(self._client) or {}
        if "section" in fields:
            self._client.section = False
        return fields

    # Requests

    async def hear(self, message: str | bytes) -> None:
        """Do what a browser asks; RequestError for what no page sends."""
        try:
            await self._do(json.loads(message))
        except (ParameterError, StoreError) as error:
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
                    client.view = _view(asked["view"])
                if "choices" in asked:
                    client.choices = _choices(asked["choices"])
            case "playhead":
                client.playhead = _number(asked["playhead"])
            case "section":
                client.section = bool(asked["section"])
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


def _view(asked: dict[str, Any]) -> View:
    width = int(min(max(_number(asked["width"]), 1.0), _MOST_WIDTH))
    if "follow" in asked:
        follow = _number(asked["follow"])
        if follow <= 0.0:
            raise ValueError("follow")
        return View(follow, width=width)
    start, end = _number(asked["start"]), _number(asked["end"])
    if not start < end:
        raise ValueError("start and end")
    return View(None, start, end, width)


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
