"""Running drills for pages: threads that subscribe to them and command them, and their frames."""

from __future__ import annotations

import inspect
import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import count
from typing import Any

from rpud_sim.foundation.options import NAMESPACE
from rpud_sim.foundation.quantities import ExpectedError, ParameterError, did_you_mean, short_repr
from rpud_sim.foundation.shown_quantities import QUANTITIES, number_text
from rpud_sim.ros.client import ClientError, DrillClient, RefusedError
from rpud_sim.ros.client.listening_node import DrillFinder
from rpud_sim.ros.client.topics import FastTopics
from rpud_sim.simulation.fault_kinds import fault_forms
from rpud_sim.viewer.commands import plain_refusal
from rpud_sim.viewer.frames import ClientState, Store
from rpud_sim.viewer.live_history import FAST, REPORTS, LiveHistory
from rpud_sim.viewer.server import EXPIRY, ListenAddress, PageServer

# Actions: methods of ``DrillClient``, with the same arguments.
ACTIONS = ("press", "drive", "feed", "engage", "inject", "clear", "pause", "play", "step", "reset")

DONE, REFUSED, FAILED = "done", "refused", "failed"  # no drill, or no answer, is a failure
SEARCHING, CONNECTED, VANISHED = "searching", "connected", "vanished"

_MOST_WAITING = 32
_KEPT = 8  # outcomes
_PERIOD = 0.1  # between takes of messages [s]
_CHECK_PERIOD = 0.5  # between looks at events and at the publishers [s]
_SILENCE = 4.0  # of a drill that is gone; a living one publishes a status every second or so [s]
_SEARCH_PATIENCE = 1.0  # s
_ANSWER_PATIENCE = 10.0  # s
_SILENT = 2  # from so many whole seconds without a status on, pages show it
_INTERRUPTERS = ("pause", "reset")  # which a step that is under way must not delay

MOST_DRILLS = 16  # with subscriptions; for a further one, a drill that has ended is forgotten

_GAP = 1.0  # shortest time before the first message that is shown as a gap [s]
_LOOK_PERIOD = 3.0  # between looks at the namespaces [s]
# Rows of "timing", and what timing or status have for them.
_TIMING = {
    "latest block of the last report": "lateness_max",
    "behind its schedule": "lag",
    "real-time factor": "real_time_factor",
    "deadlines missed": "deadlines_missed",
    "messages dropped by the drill": "messages_dropped",
    "commands accepted": "commands_accepted",
    "commands overwritten": "commands_discarded",
    "commands rejected": "commands_rejected",
    "commanders": "commanders",
}


class InterruptedWaitError(Exception):
    """Raised inside a wait of the client to end it."""


class Actions:
    """Actions in the order in which they were asked for; any thread may ask."""

    def __init__(self) -> None:
        self.running = ""  # name of the action that is under way; empty for none
        self.given: dict[str, Any] = {}  # arguments of the latest one
        self.ended = 0.0  # when an action ended last, by the monotonic clock [s]
        self.waiting: deque[tuple[str, dict[str, Any], float, str]] = deque()  # last: the asker
        self._outcomes: deque[dict[str, Any]] = deque(maxlen=_KEPT)
        self._numbers = count(1)

    @property
    def outcomes(self) -> list[dict[str, Any]]:
        """Of the latest actions that are over, in the order of their ends, as a frame has them."""
        return list(self._outcomes)

    def add(self, name: str, arguments: dict[str, Any], asker: str = "") -> None:
        """Queue an action of an asker; one that does not exist is a ParameterError."""
        if name not in ACTIONS:
            raise ParameterError(
                f"action {short_repr(name)} is unknown{did_you_mean(name, ACTIONS)}"
            )
        try:
            inspect.signature(getattr(DrillClient, name)).bind(None, **arguments)
        except TypeError as error:
            raise ParameterError(f"action {name}: {error}") from None
        if len(self.waiting) < _MOST_WAITING:
            self.waiting.append((name, dict(arguments), time.monotonic(), asker))
        else:
            self._settle(name, asker, FAILED, f"{_MOST_WAITING} actions wait already")

    def execute(self, client: DrillClient) -> bool:
        """Execute the next action; return whether there was one."""
        if not self.waiting:
            return False
        name, given, asked, asker = self.waiting.popleft()
        if (waited := time.monotonic() - asked) > EXPIRY:
            self._settle(name, asker, FAILED, f"expired: it waited for {waited:.0f} s")
            return True
        self.running, self.given = name, given
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
            # Wrong arguments: the thread of the drill must not end by them.
            state, text = REFUSED, plain_refusal(str(error))
        finally:
            self.running, self.ended = "", time.monotonic()
        self._settle(name, asker, state, text)
        return True

    def fail_all(self, reason: str) -> None:
        """Let all actions that wait fail for a reason."""
        while self.waiting:
            name, _, _, asker = self.waiting.popleft()
            self._settle(name, asker, FAILED, reason)

    def _settle(self, name: str, asker: str, state: str, text: str) -> None:
        found = {"number": next(self._numbers), "name": name, "asker": asker}
        self._outcomes.append({**found, "state": state, "text": text})


