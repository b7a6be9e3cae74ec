"""Drill of a test: what the test can do with it, and what was published."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

from rpud_sim.foundation.options import NO_SEED
from rpud_sim.foundation.quantities import ParameterError, Quantity, did_you_mean, short_name
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.verbs import DeclaredAttributes
from rpud_sim.ros.client import DrillClient
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.testing.attempt_records import DrillRecord, heard_of
from rpud_sim.testing.collector import StoredTopic
from rpud_sim.testing.computed import ComputedTopic
from rpud_sim.testing.disturbances import Disturbances, DisturbedStep
from rpud_sim.testing.errors import LostMessagesError, subscribed
from rpud_sim.testing.expectations import Expectable, LiveVerdicts, verdict_line
from rpud_sim.testing.lockstep import Lockstep, described
from rpud_sim.testing.processes import NO_FAULTS, DrillProcess
from rpud_sim.testing.refusals import Refusals
from rpud_sim.testing.systems import SystemUnderTest
from rpud_sim.verdicts import Formula, Verdict
from rpud_sim.verdicts.notation import to_text

# Simulation time of one step, and between two answers, unless another one is given [s].
PERIOD = 0.1
_STEP = "step to "
_QUIET = 0.1  # for the last messages of nodes under test to arrive [s]

_SECONDS = Quantity("s", "a simulation time", 1e-9, 1e6)
_REAL_SECONDS = Quantity("s", "a time limit", 0.0, 1e6, exclusive=True)
_COUNT = Quantity("", "a number of messages", 1, 1e6, whole=True)

_Words = ParamSpec("_Words")
_Value = TypeVar("_Value")


def _noted(
    command: Callable[Concatenate[DrillClient, _Words], _Value],
) -> Callable[Concatenate[LockstepDrill, _Words], _Value]:
    """Return a command of the client as one of a test's drill, which writes it down."""

    @functools.wraps(command)
    def act(drill: LockstepDrill, /, *given: _Words.args, **named: _Words.kwargs) -> _Value:
        words = [*map(str, given), *(f"{name}={value}" for name, value in named.items())]
        drill._note(" ".join([command.__name__, *words]))
        with drill._errors_observed():
            return drill._act(lambda: command(drill._client, *given, **named))

    return act


