"""Server of the screen: this machine alone, or others with a token; one session a browser."""

from __future__ import annotations

import asyncio
import errno
import hmac
import ipaddress
import json
import logging
import secrets
import signal
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, parse_qsl, urlencode, urlsplit

from tornado import web
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPHeaders
from tornado.netutil import bind_sockets
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from rpud_sim.foundation.quantities import ExpectedError, ParameterError
from rpud_sim.foundation.shown_quantities import for_browser
from rpud_sim.foundation.terminal import printable
from rpud_sim.viewer.frames import ClientState, Store, View, encode

DEFAULT_PORT = 8810
LOOPBACK = "127.0.0.1"
PERIOD = 0.1  # between frames, at least [s]
EXPIRY = 3.0  # an action that is so late is not carried out [s]

_BEAT = 1.0  # longest time between frames, so that a page knows that the server lives [s]
_SHARE = Path(__file__).parent / "share"
_SERVED = (".css", ".html", ".js")
_MOST_PAGES = 64
_TOKEN_BYTES = 24
_WRONG_REQUEST, _TOO_MANY, _FAILED = 1008, 1013, 1011  # codes with which a socket closes
_PING = 20.0  # a browser that does not answer for so long has gone [s]

_LONGEST_REQUEST = 4096  # bytes
_MOST_WIDTH = 4000  # px
_MOST_NAME = 256  # characters
_MOST_CHOICES = 32
_GREATEST = 1e12  # number that a page sends: the difference of any two can be divided finely

_HEADERS = {  # of every answer; no page of another site may show this one, and catch its clicks
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}


@dataclass(frozen=True)
class ListenAddress:
    """Where a server listens."""

    port: int = DEFAULT_PORT  # 0 for a free one
    address: str = LOOPBACK  # of the interface; ``0.0.0.0`` for all
    token: str = ""  # that a browser must know; empty for none

    @classmethod
    def of(cls, port: int = DEFAULT_PORT, address: str = LOOPBACK) -> ListenAddress:
        """Return a place, with a new token if other machines can reach it."""
        return cls(port, address, "" if _is_own(address) else secrets.token_urlsafe(_TOKEN_BYTES))


_PROXY = "; a proxy in between must keep the header Host"


def _is_own(host: str) -> bool:
    """Whether only this machine has an address; no name but ``localhost`` is sure to be one."""
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"


