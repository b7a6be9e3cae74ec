"""Drill of a test: steps in lockstep with the nodes under test, and what was published."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from rpud_msgs.msg import Status

from rpud_sim.foundation.quantities import ParameterError, Quantity, did_you_mean, shown_name
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.client import ClientError, DrillClient, NoAnswerError
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.testing.answers import Answers
from rpud_sim.testing.collector import Collector
from rpud_sim.testing.domains import applied
from rpud_sim.testing.drill_process import NO_FAULTS, DrillProcess
from rpud_sim.testing.errors import DrillError, LostMessagesError
from rpud_sim.testing.heard_topic import HeardTopic
from rpud_sim.testing.systems import Systems, SystemUnderTest

PERIOD = 0.1
"""Simulation time of one step, and between two answers, unless another one is given [s]."""

_START = 180.0  # that a drill may take to start, which compiles where nothing is compiled yet [s]
_PATIENCE = 60.0  # that the drill may take to answer or to publish [s]
_LONGEST_ADVANCE = SECOND  # in one go: the middleware keeps some thousand messages [ns]
_SECONDS = Quantity("s", "a simulation time", 1e-9, 1e6)
_REAL_SECONDS = Quantity("s", "a time limit", 0.0, 1e6, exclusive=True)
_COUNT = Quantity("", "a number of messages", 1, 1e6, whole=True)

Value = TypeVar("Value")


class Drill:
    """Drill in lockstep: simulation time passes in steps alone.

    A step is over when all that the drill has published up to its stamp is here, and every declared
    answer of the nodes under test. So a test gives the same result on every machine, at any load.

    Args:
        process: of the drill, just started.
        folder: in which commands and relative paths of the test are.

    Raises:
        DrillError: if the drill does not start.
    """

    def __init__(self, process: DrillProcess, folder: Path | None = None) -> None:
        self._process = process
        with applied(process.environment):
            self._client = DrillClient(
                process.namespace, process.domain, node_name="drill_test_client", patience=_PATIENCE
            )
            self._collector = Collector(
                self._client.node.context, process.namespace, f"{process.namespace}/drill_node"
            )
        self._answers = Answers(self._collector)
        self._systems = Systems(self._collector, self._answers, process.environment)
        self.folder = folder
        self._introduced = False  # whether the nodes that answer are known to be connected
        self.log: list[tuple[float, str]] = []
        """Commands of the test: simulation time [s] and text."""
        try:
            self._await_start()
        except BaseException:
            self.close()
            raise

    @property
    def environment(self) -> dict[str, str]:
        """Environment for a process under test: ROS domain and loopback."""
        return dict(self._process.environment)

    @property
    def domain(self) -> int:
        """ROS domain of the drill."""
        return self._process.domain

    @property
    def namespace(self) -> str:
        """Namespace of the drill."""
        return self._process.namespace

    @property
    def client(self) -> DrillClient:
        """Client of the drill, for what this class has no method for."""
        return self._client

    @property
    def time(self) -> float:
        """Simulation time that was reached [s]."""
        return self._collector.time / SECOND

    @property
    def status(self) -> Any:
        """Latest status of the drill, a ``rpud_msgs/Status``."""
        return self.latest("status")

    @property
    def output(self) -> str:
        """All that the drill's process has printed."""
        return self._process.process.output

    @property
    def systems(self) -> tuple[SystemUnderTest, ...]:
        """Processes under test that this test has started."""
        return self._systems.processes

    @property
    def heard(self) -> dict[str, HeardTopic]:
        """Everything that was published since the test began, by absolute topic."""
        return dict(self._collector.topics)

    # Time.

    def step(self, seconds: float | None = None) -> float:
        """Advance, and return the simulation time that is reached [s].

        With declared answers, a longer step is divided at each of their times.

        Args:
            seconds: of simulation time; None for the time between two answers.

        Raises:
            SystemUnderTestError: if a node under test has died, or does not answer.
            LostMessagesError: if messages of the drill are lost.
        """
        length = _SECONDS.check("step", PERIOD if seconds is None else seconds)
        if seconds is None and self._answers.period:
            end = self._next_answer()
        else:
            end = self._collector.time + round(length * SECOND)
        while self._collector.time < end:
            self._advance(min(end, self._next_answer() if self._answers.period else end))
        return self.time

    def step_until(
        self, condition: Callable[[], object], timeout: float, period: float | None = None
    ) -> float:
        """Step until a condition holds, and return the simulation time [s].

        Args:
            condition: looked at before the first step and after each.
            timeout: longest simulation time [s].
            period: of the steps [s]; None for the time between two answers.

        Raises:
            AssertionError: if it does not hold within the time.
        """
        limit = _SECONDS.check("timeout", timeout)
        end = self._collector.time + round(limit * SECOND)
        while not condition():
            left = end - self._collector.time
            if left <= 0:
                raise AssertionError(
                    f"not within {limit:g} s of simulation time, at {self.time:.3f} s: "
                    f"{_described(condition)}; {self._summary()}"
                )
            planned = self._next_answer() if self._answers.period else self._collector.time
            ahead = planned - self._collector.time or round(PERIOD * SECOND)
            if period is not None:
                ahead = round(_SECONDS.check("period", period) * SECOND)
            self.step(min(ahead, left) / SECOND)
        return self.time

    # Commands.

    def press(self, force: float) -> None:
        """Command a weight on bit [N]; see ``DrillClient.press``."""
        self._act(f"press {force:g} N", lambda: self._client.press(force))

    def drive(
        self, enabled: bool = True, voltage: float | None = None, frequency: float | None = None
    ) -> None:
        """Command the drive; see ``DrillClient.drive``."""
        self._act(
            f"drive {enabled} voltage={voltage} frequency={frequency}",
            lambda: self._client.drive(enabled, voltage, frequency),
        )

    def engage(self, on: bool = True) -> None:
        """Put the drill tool into the rock, or take it out."""
        self._act(f"engage {on}", lambda: self._client.engage(on))

    def inject(
        self,
        kind: str,
        channel: str = "",
        magnitude: float | None = None,
        duration: float | None = None,
    ) -> int:
        """Inject a fault and return its number; see ``DrillClient.inject``."""
        return self._act(
            f"inject {kind} channel={channel!r} magnitude={magnitude} duration={duration}",
            lambda: self._client.inject(kind, channel, magnitude, duration),
        )

    def clear(self, which: int | str = "all") -> list[int]:
        """End active faults and return their numbers; see ``DrillClient.clear``."""
        return self._act(f"clear {which}", lambda: self._client.clear(which))

    def set_parameters(self, **values: Any) -> None:
        """Set parameters of the drill; the next test has those of its start again."""
        text = " ".join(f"{name}={value}" for name, value in values.items())
        self._act(f"set {text}", lambda: self._client.set_parameters(**values))

    # What was published.

    def listen(self, topic: str, kind: str = "") -> None:
        """Keep the messages of a topic from now on.

        All topics of the drill are kept from the beginning, but ``waveform`` and ``trajectory``.

        Args:
            topic: of any node; a relative name is one of the drill's namespace.
            kind: type such as ``std_msgs/msg/String``; may be empty if somebody publishes it.
        """
        heard = self._collector.subscribe(topic, kind)
        if heard is None:
            raise ParameterError(
                f"nobody publishes {self._collector.resolve(topic)}; give its type"
            )
        if topic in TOPICS:
            self._systems.await_connections()
            if heard.number is None:
                heard.number = self._collector.published[topic]

    def messages(self, topic: str) -> list[Any]:
        """Return all messages of a topic since the test began.

        Raises:
            ParameterError: if the topic was not listened to.
            LostMessagesError: if some are lost.
        """
        heard = self._heard(topic)
        if heard.lost:
            raise LostMessagesError(f"{heard.lost} messages of {heard.name} are lost")
        return heard.messages()

    def latest(self, topic: str) -> Any:
        """Return the latest message of a topic, None without one."""
        return self._heard(topic).latest()

    # Nodes under test.

    def with_answers(
        self,
        *topics: str,
        kind: str = "",
        count: int = 1,
        period: float = PERIOD,
        timeout: float = 10.0,
    ) -> Drill:
        """Declare how the nodes under test answer; a step is over when all have answered.

        Args:
            topics: on which a node publishes when it has done its work for a stamp: with a header
                or a time, that stamp; otherwise one more message.
            kind: type of the topics; may be empty: that of the publisher.
            count: messages of each topic for one stamp.
            period: simulation time between two answers: they are due at its multiples [s].
            timeout: longest real time for the answers to one step [s].
        """
        answers = self._answers
        answers.period = round(_SECONDS.check("period", period) * SECOND) if topics else 0
        answers.timeout = _REAL_SECONDS.check("timeout", timeout)
        answers.declare(topics, kind, int(_COUNT.check("count", count)))
        self._introduced = False
        self._note(f"with_answers {' '.join(topics)} period={period:g} s")
        return self

    def start(
        self,
        *command: str,
        name: str = "",
        hears: tuple[str, ...] = (),
        ready: str | Callable[[], object] | None = None,
        timeout: float = 30.0,
    ) -> SystemUnderTest:
        """Start a process under test, and wait until it and the drill are connected.

        Args:
            command: words, or one text; ``python`` is this interpreter.
            name: for messages; the command's file if empty.
            hears: topics of the drill that it subscribes to, which makes the wait exact. Otherwise
                it counts as connected when the graph has not changed for a while.
            ready: further condition: a regular expression that its output has, or a callable.
            timeout: longest real time until then [s].

        Raises:
            SystemUnderTestError: if it ends, or is not connected within the time.
        """
        self._note(f"start {' '.join(command)}")
        return self._systems.start(command, self.folder, name, hears, ready, timeout)

    # For the owner of the drill.

    def await_connections(self) -> None:
        """Wait until the drill reaches every subscriber that there is."""
        self._systems.await_connections()

    def begin(self, seed: int, scenario: str = NO_FAULTS) -> None:
        """Begin a test: at time zero, paused, as the drill was started; nothing stays of before.

        Args:
            seed: of the run.
            scenario: content of a scenario file.

        Raises:
            DrillError: if that is not possible.
        """
        self.end()
        self._answers.declare((), "", 1)
        self._answers.period = 0
        try:
            self._client.pause()
            self._client.set_parameters(real_time_factor=1.0)  # the one that no reset restores
            self._process.scenario.write_text(scenario)
            self._client.reset(seed=seed)
            self._collector.time = 0
            self._settle(0)
            self._collector.forget()
        except (ClientError, LostMessagesError) as error:
            raise DrillError(f"the drill cannot be reset: {error}") from error
        self.log = []

    def end(self) -> None:
        """End the processes under test."""
        self._systems.stop()

    def close(self) -> None:
        """End everything."""
        with contextlib.suppress(Exception):
            self.end()
        self._collector.close()
        self._client.close()
        self._process.stop()

    @property
    def alive(self) -> bool:
        """Whether the drill's process runs."""
        return self._process.process.running

    def _await_start(self) -> None:
        own = self._collector.own("status")

        def check() -> None:
            if not self.alive:
                process = self._process.process
                raise DrillError(f"the drill {process.ending}; its last lines:\n{process.tail}")

        def paused() -> bool:
            latest = own.latest()
            return latest is not None and latest.state == Status.STATE_PAUSED

        if not self._collector.until(paused, _START, check):
            raise DrillError(
                f"the drill has not started within {_START:g} s; its last lines:\n"
                f"{self._process.process.tail}"
            )
        self._systems.await_connections()

    def _next_answer(self) -> int:
        period = self._answers.period
        return (self._collector.time // period + 1) * period

    def _advance(self, until: int) -> None:
        """Advance to a simulation time [ns], and wait for everything that belongs to it."""
        self._systems.check()
        if self._answers.period and not self._introduced:
            self._systems.await_answerers()
            self._introduced = True
        self._answers.begin()
        while self._collector.time < until:
            length = min(until - self._collector.time, _LONGEST_ADVANCE)
            with self._guarded():
                reached = self._client.step(length / SECOND)
            self._collector.time = round(reached * SECOND)
            self._settle(self._collector.time)
        if self._answers.period and until % self._answers.period == 0:
            self._systems.await_answers(until)
        if self._systems.await_commands():
            self._settle(until)

    def _act(self, text: str, action: Callable[[], Value]) -> Value:
        self._note(text)
        with self._guarded():
            result = action()
        self._settle(self._collector.time)
        return result

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        """Say that the drill has died, if that is why it does not answer."""
        try:
            yield
        except NoAnswerError as error:
            process = self._process.process
            what = f"the drill {process.ending}" if not self.alive else f"the drill hangs: {error}"
            raise DrillError(f"{what}; its last lines:\n{process.tail}") from error

    def _settle(self, stamp: int) -> None:
        """Wait until all that the drill has published up to a stamp [ns] is here."""
        collector, status = self._collector, self._collector.own("status")

        def complete() -> bool:
            return (
                bool(status.stamps)
                and status.stamps[-1] >= stamp
                and collector.published.get("status", 0) == status.number
                and not collector.missing()
                and (status.number or 0) >= self._client.status_number
            )

        if not collector.until(complete, _PATIENCE, self._check_drill):
            lacking = ", ".join(f"{count} of {name}" for name, count in collector.missing().items())
            raise LostMessagesError(
                f"messages of the drill have not arrived: {lacking or 'status'}"
            )

    def _check_drill(self) -> None:
        if not self.alive:
            process = self._process.process
            raise DrillError(f"the drill {process.ending}; its last lines:\n{process.tail}")

    def _heard(self, topic: str) -> HeardTopic:
        absolute = self._collector.resolve(topic)
        heard = self._collector.topics.get(absolute)
        if heard is None:
            names = [*TOPICS, *self._collector.topics]
            hint = "" if topic in TOPICS else f"; {did_you_mean(topic, names)}"
            raise ParameterError(
                f"topic {shown_name(topic)} is not listened to: call listen({topic!r}) first{hint}"
            )
        return heard

    def _note(self, text: str) -> None:
        self.log.append((self.time, text))

    def _summary(self) -> str:
        status = self.status
        return (
            f"the drill is {status.state} in the regime {status.regime}, weight on bit "
            f"{status.weight_on_bit:g} N, drive {'on' if status.drive_enabled else 'off'}, "
            f"{status.active_faults} faults"
        )


def _described(condition: Callable[[], object]) -> str:
    name = getattr(condition, "__name__", "")
    if name and name != "<lambda>":
        return name
    code = getattr(condition, "__code__", None)
    where = f"{Path(code.co_filename).name}:{code.co_firstlineno}" if code else repr(condition)
    return f"the condition of {where}"
