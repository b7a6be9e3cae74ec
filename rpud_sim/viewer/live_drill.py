"""Running drill as pages see it: its history, and one thread that feeds it and acts."""

from __future__ import annotations

import inspect
import json
import re
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from itertools import count
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import QUANTITIES, ParameterError, did_you_mean, shown
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.ros.client import ClientError, DrillClient, RefusedError
from rpud_sim.ros.client.topics import FIELDS, FastTopics
from rpud_sim.simulation.batch import Batch
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.viewer.bins import Bins
from rpud_sim.viewer.history import MOTION, SECTION, History, Signal, plain_status

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

BIN = 0.05  # length of the finest bins [s]
_BINS = 1 << 14
_GREATEST = 2**61  # size of a time with which all calculations fit int64 [ns]
_JOINING = 0.2  # after the first message, in which other topics may not be heard yet [s]
_LATEST_IMPACTS = 8192  # whose durations are kept: half a second of the densest
_MOST_SAMPLES = 1200  # of a section
_ALWAYS = (  # quantities that each drill has, also before the first message or impact
    *("peak_force", "impact_rate", "reacting_force"),
    *("nodal_plane", "free_mass", "drill_tool"),
)
_TOPICS = {TOPICS[name].type.rpartition("/")[2]: name for name in (*FIELDS, "status")}
_SIGNALS = tuple(
    Signal(_TOPICS[kind], TOPICS[_TOPICS[kind]].type, field)
    for quantity in QUANTITIES.values()
    for kind, _, field in (source.partition(".") for source in quantity.sources)
)

Block = tuple[float, float, tuple[np.ndarray, ...]]  # begin [s], sample period [s], samples


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


