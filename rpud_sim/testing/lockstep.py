"""Lockstep of a drill and the nodes under test: one step, and all that belongs to it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from rpud_msgs.msg import Status

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.client import ClientError, DrillClient, NoAnswerError
from rpud_sim.testing.collector import Collector
from rpud_sim.testing.errors import DrillError, LostMessagesError, is_verdict
from rpud_sim.testing.nodes import Answers, Introductions
from rpud_sim.testing.processes import DrillProcess, applied
from rpud_sim.testing.systems import Systems

_START = 180.0  # that a drill may take to start, which compiles where nothing is compiled yet [s]
_PATIENCE = 60.0  # that the drill may take to answer or to publish [s]
_DELIVERY = 5.0  # that subscribers may take to acknowledge [s]
_LONGEST_ADVANCE = SECOND  # in one go: the middleware keeps some thousand messages [ns]

Value = TypeVar("Value")
__tracebackhide__ = is_verdict


def _refused(name: str, other: str) -> Any:
    def refuse(*_: object, **__: object) -> NoReturn:
        raise ParameterError(
            f"drill.client.{name} would go past the nodes under test: call drill.{other}"
        )

    return refuse


class LockstepClient(DrillClient):
    """Client for what ``Drill`` has no method for; time and reset belong to the lockstep."""

    step = _refused("step", "step")
    run_to = _refused("run_to", "step")
    play = _refused("play", "step")
    reset = _refused("reset", "reset")


class Lockstep:
    """Drill whose time passes in steps alone.

    A step is over when all that the drill has published up to its stamp is here, and every declared
    answer of the nodes under test, and the drill has every command that they gave.
    """

    def __init__(self, process: DrillProcess) -> None:
        self._process = process
        namespace = process.namespace
        with applied(process.environment):
            # of the drill
            self._client = LockstepClient(
                namespace, process.domain, node_name="drill_test_client", patience=_PATIENCE
            )
            # of the messages
            self._collector = Collector(self._client)
        self._client.check_while_waiting(self._check)
        introductions = Introductions(self._collector, self._client.node)
        # that the nodes under test have declared
        self._answers = Answers(self._collector, introductions)
        # processes under test
        self._systems = Systems(self._collector, self._answers, introductions, process.environment)
        try:
            self._await_start()
        except BaseException:
            self.close()
            raise

    @property
    def alive(self) -> bool:
        """Whether the drill's process runs."""
        return self._process.process.running

    def _begin(self, seed: int, scenario: str) -> None:
        """Begin at time zero, paused, as the drill was started; nothing stays of before."""
        self._systems.stop()
        self._answers.declare(())
        try:
            self._client.pause()
            self._client.set_parameters(real_time_factor=1.0)  # the one that no reset restores
            self._process.scenario.write_text(scenario)
            self._reset(seed)
            self._collector.forget_others()
        except (ClientError, LostMessagesError) as error:
            raise DrillError(f"the drill cannot be reset: {error}") from error
        status = self._collector.own("status")
        if status.stamps[-1] or status.latest().state != Status.STATE_PAUSED:
            raise DrillError(f"the drill is {status.latest().state} after a reset, not paused")

    def _reset(self, seed: int | None) -> None:
        """Take the drill back to time zero; what came before is forgotten, nodes go on."""
        self._settle()  # messages from before are none of after
        DrillClient.reset(self._client, seed=seed)
        self._collector.time = 0
        self._settle()
        self._collector.forget()

    def _advance(self, until: int) -> None:
        """Advance to a simulation time [ns], with an answer of every node at each due time."""
        period = self._answers.period
        while self._collector.time < until:
            end = min(until, self._next_answer()) if period else until
            self._advance_once(end)

    def _next_answer(self) -> int:
        """Return the next time at which answers are due, which are declared [ns]."""
        period = self._answers.period
        return (self._collector.time // period + 1) * period

    def _act(self, action: Callable[[], Value]) -> Value:
        """Do something with the drill at a standstill, and take what follows from it."""
        try:
            with self._guarded():
                return action()
        finally:
            if self.alive:  # also where the drill refuses it: the status counts that
                self._settle()

    def _settle(self) -> None:
        """Wait until all that the drill has published is here."""
        self._collector.ask()
        self._await_published()

    def _await_published(self) -> None:
        collector, status = self._collector, self._collector.own("status")

        def lack() -> str:
            if not status.stamps or status.stamps[-1] < collector.time:
                return "status"
            if (status.number or 0) < self._client.status_number:
                return "status"
            return ", ".join(f"{count} of {name}" for name, count in collector.missing().items())

        if lacking := collector.until_complete(lack, _PATIENCE, self._check):
            raise LostMessagesError(f"messages of the drill have not arrived: {lacking}")

    def await_delivery(self) -> None:
        """Wait until all reliable subscribers have all that the drill has published.

        One that was killed never has: the wait ends then, too.
        """
        self._settle()

        def lack() -> str:
            return "" if self._collector.ask().acknowledged else "acknowledgements"

        self._collector.until_complete(lack, _DELIVERY, self._check)

    def await_connections(self) -> None:
        """Wait until the drill reaches every subscriber that there is."""
        self._systems.await_connections()

    def end(self) -> None:
        """End the processes under test."""
        self._systems.stop()

    def close(self) -> None:
        """End everything."""
        with contextlib.suppress(Exception):
            self._systems.stop()
        self._collector.close()
        self._client.close()
        self._process.stop()

    def _advance_once(self, until: int) -> None:
        self._systems.check()
        self._systems.await_answerers()
        self._answers.begin()
        while self._collector.time < until:
            length = min(until - self._collector.time, _LONGEST_ADVANCE)
            with self._guarded():
                reached = DrillClient.step(self._client, length / SECOND)
            self._collector.time = round(reached * SECOND)
            self._collector.published = self._client.published
            self._await_published()
        period = self._answers.period
        if period and until % period == 0:
            self._systems.await_answers(until)
        if self._systems.await_commands():
            self._settle()

    def _await_start(self) -> None:
        status = self._collector.own("status")

        def lack() -> str:
            latest = status.latest()
            return "" if latest and latest.state == Status.STATE_PAUSED else "a paused drill"

        if self._collector.until_complete(lack, _START, self._check):
            raise self._failure(f"has not started within {_START:g} s")
        self._systems.await_connections()

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except NoAnswerError as error:
            self._check()
            raise self._failure(f"hangs: {error}") from error

    def _check(self) -> None:
        if not self.alive:
            raise self._failure(self._process.process.ending)

    def _failure(self, what: str) -> DrillError:
        return DrillError(f"the drill {what}; its last lines:\n{self._process.process.tail}")


def described(condition: Callable[[], object]) -> str:
    """Return a condition in words: its name, or where it stands."""
    name = getattr(condition, "__name__", "")
    if name and name != "<lambda>":
        return name
    code = getattr(condition, "__code__", None)
    where = f"{Path(code.co_filename).name}:{code.co_firstlineno}" if code else repr(condition)
    return f"the condition of {where}"
