"""A process that publishes a drill's topics, and what an independent listener hears of it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import rclpy
from rclpy.node import Node
from rpud_msgs.msg import Result
from rpud_msgs.srv import ResetSimulation

from bench.hearing import Hearing
from bench.machine import used_by
from rpud_sim.ros.drill.publishers import DIAGNOSTICS
from rpud_sim.ros.types import message_class
from rpud_sim.simulation.topics import TOPICS

_KINDS = {
    name: message_class(topic.type)
    for name, topic in {**TOPICS, "/diagnostics": DIAGNOSTICS}.items()
}
_STARTING = 60.0  # that a process may take until it is heard [s]
_SETTLING = 2.0  # between the first message and the first figure [s]


class Counted(NamedTuple):
    """What was heard per second, and the process' share of one core."""

    bytes: float
    impacts: float
    share: float


class Talk:
    """A process that publishes a drill's topics, and what is heard of it.

    Args:
        program: ``drill_node``, a module of the bench, or the words of a command.
        parameters: of its node.
    """

    def __init__(self, program: str | Sequence[str], parameters: Mapping[str, object]) -> None:
        self.namespace = f"/bench_{os.getpid()}_{time.monotonic_ns()}"
        self.node: Node = rclpy.create_node("listener", namespace=self.namespace)
        kinds = {name: kind for name, kind in _KINDS.items() if name != "faults"}
        self.hearing = Hearing(self.node, kinds, ("status", "/diagnostics"), ("contact_force",))
        words = [f"{key}:={value}" for key, value in parameters.items()]
        if isinstance(program, str):
            talker = (sys.executable, "-m", f"bench.{program}")
            program = (program,) if program == "drill_node" else talker
        self._process = subprocess.Popen(
            [
                *program,
                *("--ros-args", "-r", f"__ns:={self.namespace}"),
                *("--log-level", "error"),
                *(word for pair in words for word in ("-p", pair)),
            ]
        )
        self._interrupted = False
        self.late: list[float] = []

    def __enter__(self) -> Talk:
        return self

    def __exit__(self, *_: object) -> None:
        self.interrupt()
        try:
            self._process.wait(30.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self.node.destroy_node()

    def interrupt(self) -> None:
        """Ask the process to end; the end of the context waits for it."""
        if not self._interrupted:
            self._interrupted = True
            self._process.send_signal(signal.SIGINT)

    def status(self) -> Any:
        """Return the last status."""
        return self.hearing.last("status")

    def diagnostics(self) -> dict[str, str]:
        """Return the values of the process' last diagnostics, by key.

        Another process' may be the last that was heard: then the next ones are waited for.

        Raises:
            RuntimeError: if they do not come in time.
        """
        own: dict[str, str] = {}

        def found() -> bool:
            last = self.hearing.last("/diagnostics")
            for status in last.status if last else ():
                if status.name.startswith(f"{self.namespace}/"):
                    own.update({pair.key: pair.value for pair in status.values})
            return bool(own)

        if not self.hearing.take_until(found, _STARTING):
            raise RuntimeError(f"no diagnostics within {_STARTING:g} s")
        return own

    def settle(self, seconds: float = _SETTLING) -> None:
        """Wait until the process is heard, and some time more.

        Args:
            seconds: of that time.

        Raises:
            RuntimeError: if it is not heard in time.
        """
        if not self.hearing.take_until(lambda: self.hearing.messages["waveform"] > 0, _STARTING):
            raise RuntimeError(f"nothing was heard within {_STARTING:g} s")
        self.listen(seconds)

    def reset(self) -> None:
        """Let the drill begin again: its counts of blocks are those from now on.

        Raises:
            RuntimeError: if it does not.
        """
        client = self.node.create_client(ResetSimulation, "simulation/reset")
        client.wait_for_service(_STARTING)
        answer = client.call_async(ResetSimulation.Request())
        rclpy.spin_until_future_complete(self.node, answer, timeout_sec=_STARTING)
        self.node.destroy_client(client)
        reply = answer.result()
        if reply is None or reply.result.result != Result.RESULT_OK:
            raise RuntimeError(f"the drill has not begun again: {reply}")

    def listen(self, seconds: float) -> None:
        """Hear what comes for some time."""
        self.hearing.take_until(lambda: False, seconds)

    def measure(self, seconds: float) -> Counted:
        """Listen for some time, and count."""
        began, before = time.monotonic(), self._counts()
        for _ in self.each_second(seconds):
            pass
        elapsed = time.monotonic() - began
        differences = zip(self._counts(), before, strict=True)
        return Counted(*((now - then) / elapsed for now, then in differences))

    def each_second(self, seconds: float) -> Iterator[None]:
        """Listen for some time, and yield once in every second."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self.listen(min(1.0, left))
            if self.status() is not None:
                self.late.append(1e3 * self.status().lateness_max)
            yield

    def processor_time(self) -> float:
        """Return the time of processors that the process has used [s]."""
        return used_by(self._process.pid)

    def _counts(self) -> tuple[float, float, float]:
        return self.hearing.bytes, self.hearing.messages["contact_force"], self.processor_time()
