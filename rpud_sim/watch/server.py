"""Server of pages in the browser: this machine alone, or others with a token.

The page of a drill and that of a bag are Bokeh documents. A kind of page needs a function that
fills a document, and one line::

    serve({"/bag": show_bag}, place, announce=lambda server: print(server.url("/bag")))

``show_bag(document)`` is called once for each browser tab. It may set ``document.template``;
``document.session_context.request.arguments`` are the arguments of the URL (lists of bytes), and
``document.on_session_destroyed`` tells when the tab is gone. All of it runs in the one thread of
the server's loop: what takes long belongs into a thread of its own. Plain pages are handlers of
Tornado that derive from ``bokeh.server.views.auth_request_handler.AuthRequestHandler``, so that
they need the token.
"""

from __future__ import annotations

import dataclasses
import errno
import hmac
import ipaddress
import logging
import secrets
import signal
import socket
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any
from urllib.parse import SplitResult, parse_qsl, urlencode, urlsplit

from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.server.auth_provider import AuthProvider
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.settings import settings
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPHeaders
from tornado.ioloop import IOLoop, PeriodicCallback
from tornado.netutil import bind_sockets
from tornado.web import Finish, OutputTransform, RequestHandler

if TYPE_CHECKING:
    from bokeh.document import Document

DEFAULT_PORT = 8810
LOOPBACK = "127.0.0.1"

_TOKEN_BYTES = 24
_LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")
_FORBIDDEN = 403


class ServerError(RuntimeError):
    """Server that cannot start; the text is one line."""


@dataclasses.dataclass(frozen=True)
class Place:
    """Where a server listens."""

    port: int = DEFAULT_PORT  # 0 for a free one
    address: str = LOOPBACK  # of the interface; that of all is ``0.0.0.0``
    token: str = ""  # that a browser must know; empty for none

    @classmethod
    def of(cls, port: int = DEFAULT_PORT, address: str = LOOPBACK) -> Place:
        """Return a place, with a new token if other machines can reach it."""
        token = "" if _is_loopback(address) else secrets.token_urlsafe(_TOKEN_BYTES)
        return cls(port, address, token)


class _NoFrames(OutputTransform):
    """Header of every answer: no page of another site may show this one, and catch its clicks."""

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        headers["Content-Security-Policy"] = "frame-ancestors 'none'"
        return status_code, headers, chunk


class _Application(BokehTornado):
    def resources(self, absolute_url: str | bool | None = None) -> Any:
        found = super().resources(absolute_url)
        found.components = ["bokeh"]
        return found


class PageServer:
    """HTTP server of Bokeh documents and of plain pages; listens from the start.

    ``applications`` are by path, functions that fill a document. ``handlers`` of plain pages are
    pairs of a path and a handler of Tornado.
    """

    def __init__(
        self,
        applications: Mapping[str, Callable[[Document], None]],
        place: Place,
        handlers: Sequence[tuple[str, type[RequestHandler], dict[str, Any]]] = (),
    ) -> None:
        # Whatever the environment says, the browser gets BokehJS from here.
        settings.resources = "server"
        settings.log_level = "error"  # of BokehJS: it warns at each picture of an empty plot
        logging.getLogger("tornado.access").setLevel(logging.ERROR)
        logging.getLogger("bokeh").setLevel(logging.ERROR)
        try:
            sockets = bind_sockets(place.port, place.address)
        except OSError as error:
            raise ServerError(_why_not(place, error)) from error
        self.port = int(sockets[0].getsockname()[1])  # on which it listens
        self._place = place
        self._application = _Application(
            {path: Application(FunctionHandler(fill)) for path, fill in applications.items()},
            # The guard compares with the address that the browser has asked for; Bokeh's own list
            # has no notation for it.
            extra_websocket_origins=["*"],
            extra_patterns=list(handlers),
            use_index=False,
            redirect_root=False,
            auth_provider=Guard(place.token, self.port),
            include_headers=[],  # or Bokeh writes them, and with them the token, into its pages
            include_cookies=[],
        )
        self._application.add_transform(_NoFrames)
        http = HTTPServer(self._application)
        http.add_sockets(sockets)
        self._loop = IOLoop.current()
        self._server = BaseServer(self._loop, self._application, http)

    def url(self, path: str = "/", **arguments: str) -> str:
        """Return the address of a page, with the token where one is needed."""
        if self._place.token:
            arguments["token"] = self._place.token
        query = f"?{urlencode(arguments, safe='/')}" if arguments else ""
        return f"http://{_authority(_reachable(self._place.address), self.port)}{path}{query}"

    def every(self, seconds: float, call: Callable[[], object]) -> None:
        """Call a function regularly while the server runs."""
        PeriodicCallback(lambda: _ignore(call()), seconds * 1e3).start()

    def stop(self) -> None:
        """End `run`, from any thread or from a handler of a signal."""
        self._loop.add_callback_from_signal(self._loop.stop)

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
        try:
            self._server.start()
            self._loop.start()
        finally:
            self._server.stop(wait=False)


