"""Lockstep of a drill and the nodes under test: one step, and all that belongs to it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from builtin_interfaces.msg import Duration
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rpud_msgs.msg import JournalEntry, Status
from rpud_msgs.srv import StepSimulation

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.ros.client import ClientError, DrillClient, NoAnswerError, RefusedError
from rpud_sim.ros.client.arguments import to_time
from rpud_sim.simulation.topics import JOINT_COMMANDS, MOUNT_FRAME, TOPICS
from rpud_sim.testing.attempt_records import TEST_CLIENT, Heard, heard_of
from rpud_sim.testing.collector import Collector, StoredTopic
from rpud_sim.testing.computed import ComputedDrill, ComputedTopic, check_equal
from rpud_sim.testing.disturbances import Disturbances
from rpud_sim.testing.errors import DrillError, LostMessagesError
from rpud_sim.testing.nodes import Answers, DiscoveryHandshake
from rpud_sim.testing.processes import DrillProcess, applied
from rpud_sim.testing.systems import Systems

_START = 180.0  # that a drill may take to start, which compiles where nothing is compiled yet [s]
_PATIENCE = 60.0  # that the drill may take to answer or to publish [s]
_DELIVERY = 5.0  # that subscribers may take to acknowledge [s]
_LONGEST_ADVANCE = SECOND  # beside others: the middleware keeps some thousand messages [ns]
_LIFE_CYCLE = "drill_node/change_state"
_OWN_NODES = 3  # in the domain of a drill: its node and two of the test

Value = TypeVar("Value")


def _refused(name: str, other: str) -> Any:
    def refuse(*_: object, **__: object) -> NoReturn:
        raise ParameterError(
            f"drill.client.{name} would go past the nodes under test: call drill.{other}"
        )

    return refuse


class LockstepClient(DrillClient):
    """Client for what ``LockstepDrill`` has no method for; time and reset belong to steps."""

    step = _refused("step", "step")
    run_to = _refused("run_to", "step")
    play = _refused("play", "step")
    reset = _refused("reset", "reset")

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        # Now, so that the service is discovered by the first test with other parameters.
        self._services.add(ChangeState, _LIFE_CYCLE)

    def advance(self, nanoseconds: int, entries_from: int, shuffle: int = 0) -> Any:
        """Advance, and return the response, with the journal's entries from a number on.

        Unless ``shuffle`` is 0, it draws the order among topics.
        """
        length = to_time(Duration, "step", nanoseconds / SECOND)
        request = StepSimulation.Request(
            duration=length, entries_from=entries_from, shuffle=shuffle
        )
        return self._advance("simulation/step", request)

    def change_state(self, *transitions: str) -> None:
        """Let the drill's node make transitions of its life cycle."""
        for label in transitions:
            self._ask(_LIFE_CYCLE, ChangeState.Request(transition=Transition(label=label)))

    def set_all_parameters(self, values: Mapping[str, Any]) -> None:
        """Set parameters while the drill is not configured."""
        self._set_parameters("drill_node", values)


