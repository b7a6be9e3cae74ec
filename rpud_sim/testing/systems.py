"""Processes under test: their start, their answers, and the verdict where they fail."""

from __future__ import annotations

import re
import shlex
import signal
import sys
import time
import warnings
from collections import ChainMap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rpud_msgs.msg import Status
from std_srvs.srv import Empty, Trigger

from rpud_sim.foundation.child_process import ChildProcess, group_of, stop_all
from rpud_sim.foundation.quantities import ParameterError, did_you_mean
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.graph import RepeatedRequest, node_name, type_name
from rpud_sim.simulation.topics import ALL_COMMAND_TOPICS, TOPICS
from rpud_sim.testing.collector import Collector
from rpud_sim.testing.errors import LostMessagesError, SystemUnderTestError
from rpud_sim.testing.nodes import Answers, DiscoveryHandshake

_START = 30.0  # that nodes may take to answer where the test starts none itself [s]
_CONNECTION = 10.0  # that the middleware may take to connect what is there [s]
_ACCEPTANCE = 10.0  # that a command may take to reach the drill [s]
_POLL_PERIOD = 0.01  # between looks at the graph, whose changes send no signal [s]
_SILENT = 1.0  # for an answer of a process that has never answered, in a test before [s]
_REST = 5.0  # that a kept process may take to leave the graph [s]
_MOST_RESTING = 3  # processes that are kept for later tests
_REPETITION = 0.2  # of a request to rest [s]
_CALM = 0.25  # without a change of the graph, after which a node counts as complete [s]
_EMPTY, _TRIGGER = map(type_name, (Empty, Trigger))


class SystemUnderTest(ChildProcess):
    """Process that a test has started."""

    expected = False  # whether it may end: the test has ended it
    paused = False  # whether the test has stopped it
    forgotten = False  # whether it has ended, and nothing awaits its nodes any more
    note: Callable[[str], None]  # writes down what the test does with it
    members: Sequence[int] = ()  # numbers of all its processes when it was killed
    key: tuple[object, ...] = ()  # processes with equal keys replace each other
    rests_by: str = ""  # service of its node that makes it rest between tests, if it is kept

    @property
    def may_rest(self) -> bool:
        """Whether it is kept after its test, which has left it running."""
        return bool(self.rests_by) and self.running and not (self.expected or self.paused)

    def stop(self) -> None:
        """End it; that it is gone is not a failure."""
        self.expected = True
        self.resume()
        super().stop()

    def kill(self) -> None:
        """Kill it; its end is not a failure."""
        self.expected = True
        self.members = self.members or group_of(self.pid)
        super().kill()

    def send(self, number: int) -> None:
        if self.running:
            self.note(f"{signal.Signals(number).name} to {self.name}")
        if number in (signal.SIGSTOP, signal.SIGCONT):
            self.paused = number == signal.SIGSTOP
        super().send(number)

    def disturb(self, number: int) -> None:
        """Send a signal that is not an act of the test: it is not noted, and ends no pause."""
        if self.running and not self.paused:
            super().send(number)

    def pause(self) -> None:
        """Stop it, as a process that hangs; the test awaits its declared answers all the same.

        ``drill.with_answers()`` ends these.
        """
        self.send(signal.SIGSTOP)

    def resume(self) -> None:
        """Let it continue after ``pause``."""
        self.send(signal.SIGCONT)