class LiveDrill:
    """Subscribes to one drill in a thread, keeps its messages, and commands it.

    Any number of pages share it. ``connection`` is ``searching``, ``connected`` or ``vanished``,
    since when [Unix s], and why.

    The drill need not be there at first. If it vanishes, the connection reports it and the thread
    searches it again; received messages stay until another run begins, whose number is
    ``history.run``. Actions are executed in order, as methods of ``DrillClient``; a pause or reset
    ends the wait for a step that is under way. ``error`` gives the reason why the thread has ended.
    """

    def __init__(self, namespace: str, domain_id: int | None = None) -> None:
        self.error = ""
        self.actions = Actions()
        self.kinds: dict[str, dict[str, Any]] = {}  # of faults that can be injected now: forms
        self._domain_id = domain_id
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._closed = False
        self._history = LiveHistory()
        self._lost_before: Counter[str] = Counter()  # by clients that are closed
        self._telemetry: FastTopics | None = None
        self._status_at = self._settled_at = self._stepped_from = 0.0
        # Here, so that the caller gets the error of a namespace that ROS does not allow.
        self._client: DrillClient | None = self._open(namespace)
        self.namespace = self._client.namespace
        self.connection: dict[str, Any] = {}
        self._connect(SEARCHING, f"no drill in {self.namespace} yet")
        self._thread = threading.Thread(target=self._live, name=f"drill {namespace}", daemon=True)
        self._thread.start()

    @property
    def silent(self) -> int:
        """Whole seconds without a status of a connected drill; 0 while they come, and in a step."""
        age = int(time.monotonic() - max(self._status_at, self.actions.ended))
        heard = age < _SILENT or self.actions.running == "step"
        return 0 if heard or self.connection["state"] != CONNECTED else age

    @property
    def stepping(self) -> list[float]:
        """Passed time and length of the step that is under way [s]; empty without one."""
        seconds, now = self.actions.given.get("seconds"), self._history.time or 0.0
        if self.actions.running != "step" or not isinstance(seconds, int | float):
            self._stepped_from = now
            return []
        return [round(now - self._stepped_from, 1), float(seconds)]

    @property
    def gone(self) -> bool:
        return bool(self.error) or self.connection["state"] == VANISHED

    def close(self) -> None:
        """Leave the graph; the drill continues."""
        self._closed = True
        self._wake.set()
        self._thread.join()

    @property
    def lost(self) -> dict[str, int]:
        """Messages by topic that were sent and never arrived."""
        lost = Counter(self._telemetry.lost if self._telemetry else ())
        return dict(self._lost_before + lost + Counter(journal=self._history.journal_lost))

    @contextmanager
    def reading(self) -> Iterator[LiveHistory]:
        """Return the received messages, which do not change meanwhile."""
        with self._lock:
            yield self._history

    def act(self, name: str, arguments: dict[str, Any], asker: str = "") -> None:
        """Queue an action."""
        self.actions.add(name, arguments, asker)
        self._wake.set()

    # The thread

    def _open(self, namespace: str) -> DrillClient:
        client = DrillClient(namespace, self._domain_id, "rpud_watch", _ANSWER_PATIENCE)
        client.observe(self._latched)
        client.observe(self._latched, *REPORTS)
        client.check_while_waiting(self._check)
        if self._telemetry is not None:
            self._lost_before += Counter(self._telemetry.lost)
        self._telemetry = client.telemetry(FAST)
        return client

    def _latched(self, topic: str, message: Any, published: int) -> None:
        with self._lock:
            self._history.latched(topic, message, published)
        if topic == "status":
            self._status_at = time.monotonic()

    def _check(self) -> None:
        waiting = {name for name, *_ in tuple(self.actions.waiting)}
        long = self.actions.running == "step" and not waiting.isdisjoint(_INTERRUPTERS)
        if self._closed or long:
            raise InterruptedWaitError
        self._settle()  # a long step shows what happens

    def _settle(self) -> None:
        # A block of the waveform is shown at the next time: its impacts need a while to arrive.
        if (now := time.monotonic()) - self._settled_at >= 0.9 * _PERIOD:
            self._settled_at = now
            if telemetry := self._telemetry:
                with self._lock:
                    self._history.settle(telemetry.batches(), telemetry.lost)

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
                        self._history.restart()
                    self._client.close()
                    self._client = None
        except InterruptedWaitError:
            pass
        except Exception as error:  # pages show it, and end
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
            if self._history.held:
                self._complete(client)
            self._settle()
            while not self._closed and self.actions.execute(client):
                pass
            if (now := time.monotonic()) >= due:
                due = now + _CHECK_PERIOD
                client.spin()
                if not client.publishers:
                    return "it has left"
                if now - max(self._status_at, self.actions.ended) > _SILENCE:
                    return f"it has published no status for {_SILENCE:g} s"
                if (run := self._history.run) != asked_run:
                    with suppress(ClientError):  # asked again, unless it is gone
                        response = client.list_faults()
                        self.kinds = fault_forms(response.kinds, response.channels)
                        asked_run = run
            self._wake.wait(_PERIOD)
            self._wake.clear()
        return ""

    def _complete(self, client: DrillClient) -> None:
        """Request from the drill the entries of the journal that the received ones need."""
        wanted, first = self._history.needed, self._history.held[0][0].sequence
        with suppress(ClientError):  # received messages are shown all the same
            while wanted < first and (page := client.journal(wanted)):
                with self._lock:
                    self._history.complete(entry for entry in page if entry.sequence < first)
                wanted = page[-1].sequence + 1
        with self._lock:
            self._history.release()

    def _connect(self, state: str, reason: str) -> None:
        is_new = state != self.connection.get("state")
        since = time.time() if is_new else self.connection["since"]
        self.connection = {"state": state, "since": since, "reason": reason}