class LiveHistory(History):
    """History of the present run of a drill; not safe for threads by itself.

    Fast messages wait in lists until ``settle``. Messages before the journal's stamp of time zero
    are left out, except the latest status and faults, which are kept for that moment.
    """

    live = True
    most = 60_000

    def __init__(self) -> None:
        self.run = 0
        self.journal_lost = 0
        self._kept: dict[str, Any] = {}  # latest latched message by topic
        self._journal_next = 0
        self._waiting: dict[str, list[tuple[int, tuple[Any, ...]]]] = {
            topic: [] for topic in (*FIELDS, "waveform")
        }
        super().__init__("", _SIGNALS, ())

    def clear(self, _: object = ()) -> None:
        names = [signal.name for signal in _SIGNALS]
        super().clear([Bins(names, BIN, _BINS, newest=True), Bins(names, BIN, _BINS)])
        # Of the run: stamps from which on an origin counts, ascending, and the origins [ns].
        self._origins: list[tuple[int, int]] = []
        self.status: dict[str, Any] = {}
        self.latest_impacts: deque[tuple[float, float, float]] = deque(maxlen=_LATEST_IMPACTS)
        # Of the waveform: the newest whose impacts were heard too, and the newest of all.
        self.block: Block | None = None
        self._newest: Block | None = None
        self._latest: dict[str, tuple[Any, ...]] = {}
        for waiting in self._waiting.values():
            waiting.clear()

    def restart(self) -> None:
        """Forget the drill: what comes next is of another one, which numbers from zero."""
        self._origins = []
        self._kept = {}
        self._journal_next = 0

    def sinks(self) -> dict[str, Callable[..., object]]:
        """Return, by topic, a function that keeps stamp and values for ``settle``."""

        def keep(waiting: list[tuple[int, tuple[Any, ...]]], *message: Any) -> None:
            waiting.append(message)

        return {topic: partial(keep, waiting) for topic, waiting in self._waiting.items()}

    def latched(self, topic: str, message: Any) -> None:
        """Take in a message of the journal, the status or the faults."""
        self._changes += 1
        if topic == "journal":
            self._journal(message)
        else:
            self._kept[topic] = message
            if self._origins:
                self._show(topic, message)

    def refuse(self, reason: str) -> None:
        """Note that the drill has refused a command."""
        self.log_version += 1
        self.commands.refuse(self.time or 0.0, reason)

    def settle(self) -> None:
        """Take in the fast messages that wait."""
        newest = self._newest
        # Impacts have a topic, a beginning and delays of their own.
        joined = self.since < 2.0 * BIN or (newest and newest[0] > self.since + _JOINING)
        if newest is not self.block and joined:
            self.block = newest
            self._changes += 1
        for topic, waiting in self._waiting.items():
            if waiting and self._origins:
                self._settle(topic, waiting)
            waiting.clear()

    @property
    def values(self) -> dict[str, dict[str, Any]]:
        """Latest values of the fast topics: by topic, by field."""
        return {
            topic: dict(zip(FIELDS[topic], values, strict=True))
            for topic, values in self._latest.items()
        }

    def has(self, quantity: str) -> bool:
        return quantity in _ALWAYS or super().has(quantity)

    def moment(self, time: float) -> dict[str, Any]:
        return {"values": self.values, "numbers": self.numbers(time)}

    def whole(self) -> dict[str, Any]:
        return {"timeline": self.timeline(), "hole": self.hole(self.time or 0.0)}

    def section_key(self, time: float) -> Any:
        return (self.block[0], self.impacts.total) if self.block else None

    def section(self, time: float) -> dict[str, Any] | None:
        """Return the field ``section`` of a frame: the end of the newest block."""
        assert self.block
        begin, period, arrays = self.block
        length = len(arrays[0])
        first = max(0, length - max(2, round(SECTION / period)))
        stride = -(-(length - first) // _MOST_SAMPLES)
        start, end = begin + first * period, begin + length * period
        samples = {
            name: array[first::stride].astype(np.float32)
            for name, array in zip(MOTION, arrays, strict=False)
        }
        impacts = [[at - start, *rest] for at, *rest in self.latest_impacts if start <= at < end]
        return {**samples, "time": start, "period": period * stride, "impacts": impacts}

    def _settle(self, topic: str, waiting: list[tuple[int, tuple[Any, ...]]]) -> None:
        stamps, messages = zip(*waiting, strict=True)
        times = self._times(np.array(stamps, np.int64))
        if times[-1] < 0:
            return
        if not self._latest and self._newest is None:
            self.since = max(0.0, float(times[0]) / SECOND)
        self.time = max(self.time or 0.0, float(times[-1]) / SECOND)
        if topic == "waveform":
            self._wave(times / SECOND, messages)
            return
        self._latest[topic] = messages[-1]
        fields = dict(zip(FIELDS[topic], zip(*messages, strict=True), strict=True))
        if topic == self.struck:
            impacts = times / SECOND, fields["peak_force"], fields["contact_duration"]
            self.latest_impacts.extend(zip(*impacts, strict=True))
        drawn = {name: each for name, each in fields.items() if f"{topic} {name}" in self.signals}
        columns = {name: np.array(each, float) for name, each in drawn.items()}
        self.add(Batch(topic, times, columns))

    def _wave(self, times: np.ndarray, messages: tuple[tuple[Any, ...], ...]) -> None:
        self._changes += 1
        for begin, (_, period, arrays) in zip(times.tolist(), messages, strict=True):
            length = len(arrays[0])
            if not (length and 0.0 < period < 1.0 and all(len(each) == length for each in arrays)):
                continue
            if self._newest is not None and length * period < SECTION:  # a pause has cut it
                before, _, earlier = self._newest
                if abs(before + len(earlier[0]) * period - begin) < period:
                    earlier = tuple(each[-round(SECTION / period) :] for each in earlier)
                    begin -= len(earlier[0]) * period
                    arrays = tuple(map(np.concatenate, zip(earlier, arrays, strict=True)))
            self._newest = begin, period, arrays

    def _times(self, stamps: np.ndarray) -> np.ndarray:
        """Return the simulation times of stamps, both (n,) [ns]."""
        edges, origins = np.array(self._origins).T
        return stamps - origins[np.maximum(np.searchsorted(edges, stamps, "right") - 1, 0)]

    def _journal(self, entry: Any) -> None:
        number = int(entry.sequence)
        if self._journal_next:
            self.journal_lost += max(0, number - self._journal_next)
        self._journal_next = number + 1
        content: Any = {}
        with suppress(RecursionError, ValueError):  # another program may publish there too
            content = json.loads(entry.content)
        time = content.get("time") if isinstance(content, dict) else None
        if not isinstance(time, int) or abs(time) > _GREATEST:
            return
        stamp = _stamp(entry)
        origin = stamp - time
        if entry.kind == "begin":
            # Where the clock goes back, a later status belongs to the run before. Faults are not
            # repeated: those may be the newest ones, heard before the journal.
            status = self._kept.get("status")
            back = bool(self._origins) and origin <= self._origins[-1][1]
            if back and status and _stamp(status) > stamp:
                del self._kept["status"]
            self.run += 1
            self.clear()
        if not self._origins or self.time is None:
            self._origins = [(stamp, origin)]
            for topic, message in self._kept.items():
                if _stamp(message) >= origin:
                    self._show(topic, message)
        elif origin != self._origins[-1][1]:  # the run goes on with other stamps
            self._origins = [each for each in self._origins if each[0] < stamp]
            self._origins.append((stamp, origin))
            self.time = min(self.time, time / SECOND)
        self.add_entry(time / SECOND, entry.kind, content)

    def _show(self, topic: str, message: Any) -> None:
        stamp = _stamp(message)
        times = self._times(np.array([stamp]))
        origin = stamp - int(times[0])
        if topic == "faults":
            self.add_faults(self.run, message.faults, origin)
            return
        names = message.get_fields_and_field_types()
        self.status = plain_status({name: getattr(message, name) for name in names}, origin)
        self.time = max(self.time or 0.0, float(times[0]) / SECOND)
        columns = {
            name: np.array([value], float)
            for name, value in self.status.items()
            if f"{topic} {name}" in self.signals
        }
        self.add(Batch(topic, times, columns))


def _stamp(message: Any) -> int:
    stamp = message.header.stamp
    return join_seconds(stamp.sec, stamp.nanosec)


class LiveDrill:
    """Hears one drill in a thread of its own, keeps what it has heard, and acts on it.

    Any number of pages share it. ``connection`` is ``searching``, ``connected`` or ``vanished``,
    since when [Unix s], and why.

    The drill need not be there at first. If it vanishes, the connection says so and the thread
    searches it again; what was heard stays until another run begins, whose number is
    ``history.run``. Actions are executed in order, as methods of ``DrillClient``; a pause or reset
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
        self._history = LiveHistory()
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
        return dict(self._lost_before + lost + Counter(journal=self._history.journal_lost))

    @contextmanager
    def reading(self) -> Iterator[LiveHistory]:
        """Return what was heard, which does not change meanwhile."""
        with self._lock:
            yield self._history

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
        self._telemetry = client.telemetry(self._history.sinks())
        return client

    def _latched(self, topic: str, message: Any) -> None:
        if topic == "command_results":
            for result in message.results[message.repeated :]:
                if not result.accepted:
                    with self._lock:
                        self._history.refuse(plain_refusal(result.reason))
            return
        with self._lock:
            self._history.latched(topic, message)
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
                self._history.settle()

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
                if (run := self._history.run) != asked_run:
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