class Systems:
    """All processes under test of one drill."""

    def __init__(
        self,
        collector: Collector,
        answers: Answers,
        handshake: DiscoveryHandshake,
        environment: Mapping[str, str],
    ) -> None:
        self._collector = collector
        self._answers = answers
        self._handshake = handshake
        self._environment = environment
        self._folder = Path(environment["ROS_LOG_DIR"]).parent
        self.processes: list[SystemUnderTest] = []  # in the order of their starts
        self._resting: list[SystemUnderTest] = []  # of tests before, which are in no graph
        # longest wait, topics and commands of tests in which these have never published or answered
        self._silent: set[tuple[object, ...]] = set()
        self._count = 0
        self._patience = _START

    def start(
        self,
        command: Sequence[str],
        folder: Path | None,
        name: str,
        subscribes_to: Sequence[str],
        ready: str | Callable[[], object] | None,
        timeout: float,
        keep: str,
        note: Callable[[str], None],
    ) -> SystemUnderTest:
        """Start a process, and wait until it is connected; see ``LockstepDrill.start``."""
        words = _words(command)
        if self._ended:
            self._part()
        self._forget_ended()
        before = {topic: self._subscribers(topic) for topic in subscribes_to}
        calm = self._calm()
        key = (*words, folder, name, keep)
        system = self._woken(key) or self._started(words, folder, name, bool(keep))
        system.key, system.rests_by, system.note = key, keep and self._collector.resolve(keep), note
        self.processes.append(system)

        def lack() -> str:
            # The graph may show what a node subscribes to before what it publishes.
            hearing = {
                topic: {g: n for g, n in self._subscribers(topic).items() if g not in known}
                for topic, known in before.items()
            }
            self._answers.connect()  # as far as there are publishers: others may start later
            unknown = self._undiscovered(dict(ChainMap(*hearing.values())))
            if silent := [topic for topic, nodes in hearing.items() if not nodes]:
                unknown_names = [topic for topic in silent if topic not in TOPICS]
                hints = (did_you_mean(each, TOPICS, others=False) for each in unknown_names)
                return f"does not subscribe to {', '.join(silent)}{''.join(hints)}"
            if unknown or self._unconnected() or not (subscribes_to or calm()):
                return f"is not connected to the drill{self._on_topics()}"
            if keep and not self._rest_type(system):
                return f"has no service {system.rests_by} of {_EMPTY} or {_TRIGGER}"
            if isinstance(ready, str) and not re.search(ready, system.output, re.MULTILINE):
                return f"has not printed {ready!r}"
            return "is not ready" if callable(ready) and not ready() else ""

        self._patience = timeout
        if lacking := self._await(lack, timeout, self._unpublished, _POLL_PERIOD):
            raise self._failure_of(system, "silent", lacking)
        return system

    def _woken(self, key: tuple[object, ...]) -> SystemUnderTest | None:
        """Let a process that rests continue, if it was started with the same arguments.

        One that has ended, or does not read the line, is none.
        """
        for system in [each for each in self._resting if each.key == key]:
            self._resting.remove(system)
            if system.running:
                system.forget_output()
                system.write_line()
                if system.has_read(_REST):
                    return system
            system.stop()
        return None

    def _started(
        self, words: list[str], folder: Path | None, name: str, kept: bool
    ) -> SystemUnderTest:
        self._count += 1
        name = name or _name_of(words)
        if name in [each.name for each in self.processes]:
            name = shlex.join(words[words[0] == sys.executable :])
        log = self._folder / f"system_{self._count}.log"
        try:
            return SystemUnderTest(
                words,
                log,
                name=name,
                environment=self._environment,
                folder=folder,
                talked_to=kept,
            )
        except OSError as error:
            what = f"{error.filename or name} cannot be started: {error.strerror}"
            raise SystemUnderTestError(name, "died", what) from None

    def await_connections(self) -> None:
        """Wait until the drill reaches every subscriber that there is."""

        def lack() -> str:
            if not self._undiscovered() and not self._unconnected():
                return ""
            return (
                f"the drill is not connected to every subscriber and publisher{self._on_topics()}"
            )

        collector = self._collector
        if lacking := collector.until_complete(lack, _CONNECTION, self.check, _POLL_PERIOD):
            raise LostMessagesError(f"{lacking} within {_CONNECTION:g} s")

    def await_answerers(self) -> None:
        """Wait until the nodes that must answer are there, and know the test's subscriptions."""
        answers = self._answers
        self._forget_ended()
        if self._ended or not answers.declared:
            return
        if answers.discovered:
            self._check_publishers()
            return

        def lack() -> str:
            if answers.connect() and not self._undiscovered() and not self._unconnected():
                return ""
            return f"no publisher on {' and '.join(answers.names)}"

        if lacking := self._await(lack, self._patience, self._unpublished, _POLL_PERIOD):
            raise self._failure(", ".join(answers.names), "silent", lacking, self.processes)
        answers.discovered = True
        self._check_publishers()

    def await_answers(self, stamp: int) -> None:
        """Wait until all declared answers for a stamp [ns] are here."""
        answers = self._answers
        if self._ended:
            return

        def lack() -> str:
            return "; ".join(answers.missing(stamp))

        if lacking := self._await(lack, answers.timeout, lambda: answers.none_received):
            text = f"no answer for {stamp / SECOND:.3f} s of simulation time on {lacking}"
            kind = "late" if answers.late(stamp) else "silent"
            raise self._failure(", ".join(answers.names), kind, text, self.processes)

    def await_commands(self, status: Status) -> None:
        """Wait until the drill has counted every command; ``status`` is from the last step."""
        collector, heard = self._collector, self._collector.own("status")

        def given() -> int:
            return sum(collector.own(name).commands for name in ALL_COMMAND_TOPICS)

        def lack() -> str:
            latest = (status, *filter(None, [heard.latest()]))
            if max(s.commands_accepted + s.commands_rejected for s in latest) >= given():
                return ""
            return f"{given()} commands were given, and the drill has not got all of them"

        if given() and (lacking := collector.until_complete(lack, _ACCEPTANCE, lambda: None)):
            raise LostMessagesError(lacking)

    def check(self) -> None:
        for system in self.processes:
            if not (system.running or system.expected):
                system.expected = True  # once is enough
                raise self._failure_of(system, "died", system.ending)

    def stop(self) -> None:
        """End the processes, except those that are kept: they rest."""
        resting = [each for each in self.processes if each.may_rest and self._rests(each)]
        self._part()  # what has left the graph before is not forgotten for good
        self._end([each for each in self.processes if each not in resting])
        self.processes.clear()
        self._resting += resting
        self._end(self._resting[:-_MOST_RESTING])
        del self._resting[:-_MOST_RESTING]
        self._patience = _START

    def close(self) -> None:
        """End all processes."""
        self._end([*self.processes, *self._resting])

    def _end(self, systems: Sequence[SystemUnderTest]) -> None:
        for system in systems:
            system.resume()
        stop_all(systems)

    def _rest_type(self, system: SystemUnderTest) -> Any:
        """Return the type of the service that makes a process rest; None without one."""
        types = dict(self._collector.node.get_service_names_and_types()).get(system.rests_by, [])
        return next((kind for kind in (Empty, Trigger) if type_name(kind) in types), None)

    def _rests(self, system: SystemUnderTest) -> bool:
        """Have the node of a process leave the graph; return whether it has.

        This proves more than an answer: none of its messages is on its way, and none waits in it.
        """
        if (kind := self._rest_type(system)) is None:
            return False
        node = self._collector.node
        client = node.create_client(kind, system.rests_by)
        request = RepeatedRequest(client, kind.Request(), _REPETITION)
        processes = group_of(system.pid)

        def lack() -> str:
            if not (system.running and self._handshake.has_endpoints(processes)):
                return ""
            request.answered()  # sends it again
            return f"is still in the graph {_REST:g} s after a call of {system.rests_by}"

        lacking = self._collector.until_complete(lack, _REST, lambda: None, _POLL_PERIOD)
        request.close()
        node.destroy_client(client)
        if lacking:
            warnings.warn(f"{system.name} {lacking}: it is started again", stacklevel=2)
        return system.running and not lacking

    def _await(
        self, lack: Callable[[], str], longest: float, vain: Callable[[], bool], *period: float
    ) -> str:
        """Wait for what processes must do; return what they lack, and after how long.

        There is less time for what was in vain in a test before.
        """
        need = (longest, *self._answers.names, *(system.command for system in self.processes))
        known = need in self._silent
        limit = min(longest, _SILENT) if known else longest
        lacking = self._collector.until_complete(lack, limit, self.check, *period)
        if lacking and vain():
            self._silent.add(need)
        return lacking and f"{lacking} within {limit:g} s{', as in a test before' if known else ''}"

    def _unpublished(self) -> bool:
        return not self._answers.connect()

    def _undiscovered(self, further: Mapping[bytes, str] = {}) -> list[str]:
        return self._handshake.lacking({**self._answers.publishers, **further})

    def _part(self) -> None:
        self._answers.discovered = False
        self._handshake.part()

    def _forget_ended(self) -> None:
        for system in self.processes:
            if not (system.running or system.forgotten):
                system.forgotten = True
                self._handshake.forget([system.pid, *system.members])

    def _check_publishers(self) -> None:
        if crowd := self._answers.too_many_publishers():
            raise ParameterError(f"with_answers: {crowd}")

    @property
    def _ended(self) -> bool:
        return bool(self.processes) and all(system.expected for system in self.processes)

    def _failure(
        self, name: str, kind: str, text: str, systems: Sequence[SystemUnderTest]
    ) -> SystemUnderTestError:
        lines = [text, *self._handshake.unserved, *map(_last_lines, systems)]
        return SystemUnderTestError(name, kind, "\n".join(lines))

    def _failure_of(self, system: SystemUnderTest, kind: str, what: str) -> SystemUnderTestError:
        when = f"at {self._collector.time / SECOND:.3f} s of simulation time"
        return self._failure(system.name, kind, f"{system.name} {what}, {when}", [system])

    def _unconnected(self) -> list[str]:
        """Return topics and services that the graph shows with more ends than the drill knows."""
        node, known = self._collector.node, self._collector.delivery
        resolve = self._collector.resolve
        return [
            name
            for names, numbers, count in (
                (known.topics, known.subscribers, node.count_subscribers),
                (known.command_topics, known.publishers, node.count_publishers),
                (known.services, known.clients, node.count_clients),
            )
            for name, number in zip(names, numbers, strict=True)
            if number < count(resolve(name))
        ]

    def _on_topics(self) -> str:
        names = self._unconnected()
        return f" on {', '.join(names)}" if names else ""

    def _subscribers(self, topic: str) -> dict[bytes, str]:
        """Return the subscriptions of a topic, with the names of their nodes."""
        name = self._collector.resolve(topic)
        infos = self._collector.node.get_subscriptions_info_by_topic(name)
        return {bytes(each.endpoint_gid): node_name(each) for each in infos}

    def _endpoints(self) -> set[bytes]:
        """Return the identifiers of what subscribes to the drill's topics, or commands it."""
        node, resolve = self._collector.node, self._collector.resolve
        infos = [
            *(node.get_subscriptions_info_by_topic(resolve(name)) for name in (*TOPICS, "/clock")),
            *(node.get_publishers_info_by_topic(resolve(name)) for name in ALL_COMMAND_TOPICS),
        ]
        return {bytes(each.endpoint_gid) for found in infos for each in found}

    def _calm(self) -> Callable[[], bool]:
        """Return whether the graph has new endpoints since now, and then no others for a while.

        A node that leaves meanwhile changes nothing.
        """
        beginning = self._endpoints()
        latest, since = beginning, time.monotonic()

        def calm() -> bool:
            nonlocal latest, since
            now, found = time.monotonic(), self._endpoints()
            if not found <= latest:
                latest, since = latest | found, now
            return latest != beginning and now - since >= _CALM

        return calm


def _words(command: Sequence[str]) -> list[str]:
    words = shlex.split(command[0]) if len(command) == 1 else list(command)
    if not words or not words[0]:
        raise ParameterError(f"start takes a command, not {command!r}")
    if words[0] in ("python", "python3"):
        words[0] = sys.executable
    return words


def _name_of(words: Sequence[str]) -> str:
    given = [word for word in words if word == "-c" or not word.startswith("-")]
    if words[0] != sys.executable or len(given) == 1:
        return Path(words[0]).name
    return "python -c" if given[1] == "-c" else Path(given[1]).name


def _last_lines(system: ChildProcess) -> str:
    return f"last lines of {system.name}, which {system.ending}:\n{system.tail}"