class Lockstep:
    """Drill whose time passes in steps alone.

    A step is over when every declared answer of the nodes under test is here, and the drill has
    every command that they gave. What the drill publishes is computed when it is asked for.
    """

    def __init__(self, process: DrillProcess) -> None:
        self._process = process
        namespace = process.namespace
        with applied(process.environment):
            # of the drill
            self._client = LockstepClient(
                namespace, process.domain, node_name=TEST_CLIENT, patience=_PATIENCE
            )
            # of the messages of others
            self._collector = Collector(self._client)
        self._computed = ComputedDrill(self._collector.resolve, self._new_entries)
        # Whether the drill's journal may have entries that are not known here.
        self._changed = True
        self._client.check_while_waiting(self._check)
        handshake = DiscoveryHandshake(self._collector, self._client.node)
        self._handshake = handshake
        self._disturbances: Disturbances | None = None  # of the nodes under test
        self._heard_before: list[Heard] | None = None  # of resets, if it is kept
        # Topics of the drill to which nodes under test have subscribed, in disturbed steps.
        self._subscribed: set[str] = set()
        # that the nodes under test have declared
        self._answers = Answers(self._collector, handshake)
        # processes under test
        self._systems = Systems(self._collector, self._answers, handshake, process.environment)
        try:
            self._await_start()
        except BaseException:
            self.close()
            raise

    @property
    def alive(self) -> bool:
        """Whether the drill's process runs."""
        return self._process.process.running

    def renew(self, parameters: Mapping[str, Any]) -> None:
        """Configure the node again with all of its parameters, as if it had been started with them.

        It takes a tenth of the time of a start.
        """
        client, status = self._client, self._collector.own("status")
        try:
            client.change_state("deactivate", "cleanup")
            client.set_all_parameters(parameters)
            self._collector.take()
            status.forget(len(status))
            client.change_state("configure", "activate")
        except ClientError as error:
            raise DrillError(f"the drill cannot be configured again: {error}") from error
        self._collector.time = 0
        self._computed.restart()
        self._changed = True
        self._await_start()

    def _begin(self, seed: int, scenario: str) -> None:
        """Begin at time zero, paused, as the drill was started; nothing stays of before."""
        self._disturbances = self._heard_before = None
        self._subscribed.clear()
        self._systems.stop()
        self._answers.declare(())
        try:
            self._client.pause()
            self._client.set_parameters(real_time_factor=1.0)  # the one that no reset restores
            self._process.scenario.write_text(scenario)
            self._collector.forget_others()  # first: the drill publishes what has subscribers then
            self._reset(seed)
        except (ClientError, LostMessagesError) as error:
            raise DrillError(f"the drill cannot be reset: {error}") from error
        self._computed.refresh()
        status = self._collector.own("status")
        if status.stamps[-1] or status.latest().state != Status.STATE_PAUSED:
            raise DrillError(f"the drill is {status.latest().state} after a reset, not paused")

    def _reset(self, seed: int | None) -> None:
        """Take the drill back to time zero; what came before is forgotten, nodes continue."""
        self._settle()  # messages from before are none of after
        if self._heard_before is not None:
            self._heard_before.append(heard_of(self._collector, self._computed))
        DrillClient.reset(self._client, seed=seed)
        self._collector.time = 0
        self._settle()
        self._collector.forget()
        self._changed = True

    def _topic(self, topic: str) -> StoredTopic | ComputedTopic | None:
        """Return a topic with all its messages; None if it is neither computed nor received.

        If a topic of the drill is also received, its messages must equal the computed ones.
        """
        name = self._collector.resolve(topic)
        self._computed.refresh()  # a reset makes its topics new
        computed, heard = self._computed.topics.get(name), self._collector.topics.get(name)
        if heard is not None and heard.numbered_alone:
            self._await_published()
        if computed is not None and heard is not None:
            check_equal(computed, heard)
        return heard if computed is None else computed

    def _new_entries(self) -> list[JournalEntry]:
        """Return the entries of the drill's journal that are not known here."""
        found: list[JournalEntry] = []
        if self._changed and self.alive:
            self._changed = False
            with self._guarded():
                while page := self._client.journal(self._computed.count + len(found)):
                    found += page
        return found

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
            self._changed = True
            if self.alive:  # also where the drill rejects it: the status counts that
                self._settle()

    def _settle(self) -> None:
        """Wait until all that the drill has published is here."""
        self._collector.ask()
        self._await_published()

    def _await_published(self) -> None:
        collector, status = self._collector, self._collector.own("status")

        def lack() -> str:
            if not status.stamps:
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

    def interrupt(self) -> None:
        """Have the drill end beside others, before ``close``."""
        self._process.interrupt()

    def close(self) -> None:
        """End everything."""
        self.interrupt()
        with contextlib.suppress(Exception):
            self._systems.close()
        self._collector.close()
        self._client.close()
        self._process.stop()

    def _advance_once(self, until: int) -> None:
        collector, systems = self._collector, self._systems
        systems.check()
        systems.await_answerers()
        self._answers.begin()
        accompanied = len(collector.node.get_node_names()) > _OWN_NODES
        with self._disturbed(until) as shuffle:
            while collector.time < until:
                length = until - collector.time
                if accompanied or collector.hears_others:
                    length = min(length, _LONGEST_ADVANCE)
                with self._guarded():
                    try:
                        response = self._client.advance(length, self._computed.count, shuffle)
                    except RefusedError as error:
                        raise LostMessagesError(str(error)) from error
                collector.time = join_seconds(response.time.sec, response.time.nanosec)
                collector.published = self._client.published
                self._computed.add(response.entries)
                self._computed.reach(collector.time, response.status)
                collector.take()
            period = self._answers.period
            if period and until % period == 0:
                systems.await_answers(until)
            systems.await_commands(response.status)
        self._changed |= accompanied

    def _disturbed(self, until: int) -> contextlib.AbstractContextManager[int]:
        """Return a context in which a step is disturbed, with the seed of the order of topics."""
        if self._disturbances is None:
            return contextlib.nullcontext(0)
        topics = self._handshake.subscribed
        self._subscribed.update(name for name in TOPICS if self._collector.resolve(name) in topics)
        self._subscribed.update({"/clock"} & topics)
        return self._disturbances.step(until, self._systems.processes)

    def _await_start(self) -> None:
        status = self._collector.own("status")

        def lack() -> str:
            self._client.take()
            latest = status.latest()
            shown = self._client.status_number == status.number
            paused = latest and latest.state == Status.STATE_PAUSED
            return "" if paused and shown else "a paused drill"

        if self._collector.until_complete(lack, _START, self._check):
            raise self._failure(f"has not started within {_START:g} s")
        frame = status.latest().header.frame_id
        self._collector.own(JOINT_COMMANDS).frame_prefix = frame.removesuffix(MOUNT_FRAME)
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
    """Return a condition in words: its name, or its place in the source."""
    name = getattr(condition, "__name__", "")
    if name and name != "<lambda>":
        return name
    code = getattr(condition, "__code__", None)
    where = f"{Path(code.co_filename).name}:{code.co_firstlineno}" if code else repr(condition)
    return f"the condition of {where}"