class PageServer:
    """HTTP server of the screen of a store; it listens from the start.

    The store works in one thread.
    """

    def __init__(self, store: Store, place: ListenAddress) -> None:
        logging.getLogger("tornado.access").setLevel(logging.ERROR)
        try:
            self._sockets = bind_sockets(place.port, place.address)
        except OSError as error:
            raise ExpectedError(_why_not(place, error)) from error
        self.port = int(self._sockets[0].getsockname()[1])  # on which it listens
        self.store = store
        self.pages = 0  # browsers that are connected
        self.place = place
        self._worker = ThreadPoolExecutor(1, "store")
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop = asyncio.Event()

    def url(self, path: str = "/", **arguments: str) -> str:
        """Return the address of a page, with the token where one is needed."""
        if self.place.token:
            arguments["token"] = self.place.token
        query = f"?{urlencode(arguments, safe='/')}" if arguments else ""
        host = self.place.address
        host = socket.gethostname() if host in ("", "0.0.0.0", "::") else host  # of all interfaces
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}{path}{query}"

    def stop(self) -> None:
        """End `run`, from any thread or from a handler of a signal."""
        if self._loop is None:
            self._stop.set()
            return
        with suppress(RuntimeError):  # it has ended already
            self._loop.call_soon_threadsafe(self._stop.set)

    def __enter__(self) -> PageServer:
        """Let SIGINT and SIGTERM end `run`, also before it begins."""
        self._handlers = {
            number: signal.signal(number, lambda *_: self.stop())
            for number in (signal.SIGINT, signal.SIGTERM)
        }
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def run(self) -> None:
        """Serve until `stop`."""
        try:
            asyncio.run(self._run())
        finally:
            self._worker.shutdown(cancel_futures=True)

    async def work(self, call: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function in the thread of the store."""
        return await asyncio.get_running_loop().run_in_executor(self._worker, call, *arguments)

    async def _run(self) -> None:
        self._loop = asyncio.get_running_loop()
        application = web.Application(
            [
                (r"/(?:screen)?()", _Shared, {"name": "screen.html"}),
                (r"/share/(.*)", _Shared),
                (r"/frames", _Frames),
            ],
            server=self,
            transforms=[_Headers, web.GZipContentEncoding],
            default_handler_class=web.ErrorHandler,
            default_handler_args={"status_code": HTTPStatus.NOT_FOUND},
            websocket_max_message_size=_LONGEST_REQUEST,
            websocket_ping_interval=_PING,
        )
        http = HTTPServer(application)
        http.add_sockets(self._sockets)
        await self._stop.wait()
        http.stop()
        await http.close_all_connections()


class _Headers(web.OutputTransform):
    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        headers.update(_HEADERS)
        return status_code, headers, chunk


class _Guarded(web.RequestHandler):
    """Handler that requires the token, and rejects requests that another page sends.

    A page of another site may ask the browser to connect here, or its name may suddenly resolve to
    this machine. The browser sends both: in ``Origin`` and in ``Host``. Without a token the address
    is the machine itself.
    """

    @property
    def server(self) -> PageServer:
        found: PageServer = self.settings["server"]
        return found

    def prepare(self) -> None:
        """Finish a request that may not pass."""
        host = self.request.host.lower()
        origin = self.request.headers.get("Origin")
        if origin is not None and _parts(origin).netloc.lower() != host:
            self._refuse(f"origin {origin!r:.200} is not this server{_PROXY}")
        token = self.server.place.token
        cookie = f"rpud_watch_{self.server.port}"  # distinguishes several servers
        if not token:
            if not _is_own(_parts(f"//{host}").hostname or ""):
                self._refuse(f"host {host!r:.200} is not this machine{_PROXY}")
            return
        known, given = self.get_cookie(cookie) or "", self.get_query_argument("token", "")
        if hmac.compare_digest(known.encode(), token.encode()):
            return
        if not hmac.compare_digest(given.encode(), token.encode()):
            wrong = "this is not its token" if given else "the token is missing"
            self._refuse(f"{wrong}: open the address that `rpud watch` has printed")
        self.set_cookie(cookie, given, httponly=True, samesite="Strict", path="/")
        # The address that stays in the history, and that others may see, has no token.
        rest = [pair for pair in parse_qsl(self.request.query) if pair[0] != "token"]
        page = self.request.path.rpartition("/")[2]  # a proxy may serve it below a path
        self.redirect(f"./{page}{'?' if rest else ''}{urlencode(rest, safe='/')}")
        raise web.Finish

    def _refuse(self, reason: str) -> None:
        self.set_status(HTTPStatus.FORBIDDEN)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{reason}\n")
        raise web.Finish


class _Shared(_Guarded, web.StaticFileHandler):
    """File of the screen: one of the address, or always the same one."""

    def initialize(self, name: str = "") -> None:  # type: ignore[override]
        super().initialize(str(_SHARE))
        self._name = name

    def parse_url_path(self, url_path: str) -> str:
        return self._name or super().parse_url_path(url_path)

    def validate_absolute_path(self, root: str, absolute_path: str) -> str | None:
        if not absolute_path.endswith(_SERVED) or "\0" in absolute_path:
            raise web.HTTPError(HTTPStatus.NOT_FOUND)
        return super().validate_absolute_path(root, absolute_path)

    def set_extra_headers(self, path: str) -> None:
        self.set_header("Cache-Control", "no-cache")  # the browser asks whether it has changed


class _Frames(_Guarded, WebSocketHandler):
    """WebSocket of one browser: its requests, and its frames.

    A frame is sent when the one before was acknowledged, so that a slow browser gets fewer, and
    delays nobody.
    """

    _task: asyncio.Task[None] | None = None  # none if there are too many pages

    def check_origin(self, origin: str) -> bool:
        return True  # the guard has checked it

    def open(self) -> None:
        if self.server.pages >= _MOST_PAGES:
            self.close(_TOO_MANY, f"{_MOST_PAGES} pages are open already")
            return
        self.server.pages += 1
        self._client = ClientState(self.get_query_argument("namespace", ""))
        # What the first frame has besides.
        self._first: dict[str, Any] = {"mode": self.server.store.mode, "quantities": for_browser()}
        self._number = 0  # of the last frame
        self._sent = (asyncio.get_running_loop().time(),) * 2  # times of the last two frames [s]
        self._acknowledged = asyncio.Event()
        self._refused = (0, "")  # number of rejections, and the reason of the last one
        self._task = asyncio.create_task(self._run())
        self._task.add_done_callback(self._end)  # also of one that is cancelled before it begins

    async def _run(self) -> None:
        with suppress(WebSocketClosedError):
            try:
                await self._send_frames()
            except ExpectedError as error:
                await self._send({**self._first, "error": str(error)})
            except WebSocketClosedError:
                raise
            except Exception as error:
                failed = f"the server has failed: {_one_line(error)}"
                await self._send({**self._first, "error": failed})
                raise

    async def _send_frames(self) -> None:
        work, clock, refused = self.server.work, asyncio.get_running_loop().time, 0
        await work(self.server.store.open, self._client)
        while True:
            due = clock() + PERIOD
            frame = {**self._first, **await work(self._fields)}
            if refused != self._refused[0]:
                frame["refused"], refused = self._refused, self._refused[0]
            if frame or due - self._sent[1] > _BEAT:
                self._first = {}
                self._acknowledged.clear()
                await self._send(frame)
                await self._acknowledged.wait()
            await asyncio.sleep(due - clock())

    def _fields(self) -> dict[str, Any]:
        fields = self.server.store.frame(self._client) or {}
        if "section" in fields:
            self._client.section = False
        return fields

    async def _send(self, frame: dict[str, Any]) -> None:
        self._number += 1
        self._sent = self._sent[1], asyncio.get_running_loop().time()
        await self.write_message(encode({"number": self._number, **frame}), binary=True)

    def _end(self, _: asyncio.Task[None]) -> None:
        self.server.pages -= 1
        self.close(_FAILED, "there are no more frames")

    def on_close(self) -> None:
        if self._task is not None:
            self._task.cancel()

    async def on_message(self, message: str | bytes) -> None:
        if self._task is None:
            return
        try:
            await self._do(json.loads(message))
        except ExpectedError as error:
            self._refused = self._refused[0] + 1, str(error)
        except (AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
            self.close(_WRONG_REQUEST, f"wrong request: {_one_line(error)}"[:100])

    def _check_age(self, number: Any) -> None:
        """Reject an action that a page asked for long ago: it names the frame that it had seen."""
        age = asyncio.get_running_loop().time() - self._sent[1 if number == self._number else 0]
        if age > EXPIRY:
            raise ParameterError(f"expired: it came {age:.0f} s after what the screen had shown")

    async def _do(self, asked: Any) -> None:
        """Do what a browser asks; what no page of this program sends is an error."""
        client, request = self._client, self.server.store.request
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
                await self.server.work(request, client, "seek", content)
            case "act":
                if "frame" in asked:
                    self._check_age(asked["frame"])
                arguments = asked.get("arguments", {})
                if not isinstance(arguments, dict):
                    raise ValueError("arguments")
                given = {"name": _text(asked["act"]), "id": _text(asked.get("id", ""))}
                await self.server.work(request, client, "act", given | {"arguments": arguments})
            case name:
                raise ValueError(name)


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


def _parts(url: str) -> SplitResult:
    """Return the parts of an address; empty ones if it is none."""
    try:
        return urlsplit(url)
    except ValueError:
        return urlsplit("")


def _why_not(place: ListenAddress, error: OSError) -> str:
    where = f"port {place.port} of {place.address}"
    if error.errno == errno.EADDRINUSE:
        return f"{where} is in use: choose another one with --port, or 0 for a free one"
    if error.errno == errno.EACCES:
        return f"{where} is not permitted to this user: choose one above 1023 with --port"
    if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
        return f"address {place.address!r:.200} is not one of this machine"
    return f"{where}: {error.strerror or error}"