def serve(
    applications: Mapping[str, Callable[[Document], None]],
    place: Place,
    announce: Callable[[PageServer], object],
) -> None:
    """Serve pages until SIGINT or SIGTERM.

    Args:
        applications: by path, functions that fill a document.
        place: where to listen.
        announce: called once, when the server listens; prints the addresses of its pages.

    Raises:
        ServerError: if it cannot listen there.
    """
    with PageServer(applications, place) as server:
        announce(server)
        server.run()


class Guard(AuthProvider):
    """Requires the token, and rejects requests that another page sends.

    A page of another site may ask the browser to connect here, or its name may suddenly resolve to
    this machine. The browser tells both: in ``Origin`` and in ``Host``. An empty token requires
    none; the address is then that of the machine itself. ``port`` tells the cookies of several
    servers apart.
    """

    def __init__(self, token: str, port: int) -> None:
        self._token = token
        self._cookie = f"rpud_watch_{port}"
        super().__init__()

    @property
    def get_user(self) -> None:
        """None: Bokeh calls the asynchronous one."""
        return None

    @property
    def get_user_async(self) -> Callable[[Any], Any]:
        """Function that Bokeh calls at each request, also for a WebSocket."""
        return self._check

    @property
    def get_login_url(self) -> Callable[[Any], str]:
        return lambda handler: "/"

    async def _check(self, handler: RequestHandler) -> str:
        request = handler.request
        host = request.host.lower()
        origin = request.headers.get("Origin")
        if origin is not None and _parts(origin).netloc.lower() != host:
            _refuse(handler, f"origin {origin!r:.200} is not this server")
        if not self._token:
            if _parts(f"//{host}").hostname not in _LOOPBACK_NAMES:
                _refuse(handler, f"host {host!r:.200} is not this machine")
            return "operator"
        if self._is_token(handler.get_cookie(self._cookie, "")):
            return "operator"
        given = handler.get_query_argument("token", "")
        if not self._is_token(given):
            wrong = "this is not its token" if given else "the token is missing"
            _refuse(handler, f"{wrong}: open the address that `rpud watch` has printed")
        handler.set_cookie(self._cookie, given, httponly=True, samesite="Strict", path="/")
        # The address that stays in the history, and that others may see, has no token.
        rest = [pair for pair in parse_qsl(request.query) if pair[0] != "token"]
        handler.redirect(f"{request.path}{'?' if rest else ''}{urlencode(rest, safe='/')}")
        raise Finish

    def _is_token(self, given: str | None) -> bool:
        return hmac.compare_digest((given or "").encode(), self._token.encode())


def _parts(url: str) -> SplitResult:
    """Return the parts of an address; empty ones if it is none."""
    try:
        return urlsplit(url)
    except ValueError:
        return urlsplit("")


def _ignore(result: object) -> None:
    """Return nothing, which is what a callback of the loop has to return."""


def _refuse(handler: RequestHandler, reason: str) -> None:
    handler.set_status(_FORBIDDEN)
    handler.set_header("Content-Type", "text/plain; charset=utf-8")
    handler.finish(f"{reason}\n")
    raise Finish


def _is_loopback(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address == "localhost"


def _reachable(address: str) -> str:
    """Return an address for a browser; that of all interfaces is none."""
    return socket.gethostname() if address in ("", "0.0.0.0", "::") else address


def _authority(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _why_not(place: Place, error: OSError) -> str:
    where = f"port {place.port} of {place.address}"
    if error.errno == errno.EADDRINUSE:
        return f"{where} is in use: choose another one with --port, or 0 for a free one"
    if error.errno == errno.EACCES:
        return f"{where} is not permitted to this user: choose one above 1023 with --port"
    if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
        return f"address {place.address!r:.200} is not one of this machine"
    return f"{where}: {error.strerror or error}"