class LockstepDrill(DeclaredAttributes, Lockstep):
    """Drill in lockstep: simulation time advances only in steps.

    A step is over when every declared answer of the nodes under test is here, and the drill has all
    of their commands. What the drill publishes is computed in the test's process when it is asked
    for, with the same bits. If the nodes keep the rules, the result is the same at any load.
    Commands start in ``folder``; None is the working directory.
    """

    observed: bool  # whether the test has looked at anything of the drill
    folder: Path | None  # of the test; its commands start there, and relative paths begin there
    key: tuple[str, ...]  # of its pool: drills with equal keys replace each other
    log: list[tuple[float, str]]  # commands of the test: simulation time [s] and text

    def __init__(self, process: DrillProcess, folder: Path | None = None) -> None:
        super().__init__(process)
        self._verdicts = LiveVerdicts(self._collector.node.get_namespace(), self._heard)
        self._refusals = Refusals(self._client)
        self.observed = False
        self.folder = folder
        self.key = ()
        self._seed = NO_SEED
        self.log = []

    @property
    def environment(self) -> dict[str, str]:
        """Environment for a process under test: ROS domain and loopback."""
        self.observed = True  # perhaps by this process
        return dict(self._process.environment)

    @property
    def domain(self) -> int:
        """ROS domain of the drill."""
        self.observed = True  # perhaps by a node of the test
        return self._process.domain

    @property
    def namespace(self) -> str:
        """Namespace of the drill."""
        return self._process.namespace

    @property
    def client(self) -> DrillClient:
        """Client of the drill, for what this class has no method for."""
        self.observed = True
        return self._client

    @property
    def time(self) -> float:
        """Simulation time that was reached [s]."""
        self.observed = True
        return self._now

    @property
    def status(self) -> Any:
        """Latest status of the drill, a ``rpud_msgs/Status``."""
        return self.latest("status")

    @property
    def seed(self) -> int:
        """Seed of the drill."""
        return self._seed

    @property
    def pid(self) -> int:
        """Number of the drill's process."""
        return self._process.process.pid

    @property
    def output(self) -> str:
        """All that the drill's process has printed."""
        self.observed = True
        return self._process.process.output

    @property
    def systems(self) -> tuple[SystemUnderTest, ...]:
        """Processes under test that this test has started."""
        self.observed = True
        return tuple(self._systems.processes)

    @property
    def heard(self) -> dict[str, StoredTopic | ComputedTopic]:
        """Everything that was published since the test began, by absolute topic."""
        self.observed = True
        return {**self._collector.topics, **self._computed.topics}

    @property
    def beginning(self) -> bytes:
        """First message of the journal since the latest reset, which contains the strata."""
        return self._computed.beginning

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Verdicts of this test, in the order of their expectations."""
        return tuple(self._verdicts.verdicts)

    @property
    def verdict_lines(self) -> list[str]:
        """The same, as one line each."""
        return [verdict_line(verdict) for verdict in self._verdicts.verdicts]

    @property
    def refusals(self) -> str:
        """Number of rejected commands since time zero and why the last one; empty without any."""
        self.observed = True
        return self._refusals.line(self.status.commands_rejected)

    # Time.

    def step(self, seconds: float | None = None) -> float:
        """Advance, and return the simulation time that is reached [s].

        Declared answers divide a longer step at each of their times; without ``seconds`` it ends at
        the next of them. A node under test that has died or does not answer is a
        SystemUnderTestError, messages of the drill that are lost are a LostMessagesError.
        """
        if seconds is None:
            self._step_to(self._next_stop())
        else:
            length = round(_SECONDS.check("step", seconds) * SECOND)
            self._step_to(self._collector.time + length)
        return self._now

    def step_until(self, condition: Callable[[], object] | Formula, timeout: float) -> float:
        """Step until a condition holds, and return the simulation time [s].

        Args:
            condition: looked at before the first step and after each; a formula of
                ``rpud_sim.verdicts`` has to hold at some instant from now on.
            timeout: longest simulation time [s].

        Raises:
            AssertionError: if it does not hold within the time.
        """
        self.observed = True
        limit = _SECONDS.check("timeout", timeout)
        begun = self._collector.time
        end = begun + round(limit * SECOND)
        if isinstance(condition, Formula):
            holds: Callable[[], object] = self._verdicts.eventually(condition, begun)
        else:
            holds = condition
        while not holds():
            if self._collector.time >= end:
                raise AssertionError(self._never_came(condition, limit))
            self._step_to(min(self._next_stop(), end))
        return self._now

    def reset(self, seed: int | None = None) -> None:
        """Take the drill back to time zero, as it was started; nodes under test continue.

        What was published before is forgotten, and expectations judge what follows. ``seed`` is
        the drill's seed from here on; None for the current one.
        """
        self._note("reset" if seed is None else f"reset seed={seed}")
        self._reset(seed)
        self._seed = self._seed if seed is None else seed
        self._verdicts.reset()
        self._refusals.begin()

    # Commands, as of ``DrillClient``.

    press = _noted(DrillClient.press)
    drive = _noted(DrillClient.drive)
    feed = _noted(DrillClient.feed)
    move = _noted(DrillClient.move)
    engage = _noted(DrillClient.engage)
    inject = _noted(DrillClient.inject)
    clear = _noted(DrillClient.clear)

    def set_parameters(self, **values: Any) -> None:
        """Set parameters of the drill; the next test has the drill's first ones again."""
        self._note(f"set {' '.join(f'{name}={value}' for name, value in values.items())}")
        with self._errors_observed():
            self._act(lambda: self._client.set_parameters(**values))

    # What was published.

    def listen(self, topic: str, kind: str = "") -> None:
        """Keep the messages of a topic of other nodes from now on.

        Those of the drill are computed. One that is listened to is received over DDS, too, and has
        to be the same bit for bit.

        Args:
            topic: of any node; a relative name is one of the drill's namespace.
            kind: type such as ``std_msgs/msg/String``; may be empty if a node publishes it.
        """
        heard = self._collector.subscribe(topic, kind)
        if heard is None:
            hint = did_you_mean(topic, TOPICS, others=False)
            absent = f"no publisher on {self._collector.resolve(topic)}; give its type"
            raise ParameterError(f"{absent}{hint}")
        if topic in TOPICS:
            self.await_connections()
            if heard.number is None:
                heard.note(self._collector.published.get(topic, 0))

    def messages(self, topic: str) -> list[Any]:
        """Return all messages of a topic since the test began, which must be listened to."""
        heard = self._heard(topic)
        if heard.lost:
            raise LostMessagesError(f"{heard.lost} messages of {heard.name} are lost")
        return heard.messages()

    def latest(self, topic: str) -> Any:
        """Return the latest message of a topic, None without one."""
        return self._heard(topic).latest()

    def expect(
        self, *expectations: Expectable, name: str = "", requirement: str = ""
    ) -> tuple[Verdict, ...]:
        """Evaluate expectations on what was published since the test began.

        They are of ``rpud_sim.verdicts``, formulas, or files. One that has failed raises an
        ExpectationFailedError. Otherwise one that is undecided raises an ExpectationUndecidedError.
        """
        given = self._verdicts.expectations(expectations, self.folder, name, requirement)
        for expectation in given:
            for topic in expectation.topics:
                self._heard(topic)
        return self._verdicts.expect(given, self._now, lambda: self.refusals)

    # Nodes under test.

    def with_answers(
        self,
        *topics: str,
        count: int = 1,
        period: float = PERIOD,
        timeout: float = 10.0,
    ) -> LockstepDrill:
        """Declare how the nodes under test answer; a step is over when all have answered.

        This takes the place of what was declared before. Without topics no answer is awaited.

        Args:
            topics: on which a node publishes when it has done its work for a stamp: with a header
                or a time, that stamp; otherwise one more message.
            count: messages of each topic for one stamp.
            period: simulation time between two answers: they are due at its multiples [s].
            timeout: longest real time for the answers to one step [s].
        """
        answers = self._answers
        answers.timeout = _REAL_SECONDS.check("timeout", timeout)
        length = round(_SECONDS.check("period", period) * SECOND)
        answers.declare(topics, int(_COUNT.check("count", count)), length)
        self._note(f"with_answers {' '.join(topics)} period={period:g} s")
        return self

    def start(
        self,
        *command: str,
        name: str = "",
        subscribes_to: tuple[str, ...] = (),
        ready: str | Callable[[], object] | None = None,
        timeout: float = 30.0,
        keep: str = "",
        hears: tuple[str, ...] = (),
    ) -> SystemUnderTest:
        """Start a process under test, and wait until it and the drill are connected.

        Args:
            command: words, or one text; ``python`` is this interpreter.
            name: for messages; the command's file if empty.
            subscribes_to: topics of the drill, which makes the wait exact. Otherwise it counts as
                connected when the graph has not changed for a while.
            ready: further condition: a regular expression that its output has, or a callable.
            timeout: longest real time until then [s].
            keep: service of the node, ``std_srvs/srv/Empty`` or ``Trigger``, that makes its process
                rest after the test: it destroys its node and waits for a line of its input. The
                next start with equal arguments writes that line, and starts no process.
            hears: name of ``subscribes_to`` in 0.3.

        Raises:
            SystemUnderTestError: if it ends, or is not connected within the time.
        """
        self._note(f"start {' '.join(command)}")
        limit = _REAL_SECONDS.check("timeout", timeout)
        with self._errors_observed():
            topics = subscribed(subscribes_to, hears)
            return self._systems.start(
                command, self.folder, name, topics, ready, limit, keep, self._note
            )

    # For the owner of the drill.

    @property
    def published(self) -> dict[str, int]:
        """Number of messages that the drill has published since its start, by relative topic."""
        return dict(self._collector.published)

    def begin(self, seed: int, scenario: str = NO_FAULTS) -> None:
        """Begin a test at time zero, paused, as the drill was started; nothing stays of before."""
        self._seed = seed
        self._begin(seed, scenario)
        self._verdicts.begin()
        self._refusals.begin()
        self.log = []
        self.observed = False

    def disturb(self, seed: str | None) -> None:
        """Have the test's steps disturbed as ``seed`` draws it, and keep received messages.

        None disturbs nothing.
        """
        self._heard_before = []
        self._disturbances = None if seed is None else Disturbances(seed)

    @property
    def disturbed_steps(self) -> tuple[DisturbedStep, ...]:
        """Steps of a shaken test, with what disturbed them."""
        return tuple(self._disturbances.steps) if self._disturbances else ()

    def record_attempt(self) -> DrillRecord:
        """Return what nodes under test have published since ``disturb``, and all verdicts."""
        # What no answer is awaited on may still be on its way.
        self._collector.until_complete(lambda: "more", _QUIET, lambda: None)
        heard = (*(self._heard_before or ()), heard_of(self._collector, self._computed))
        subscribed = tuple(sorted(self._subscribed))
        rate = self._computed.rate
        return DrillRecord(heard, self.verdicts, self.disturbed_steps, subscribed, rate)

    @property
    def _now(self) -> float:
        return self._collector.time / SECOND

    def _next_stop(self) -> int:
        if self._answers.period:
            return self._next_answer()
        return self._collector.time + round(PERIOD * SECOND)

    def _step_to(self, until: int) -> None:
        text = f"{_STEP}{until / SECOND:.9g} s"
        if self.log and self.log[-1][1].startswith(_STEP):  # one line for consecutive steps
            self.log[-1] = self.log[-1][0], text
        else:
            self._note(text)
        with self._errors_observed():
            self._advance(until)

    @contextlib.contextmanager
    def _errors_observed(self) -> Iterator[None]:
        """Count an error that the test may expect as something that it has looked at."""
        try:
            yield
        except BaseException:
            self.observed = True
            raise

    def _heard(self, topic: str) -> StoredTopic | ComputedTopic:
        self.observed = True
        heard = self._topic(topic)
        if heard is None:
            own = len(f"{self.namespace}/")
            others = [name for name in self.heard if name[own:] not in TOPICS]
            hint = "" if topic in TOPICS else f"{did_you_mean(topic, [*TOPICS, *others])}"
            raise ParameterError(
                f"topic {short_name(topic)} is not listened to: call listen({topic!r}) first{hint}"
            )
        return heard

    def _note(self, text: str) -> None:
        self.log.append((self._now, text))

    def _never_came(self, condition: Callable[[], object] | Formula, limit: float) -> str:
        """Return what was awaited for some time [s], and what is there, as some lines."""
        late = f"did not come true within {limit:g} s of simulation time"
        if isinstance(condition, Formula):
            values = self._verdicts.latest_values(condition)
            awaited = ": ".join(filter(None, [f"{to_text(condition)} {late}", values]))
        else:
            awaited = f"{described(condition)} {late}"
        return "\n".join(filter(None, [awaited, self._summary(), self.refusals]))

    def _summary(self) -> str:
        status = self.status
        return (
            f"the drill at {self._now:.3f} s: state {status.state}, regime {status.regime}, "
            f"weight on bit {status.weight_on_bit:g} N, "
            f"drive {'on' if status.drive_enabled else 'off'}, {status.active_faults} faults"
        )