class LiveStore(Store):
    """Drills of a domain; one thread listens to each, however many pages show it.

    Subscriptions last from a drill's first page on, so that later pages show its past. A page that
    names no drill shows the drill of ``namespace``, which may start later.
    """

    mode = "live"

    def __init__(self, finder: DrillFinder, namespace: str = NAMESPACE) -> None:
        self.heard: dict[str, LiveDrill] = {}  # drills by namespace
        self.finder = finder
        self._default = f"/{namespace.strip('/')}"
        self._namespaces: list[str] = []
        self._looked = -math.inf

    def open(self, client: ClientState) -> None:
        """Subscribe to the drill of a browser; an error if it is unknown, or one too many."""
        client.drill = f"/{(client.drill or self._default).strip('/')}"
        self.hear(client.drill)

    def hear(self, name: str = "") -> None:
        """Follow a drill from now on; by default the one for pages that name none."""
        name = name or self._default
        if name in self.heard and not self.heard[name].error:
            return
        if name not in (self._default, *self._look()):
            raise ExpectedError(f"there is no drill in {name}")
        gone = [each for each, drill in self.heard.items() if drill.gone]
        if len(self.heard) >= MOST_DRILLS and gone:
            self.heard.pop(gone[0]).close()
        if len(self.heard) >= MOST_DRILLS:
            raise ExpectedError(f"{MOST_DRILLS} drills are shown already: start another server")
        self.heard[name] = LiveDrill(name, self.finder.domain_id)  # its thread may do better

    def end(self) -> None:
        """Hear no more of any drill."""
        for drill in self.heard.values():
            drill.close()
        self.heard.clear()

    @contextmanager
    def shown(self, client: ClientState) -> Iterator[tuple[LiveHistory, Mapping[str, Any]]]:
        if time.monotonic() - self._looked >= _LOOK_PERIOD:
            self._look()
        drill = self._heard(client)
        if drill.error:
            raise ExpectedError(f"the thread of {drill.namespace} has ended: {drill.error}")
        with drill.reading() as history:
            yield history, self._state(drill, history)

    def request(self, client: ClientState, name: str, content: Any) -> None:
        """Queue an action."""
        if name != "act":
            raise ParameterError(f"a running drill has no {short_repr(name)}")
        drill = self._heard(client)
        if drill.silent:
            raise ParameterError(f"not sent: {drill.namespace} is silent for {drill.silent} s")
        drill.act(content["name"], content["arguments"], content["id"])

    def _heard(self, client: ClientState) -> LiveDrill:
        if client.drill not in self.heard:
            raise ExpectedError(f"{client.drill} has gone")
        return self.heard[client.drill]

    def _look(self) -> list[str]:
        self._looked = time.monotonic()
        self._namespaces = self.finder.drills()
        return self._namespaces

    def _state(self, drill: LiveDrill, history: LiveHistory) -> dict[str, Any]:
        status, since = history.reports.get("status", {}), history.since
        counts = {**status, **history.reports.get("timing", {})}
        state = {
            "run": history.run,
            "drills": sorted({*self._namespaces, drill.namespace}),
            "drill": drill.namespace,
            "connection": drill.connection,
            "silent": drill.silent,
            "stepping": drill.stepping,
            "kinds": drill.kinds,
            "losses": drill.lost,
            "outcomes": drill.actions.outcomes,
            "status": status,
            "timing": {
                label: QUANTITIES["lateness"].text(counts[name])
                if name in ("lateness_max", "lag")
                else number_text(float(counts[name]))
                for label, name in _TIMING.items()
                if name in counts
            },
        }
        if history.time is not None:
            state |= {"now": history.time, "extent": [0.0, history.time]}
            state["gaps"] = [[0.0, since]] if since > _GAP else []
        return state


def serve_drills(
    place: ListenAddress,
    domain_id: int | None,
    namespace: str,
    announce: Callable[[PageServer, LiveStore], object],
) -> None:
    """Serve a screen for each drill until SIGINT or SIGTERM.

    ``announce`` is called once the server listens. A page without a namespace shows the drill of
    ``namespace``.
    """
    with DrillFinder(domain_id) as finder:
        store = LiveStore(finder, namespace)
        try:
            with PageServer(store, place) as server:
                announce(server, store)
                server.run()
        finally:
            store.end()
