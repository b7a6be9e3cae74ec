"""Browser without a screen: it takes frames over a real WebSocket, and acknowledges them."""

import asyncio
import json
import threading
from contextlib import contextmanager, suppress

from frame_reader import decode
from support import PATIENCE
from tornado.websocket import WebSocketClosedError, websocket_connect

from rpud_sim.viewer.server import ListenAddress, PageServer


class ClosedError(Exception):
    """The server has closed the socket; its arguments are code and reason."""


class ScreenClient:
    """Connection of one browser; ``seen`` has all fields of the frames of this run."""

    def __init__(self, port, query=""):
        async def connect():
            return await websocket_connect(f"ws://127.0.0.1:{port}/frames{query}")

        self._loop = asyncio.new_event_loop()
        self._socket = self._run(connect())
        self._closed = False
        self.seen = {}
        self.run = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        async def close():
            self._socket.close()
            while not self._closed and await self._socket.read_message() is not None:
                pass

        self._run(close())
        self._loop.close()

    def _run(self, awaitable):
        async def limited():
            return await asyncio.wait_for(awaitable, PATIENCE)

        return self._loop.run_until_complete(limited())

    def send(self, request):
        async def write():
            text = request if isinstance(request, str) else json.dumps(request)
            await self._socket.write_message(text)

        self._run(write())

    def frame(self, acknowledge=True):
        """Return the next frame."""
        return self._run(self._take(acknowledge))

    def until(self, condition):
        """Take frames until a condition on what was seen holds, and return its value.

        It does not hold as long as it looks at something that was not seen yet.
        """

        async def take():
            while True:
                with suppress(LookupError):
                    if value := condition(self.seen):
                        return value
                await self._take()

        return self._run(take())

    async def _take(self, acknowledge=True):
        message = await self._socket.read_message()
        if message is None:
            self._closed = True
            raise ClosedError(self._socket.close_code, self._socket.close_reason)
        frame = decode(message)
        if self.run != frame.get("run", self.run):
            self.run = frame["run"]
            self.seen = {key: self.seen[key] for key in ("mode", "quantities") if key in self.seen}
        self.seen |= frame
        if acknowledge and "error" not in frame:
            with suppress(WebSocketClosedError):  # the next one says why
                await self._socket.write_message(json.dumps({"ack": frame["number"]}))
        return frame


@contextmanager
def serving(store, token="", address="127.0.0.1"):
    """Serve a store in a thread; the value is the server."""
    server = PageServer(store, ListenAddress(0, address, token))
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join()
