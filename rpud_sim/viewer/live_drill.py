"""A running drill as pages see it: one thread that hears it and acts on it."""

from __future__ import annotations

import inspect
import re
import threading
import time
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown
from rpud_sim.ros.client import ClientError, DrillClient, RefusedError
from rpud_sim.ros.client.topics import FastTopics
from rpud_sim.viewer.heard import Heard

# Actions: methods of ``DrillClient``, with the same arguments.
ACTIONS = ("press", "drive", "feed", "engage", "inject", "clear", "pause", "play", "step", "reset")

DONE, REFUSED, FAILED = "done", "refused", "failed"  # no drill, or no answer, is a failure
SEARCHING, CONNECTED, VANISHED = "searching", "connected", "vanished"

_MOST_WAITING = 32
_KEPT = 8  # outcomes
_BEYOND = re.compile(r"\w+ = (\S+)( .+?)? is outside its range [\[(](\S+), (\S+)[\])].*")
_PERIOD = 0.1  # between takes of messages [s]
_CHECK_PERIOD = 0.5  # between looks at events and at the publishers [s]
_SILENCE = 4.0  # of a drill that is gone; a living one publishes a status every second or so [s]
_SEARCH_PATIENCE = 1.0  # s
_ANSWER_PATIENCE = 10.0  # s
_INTERRUPTERS = ("pause", "reset")  # which a step that is under way must not delay


def plain_refusal(reason: str) -> str:
    """Return a drill's reason in fewer words, such as ``9999 V is above 200 V``."""
    if found := _BEYOND.fullmatch(reason):
        value, unit, low, high = (each or "" for each in found.groups())
        with suppress(ValueError):
            if float(value) < float(low):
                return f"{value}{unit} is below {low}{unit}"
            if float(value) > float(high):
                return f"{value}{unit} is above {high}{unit}"
    return reason


class InterruptedWaitError(Exception):
    """Raised inside a wait of the client to end it."""


