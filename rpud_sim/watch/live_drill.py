"""A running drill as views see it: one thread that hears it and acts on it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import MappingProxyType, TracebackType
from typing import Any

from rpud_sim.ros.client import ClientError, DrillClient
from rpud_sim.watch.actions import Actions, InterruptedWaitError
from rpud_sim.watch.heard import SAMPLED, Heard
from rpud_sim.watch.picture import CONNECTED, SEARCHING, VANISHED, Connection, Picture

_PERIOD = 0.04  # between takes of messages [s]
_CHECK_PERIOD = 0.5  # between looks at events and at the publishers [s]
_SILENCE = 4.0  # of a drill that is gone; a living one publishes a status every second or so [s]
_SEARCH_PATIENCE = 1.0  # s
_ANSWER_PATIENCE = 10.0  # s
_INTERRUPTERS = ("pause", "reset")  # which a step that is under way must not delay


class LiveDrill:
    """Hears one drill in a thread of its own, keeps the last minute of it, and acts on it.

    Any number of views share it, from any threads. None of its methods waits for the drill::

        with LiveDrill("/rpud") as drill:
            drill.act("press", force=30.0)
            picture = drill.picture()
            picture.connection.state    # searching, connected or vanished
            picture.status              # the latest status, {"weight_on_bit": 30.0, ...}
            picture.outcomes[-1].state  # waiting, then done, refused or failed
            picture.outcomes[-1].text   # why, in the drill's own words

    A picture is frozen; ``picture.version`` is the same as long as nothing new was heard. The drill
    need not be there at first. If it vanishes, the connection says so and the thread searches it
    again; its series stay until another run begins, whose number is ``picture.run``.

    Actions are executed in order: ``press(force)``, ``drive(enabled, voltage, frequency)``,
    ``feed(rate, position)``, ``engage(on)``, ``inject(kind, channel, magnitude, duration)``,
    ``clear(which)``, ``pause()``, ``play()``, ``step(seconds)``, ``reset(scope, seed)``, as
    ``DrillClient`` has them. A pause or reset ends the wait for a step that is under way.
    """

    def __init__(
        self, namespace: str = "/rpud", domain_id: int | None = None, node_name: str = "rpud_watch"
    ) -> None:
        self._options = {"domain_id": domain_id, "node_name": node_name}
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._closed = False
        self._heard = Heard()
        self._actions = Actions()
        self._kinds: tuple[str, ...] = ()
        self._channels: tuple[str, ...] = ()
        self._refusals = (0, "")
        self._lost: dict[str, int] = {}
        self._lost_before: dict[str, int] = {}
        self._status_at = 0.0
        self._asked_run = 0
        self._picture: Picture | None = None
        self._version = 0  # of what is not in the series
        # Here, so that the caller gets the error of a namespace that ROS does not allow.
        self._client: DrillClient | None = self._open(namespace)
        self.namespace = self._client.namespace
        self._connection = Connection(SEARCHING, time.time(), f"no drill in {self.namespace} yet")
        self._thread = threading.Thread(target=self._hear, name=f"drill {namespace}", daemon=True)
        self._thread.start()

    def __enter__(self) -> LiveDrill:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the graph; the drill goes on."""
        self._closed = True
        self._wake.set()
        self._thread.join()

    def picture(self) -> Picture:
        """Return what is known now; the same object if nothing new was heard."""
        with self._lock:
            heard = self._heard
            version = heard.version + self._actions.version + self._version
            if self._picture is None or self._picture.version != version:
                self._picture = Picture(
                    namespace=self.namespace,
                    connection=self._connection,
                    run=heard.run,
                    version=version,
                    time=heard.time,
                    status=MappingProxyType(heard.status),
                    latest=MappingProxyType(heard.latest),
                    impact=heard.impact,
                    impacts=heard.impacts,
                    faults=heard.faults,
                    kinds=self._kinds,
                    channels=self._channels,
                    marks=tuple(heard.marks),
                    series=heard.series,
                    statuses=heard.statuses,
                    section=heard.section,
                    refusals=self._refusals,
                    lost=MappingProxyType(self._all_lost()),
                    outcomes=self._actions.outcomes,
                )
            return self._picture

    def act(self, name: str, **arguments: Any) -> int:
        """Queue an action, and return its number; the picture's outcomes show what became of it."""
        number = self._actions.add(name, arguments)
        self._wake.set()
        return number

    # The thread

    def _hear(self) -> None:
        try:
            while not self._closed:
                self._search()
                self._follow()
        except InterruptedWaitError:
            pass
        finally:
            if self._client is not None:
                self._client.close()

    def _open(self, namespace: str) -> DrillClient:
        client = DrillClient(namespace, patience=_ANSWER_PATIENCE, **self._options)  # type: ignore[arg-type]
        client.observe(self._latched)
        client.check_while_waiting(self._check)
        heard = self._heard
        self._telemetry = client.telemetry(
            {
                "contact_force": self._locked(heard.contact_force),
                "actuator_state": self._locked(heard.actuator_state),
                "waveform": self._locked(heard.waveform),
                **{
                    topic: self._locked(lambda *sample, topic=topic: heard.samples(topic, *sample))
                    for topic in SAMPLED
                },
            }
        )
        return client

    def _locked(self, hear: Callable[..., None]) -> Callable[..., None]:
        def locked(*message: Any) -> None:
            with self._lock:
                hear(*message)

        return locked

    def _latched(self, topic: str, message: Any) -> None:
        with self._lock:
            self._heard.latched(topic, message)
        if topic == "status":
            self._status_at = time.monotonic()

    def _check(self) -> None:
        if self._closed:
            raise InterruptedWaitError
        if self._actions.running == "step" and self._actions.waits_for(_INTERRUPTERS):
            raise InterruptedWaitError

    def _search(self) -> None:
        """Wait for the drill; returns when it is found, or when this is to close."""
        while not self._closed:
            if self._client is None:
                self._client = self._open(self.namespace)
            try:
                self._client.found(_SEARCH_PATIENCE)
            except ClientError as error:
                with self._lock:
                    if self._connection.reason != str(error):
                        self._connect(self._connection.state, str(error))
                self._actions.fail_all(str(error))
            else:
                with self._lock:
                    self._connect(CONNECTED, "")
                return

    def _follow(self) -> None:
        client = self._client
        assert client is not None  # it was found
        self._asked_run = 0
        due = 0.0
        while not self._closed:
            client.take()
            while not self._closed and self._actions.execute(client):
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
        with self._lock:
            if (refusals, lost) != (self._refusals, self._lost):
                self._refusals, self._lost = refusals, lost
                self._version += 1
        if run != self._asked_run:
            self._asked_run = run
            try:
                response = client.list_faults()
            except ClientError:
                return  # it may be gone, which the next look shows
            with self._lock:
                self._kinds, self._channels = tuple(response.kinds), tuple(response.channels)
                self._version += 1

    def _lose(self, client: DrillClient, reason: str) -> None:
        with self._lock:
            self._connect(VANISHED, f"the drill in {self.namespace} is gone: {reason}")
            self._lost_before = self._all_lost()
            self._lost = {}
            self._heard.restart()
        # A client knows the drill that it has found; another one needs another client.
        self._client = None
        client.close()

    def _connect(self, state: str, reason: str) -> None:
        since = self._connection.since if state == self._connection.state else time.time()
        self._connection = Connection(state, since, reason)
        self._version += 1

    def _all_lost(self) -> dict[str, int]:
        lost = {**self._lost, **self._heard.journal_lost}
        return {
            topic: lost.get(topic, 0) + self._lost_before.get(topic, 0)
            for topic in {**lost, **self._lost_before}
        }
