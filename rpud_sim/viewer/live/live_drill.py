"""A running drill as pages see it: one thread that hears it and acts on it."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from rpud_sim.ros.client import ClientError, DrillClient
from rpud_sim.ros.client.telemetry import Telemetry
from rpud_sim.viewer.live.actions import Actions, InterruptedWaitError, plain_refusal
from rpud_sim.viewer.live.heard import Heard

SEARCHING, CONNECTED, VANISHED = "searching", "connected", "vanished"

_PERIOD = 0.1  # between takes of messages [s]
_CHECK_PERIOD = 0.5  # between looks at events and at the publishers [s]
_SILENCE = 4.0  # of a drill that is gone; a living one publishes a status every second or so [s]
_SEARCH_PATIENCE = 1.0  # s
_ANSWER_PATIENCE = 10.0  # s
_INTERRUPTERS = ("pause", "reset")  # which a step that is under way must not delay


class LiveDrill:
    """Hears one drill in a thread of its own, keeps what it has heard, and acts on it.

    Any number of pages share it. ``connection`` is ``searching``, ``connected`` or ``vanished``,
    since when [Unix s], and why.

    The drill need not be there at first. If it vanishes, the connection says so and the thread
    searches it again; what was heard stays until another run begins, whose number is
    ``heard.run``. Actions are executed in order, as methods of ``DrillClient``; a pause or reset
    ends the wait for a step that is under way. ``error`` says why the thread has died.
    """

    def __init__(self, namespace: str, domain_id: int | None = None) -> None:
        self.error = ""
        self.actions = Actions()
        self.kinds: tuple[str, ...] = ()  # of faults that can be injected now
        self.channels: tuple[str, ...] = ()  # whose signals can be faulty
        self.refusals = (0, "")  # commands that the drill has refused from anybody, latest reason
        self._domain_id = domain_id
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._closed = False
        self._heard = Heard()
        self._lost_before: Counter[str] = Counter()  # by clients that are closed
        self._telemetry: Telemetry | None = None
        self._status_at = 0.0
        self._asked_run = 0
        # Here, so that the caller gets the error of a namespace that ROS does not allow.
        self._client: DrillClient | None = self._open(namespace)
        self.namespace = self._client.namespace
        self.connection: dict[str, Any] = {}
        self._connect(SEARCHING, f"no drill in {self.namespace} yet")
        self._thread = threading.Thread(target=self._live, name=f"drill {namespace}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the graph; the drill goes on."""
        self._closed = True
        self._wake.set()
        self._thread.join()

    @property
    def lost(self) -> dict[str, int]:
        """Messages by topic that were sent and never arrived."""
        lost = Counter(self._telemetry.lost if self._telemetry else ())
        return dict(self._lost_before + lost + Counter(journal=self._heard.journal_lost))

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
        client = DrillClient(namespace, self._domain_id, "rpud_watch", _ANSWER_PATIENCE)
        client.observe(self._latched)
        client.check_while_waiting(self._check)
        if self._telemetry is not None:
            self._lost_before += Counter(self._telemetry.lost)
        self._telemetry = client.telemetry(self._heard.sinks())
        return client

    def _latched(self, topic: str, message: Any) -> None:
        if topic == "command_results":
            return self._note_refusals(message.results, message.former)
        with self._lock:
            self._heard.latched(topic, message)
        if topic == "status":
            self._status_at = time.monotonic()
            self.refusals = message.commands_rejected, self.refusals[1]
        return None

    def _note_refusals(self, results: Sequence[Any], former: int) -> None:
        refused = [(at, each.reason) for at, each in enumerate(results) if not each.accepted]
        with self._lock:
            for at, reason in refused:
                if at >= former:
                    self._heard.refuse(plain_refusal(reason))
        if refused:
            self.refusals = self.refusals[0], refused[-1][1]

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
                self._connect(self.connection["state"], str(error))
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
        """Look at what no message says: which faults are possible."""
        if self._heard.run != self._asked_run:
            self._asked_run = self._heard.run
            with suppress(ClientError):  # it may be gone, which the next look shows
                response = client.list_faults()
                self.kinds, self.channels = tuple(response.kinds), tuple(response.channels)

    def _lose(self, client: DrillClient, reason: str) -> None:
        self._connect(VANISHED, f"the drill in {self.namespace} is gone: {reason}")
        with self._lock:
            self._heard.restart()
        # A client knows the drill that it has found; another one needs another client.
        self._client = None
        client.close()

    def _connect(self, state: str, reason: str) -> None:
        is_new = state != self.connection.get("state")
        since = time.time() if is_new else self.connection["since"]
        self.connection = {"state": state, "since": since, "reason": reason}