class Actions:
    """Actions in the order in which they were asked for; any thread may ask."""

    def __init__(self) -> None:
        self.running = ""  # name of the action that is under way; empty for none
        self.waiting: deque[tuple[str, dict[str, Any]]] = deque()  # names and arguments
        self._outcomes: deque[dict[str, Any]] = deque(maxlen=_KEPT)
        self._numbers = count(1)

    @property
    def outcomes(self) -> list[dict[str, Any]]:
        """Of the latest actions that are over, in the order of their ends, as a frame has them."""
        return list(self._outcomes)

    def add(self, name: str, arguments: dict[str, Any]) -> None:
        """Queue an action; one that does not exist is a ParameterError."""
        if name not in ACTIONS:
            raise ParameterError(f"action {shown(name)} is unknown; {did_you_mean(name, ACTIONS)}")
        try:
            inspect.signature(getattr(DrillClient, name)).bind(None, **arguments)
        except TypeError as error:
            raise ParameterError(f"action {name}: {error}") from None
        if len(self.waiting) < _MOST_WAITING:
            self.waiting.append((name, dict(arguments)))
        else:
            self._settle(name, FAILED, f"{_MOST_WAITING} actions wait already")

    def execute(self, client: DrillClient) -> bool:
        """Execute the next action; return whether there was one."""
        if not self.waiting:
            return False
        self.running, given = self.waiting.popleft()
        name = self.running
        state, text = DONE, ""
        try:
            result = getattr(client, name)(**given)
            if name == "inject":
                text = f"fault {result}"
            elif name == "clear":
                text = f"ended: {', '.join(map(str, result)) or 'none'}"
        except InterruptedWaitError:
            state, text = FAILED, "interrupted"
        except ClientError as error:
            state = REFUSED if isinstance(error, RefusedError) else FAILED
            text = plain_refusal(str(error))
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            # Wrong arguments: the thread that hears the drill must not end by them.
            state, text = REFUSED, plain_refusal(str(error))
        finally:
            self.running = ""
        self._settle(name, state, text)
        return True

    def fail_all(self, reason: str) -> None:
        """Let all actions that wait fail for a reason."""
        while self.waiting:
            self._settle(self.waiting.popleft()[0], FAILED, reason)

    def _settle(self, name: str, state: str, text: str) -> None:
        number = next(self._numbers)
        self._outcomes.append({"number": number, "name": name, "state": state, "text": text})


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
        self._domain_id = domain_id
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._closed = False
        self._heard = Heard()
        self._lost_before: Counter[str] = Counter()  # by clients that are closed
        self._telemetry: FastTopics | None = None
        self._status_at = self._settled_at = 0.0
        # Here, so that the caller gets the error of a namespace that ROS does not allow.
        self._client: DrillClient | None = self._open(namespace)
        self.namespace = self._client.namespace
        self.connection: dict[str, Any] = {}
        self._connect(SEARCHING, f"no drill in {self.namespace} yet")
        self._thread = threading.Thread(target=self._live, name=f"drill {namespace}", daemon=True)
        self._thread.start()

    @property
    def gone(self) -> bool:
        return bool(self.error) or self.connection["state"] == VANISHED

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

    def act(self, name: str, arguments: dict[str, Any]) -> None:
        """Queue an action."""
        self.actions.add(name, arguments)
        self._wake.set()

    # The thread

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
            for result in message.results[message.repeated :]:
                if not result.accepted:
                    with self._lock:
                        self._heard.refuse(plain_refusal(result.reason))
            return
        with self._lock:
            self._heard.latched(topic, message)
        if topic == "status":
            self._status_at = time.monotonic()

    def _check(self) -> None:
        waiting = {name for name, _ in tuple(self.actions.waiting)}
        long = self.actions.running == "step" and not waiting.isdisjoint(_INTERRUPTERS)
        if self._closed or long:
            raise InterruptedWaitError
        self._settle()  # a long step shows what happens

    def _settle(self) -> None:
        # A block of the waveform is shown at the next time: its impacts need a while to arrive.
        if (now := time.monotonic()) - self._settled_at >= 0.9 * _PERIOD:
            self._settled_at = now
            with self._lock:
                self._heard.settle()

    def _live(self) -> None:
        try:
            while not self._closed:
                # A client knows the drill that it has found; another one needs another client.
                self._client = self._client or self._open(self.namespace)
                try:
                    self._client.found(_SEARCH_PATIENCE)
                except ClientError as error:
                    self._connect(self.connection["state"], str(error))
                    self.actions.fail_all(str(error))
                    continue
                self._connect(CONNECTED, "")
                if reason := self._follow(self._client):
                    self._connect(VANISHED, f"the drill in {self.namespace} is gone: {reason}")
                    with self._lock:
                        self._heard.restart()
                    self._client.close()
                    self._client = None
        except InterruptedWaitError:
            pass
        except Exception as error:  # pages say it, and end
            self.error = f"{type(error).__name__}: {error}"
            raise
        finally:
            if self._client is not None:
                self._client.close()

    def _follow(self, client: DrillClient) -> str:
        """Hear the drill and act on it; return why it is gone, empty if this is to close."""
        due, asked_run = 0.0, -1
        while not self._closed:
            client.take()
            self._settle()
            while not self._closed and self.actions.execute(client):
                pass
            if (now := time.monotonic()) >= due:
                due = now + _CHECK_PERIOD
                client.spin()
                if not client.publishers:
                    return "it has left"
                if now - self._status_at > _SILENCE:
                    return f"it has published no status for {_SILENCE:g} s"
                if (run := self._heard.run) != asked_run:
                    with suppress(ClientError):  # asked again, unless it is gone
                        response = client.list_faults()
                        self.kinds, self.channels = tuple(response.kinds), tuple(response.channels)
                        asked_run = run
            self._wake.wait(_PERIOD)
            self._wake.clear()
        return ""

    def _connect(self, state: str, reason: str) -> None:
        is_new = state != self.connection.get("state")
        since = time.time() if is_new else self.connection["since"]
        self.connection = {"state": state, "since": since, "reason": reason}
