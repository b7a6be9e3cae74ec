"""A running drill as pages see it: one thread that hears it and acts on it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from rpud_sim.ros.client import ClientError, DrillClient
from rpud_sim.viewer.live.actions import Actions, InterruptedWaitError, plain_refusal
from rpud_sim.viewer.live.heard import Heard

SEARCHING, CONNECTED, VANISHED = "searching", "connected", "vanished"

_PERIOD = 0.1  # between takes of messages [s]
_CHECK_PERIOD = 0.5  # between looks at events and at the publishers [s]
_SILENCE = 4.0  # of a drill that is gone; a living one publishes a status every second or so [s]
_SEARCH_PATIENCE = 1.0  # s
_ANSWER_PATIENCE = 10.0  # s
_INTERRUPTERS = ("pause", "reset")  # which a step that is under way must not delay


@dataclass(frozen=True)
class Connection:
    """Connection to a drill."""

    state: str  # ``searching``, ``connected`` or ``vanished``
    since: float  # Unix time [s]
    reason: str = ""  # why it is not connected


class LiveDrill:
    """Hears one drill in a thread of its own, keeps what it has heard, and acts on it.

    Any number of pages share it::

        with LiveDrill("/rpud") as drill:
            drill.actions.add("press", {"force": 30.0})
            with drill.reading() as heard:
                heard.status           # the latest status, {"weight_on_bit": 30.0, ...}
            drill.connection.state     # searching, connected or vanished
            drill.actions.outcomes     # waiting, then done, refused or failed

    The drill need not be there at first. If it vanishes, the connection says so and the thread
    searches it again; what was heard stays until another run begins, whose number is
    ``heard.run``. Actions are executed in order, as methods of ``DrillClient``; a pause or reset
    ends the wait for a step that is under way. ``error`` says why the thread has died.
    """

    def __init__(
        self, namespace: str = "/rpud", domain_id: int | None = None, node_name: str = "rpud_watch"
    ) -> None:
        self.error = ""
        self.actions = Actions()
        self.kinds: tuple[str, ...] = ()  # of faults that can be injected now
        self.channels: tuple[str, ...] = ()  # whose signals can be faulty
        self.refusals = (0, "")  # commands that the drill has refused from anybody, latest reason
        self._options: dict[str, Any] = {"domain_id": domain_id, "node_name": node_name}
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._closed = False
        self._heard = Heard()
        self._lost: dict[str, int] = {}
        self._lost_before: dict[str, int] = {}
        self._status_at = 0.0
        self._asked_run = 0
        self._version = 0  # of what no message says
        # Here, so that the caller gets the error of a namespace that ROS does not allow.
        self._client: DrillClient | None = self._open(namespace)
        self.namespace = self._client.namespace
        self.connection = Connection(SEARCHING, time.time(), f"no drill in {self.namespace} yet")
        self._thread = threading.Thread(target=self._live, name=f"drill {namespace}", daemon=True)
        self._thread.start()

    def __enter__(self) -> LiveDrill:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the graph; the drill goes on."""
        self._closed = True
        self._wake.set()
        self._thread.join()

    @property
    def version(self) -> tuple[int, int, int]:
        """What differs whenever there is anything new."""
        return self._heard.version, self._version, self.actions.version

    @property
    def lost(self) -> dict[str, int]:
        """Messages by topic that were sent and never arrived."""
        lost = {**self._lost, "journal": self._heard.journal_lost}
        return {
            topic: count
            for topic in {**lost, **self._lost_before}
            if (count := lost.get(topic, 0) + self._lost_before.get(topic, 0))
        }

    @contextmanager
    def reading(self) -> Iterator[Heard]:
        """Return what was heard, which does not change meanwhile."""
        with self._lock:
            yield self._heard

    def act(self, name: str, arguments: dict[str, Any]) -> int:
        """Queue an action, and return the number of its outcome."""
        number = self.actions.add(name, arguments)
        self._wake.set()
        return number

    # The thread

    def _live(self) -> None:
        try:
            while not self._closed:
                self._search()
                self._follow()
        except InterruptedWaitError:
            pass
        except Exception as error:  # pages say it, and end
            self.error = f"{type(error).__name__}: {error}"
            raise
        finally:
            if self._client is not None:
                self._client.close()

    def _open(self, namespace: str) -> DrillClient:
        client = DrillClient(namespace, patience=_ANSWER_PATIENCE, **self._options)
        client.observe(self._latched)
        client.check_while_waiting(self._check)
        self._telemetry = client.telemetry(self._heard.sinks())
        return client

    def _latched(self, topic: str, message: Any) -> None:
        with self._lock:
            self._heard.latched(topic, message)
        if topic == "status":
            self._status_at = time.monotonic()

    def _check(self) -> None:
        if self._closed:
            raise InterruptedWaitError
        if self.actions.running == "step" and self.actions.waits_for(_INTERRUPTERS):
            raise InterruptedWaitError
        self._settle()  # a long step shows what happens

    def _settle(self) -> None:
        with self._lock:
            self._heard.settle()

    def _search(self) -> None:
        """Wait for the drill; returns when it is found, or when this is to close."""
        while not self._closed:
            if self._client is None:
                self._client = self._open(self.namespace)
            try:
                self._client.found(_SEARCH_PATIENCE)
            except ClientError as error:
                if self.connection.reason != str(error):
                    self._connect(self.connection.state, str(error))
                self.actions.fail_all(str(error))
            else:
                self._connect(CONNECTED, "")
                return

    def _follow(self) -> None:
        client = self._client
        assert client is not None  # it was found
        self._asked_run = 0
        due = 0.0
        while not self._closed:
            client.take()
            self._settle()
            while not self._closed and self.actions.execute(client):
                pass
            if (now := time.monotonic()) >= due:
                due = now + _CHECK_PERIOD
                client.spin()
                if not client.publishers:
                    return self._lose(client, "it has left")
                if now - self._status_at > _SILENCE:
                    return self._lose(client, f"it has published no status for {_SILENCE:g} s")
                self._look(client)
            self._wake.wait(_PERIOD)
            self._wake.clear()
        return None

    def _look(self, client: DrillClient) -> None:
        """Look at what no message says: refusals, losses, and which faults are possible."""
        refusals, lost, run = client.last_refusal, dict(self._telemetry.lost), self._heard.run
        if (refusals, lost) != (self.refusals, self._lost):
            if refusals[0] > self.refusals[0]:
                with self._lock:
                    self._heard.refuse(plain_refusal(refusals[1]))
            self.refusals, self._lost = refusals, lost
            self._version += 1
        if run != self._asked_run:
            self._asked_run = run
            try:
                response = client.list_faults()
            except ClientError:
                return  # it may be gone, which the next look shows
            self.kinds, self.channels = tuple(response.kinds), tuple(response.channels)
            self._version += 1

    def _lose(self, client: DrillClient, reason: str) -> None:
        self._connect(VANISHED, f"the drill in {self.namespace} is gone: {reason}")
        self._lost_before, self._lost = self.lost, {}
        with self._lock:
            self._heard.journal_lost = 0
            self._heard.restart()
        # A client knows the drill that it has found; another one needs another client.
        self._client = None
        client.close()

    def _connect(self, state: str, reason: str) -> None:
        since = self.connection.since if state == self.connection.state else time.time()
        self.connection = Connection(state, since, reason)
        self._version += 1
