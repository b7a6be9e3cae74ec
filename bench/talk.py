"""A drill's node in a process of its own, and what an independent listener hears of it."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rpud_msgs.msg import Result
from rpud_msgs.srv import ResetSimulation

from bench.hearing import Hearing
from bench.machine import used_by
from rpud_sim.foundation.child_process import end_with_parent
from rpud_sim.ros.drill.publishers import OF_NODE
from rpud_sim.ros.graph import message_class
from rpud_sim.simulation.topics import TOPICS

_KINDS = {name: message_class(topic.type) for name, topic in {**TOPICS, **OF_NODE}.items()}
_STARTING = 60.0  # that a process may take until it is heard [s]
_ENDING = 30.0  # that processes may take to end after SIGINT [s]
_SETTLING = 2.0  # between the first message and the first figure [s]


class Counted(NamedTuple):
    """What was heard per second, and the process' share of one core."""

    bytes: float
    impacts: float
    share: float


@contextlib.contextmanager
def ros() -> Iterator[None]:
    """Initialise ROS, and shut it down."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        rclpy.try_shutdown()


class Talk:
    """A drill's node in a process of its own, and what is heard of it."""

    def __init__(self, parameters: Mapping[str, object]) -> None:
        self.namespace = f"/bench_{os.getpid()}_{time.monotonic_ns()}"
        self.node: Node = rclpy.create_node("listener", namespace=self.namespace)
        kinds = {name: kind for name, kind in _KINDS.items() if name != "faults"}
        self.hearing = Hearing(self.node, kinds, ("status", "/diagnostics"), ("contact_force",))
        words = [f"{key}:={value}" for key, value in parameters.items()]
        self._process = subprocess.Popen(
            [
                *("drill_node", "--ros-args", "-r", f"__ns:={self.namespace}"),
                *("--log-level", "error"),
                *(word for pair in words for word in ("-p", pair)),
            ],
            preexec_fn=end_with_parent,
        )

    def __enter__(self) -> Talk:
        return self

    def __exit__(self, *_: object) -> None:
        end([self])

    def interrupt(self) -> None:
        """Ask the process to end."""
        self._process.send_signal(signal.SIGINT)

    def wait(self, seconds: float) -> None:
        """Wait until the process has ended, but not longer than this."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(max(0.0, seconds))

    def close(self) -> bool:
        """End the process if it still runs, and the listener; return whether it still ran."""
        running = self._process.poll() is None
        self._process.kill()
        self._process.wait()
        self.node.destroy_node()
        return running

    def status(self) -> Any:
        """Return the last status."""
        return self.hearing.last("status")

    def diagnostics(self) -> dict[str, str]:
        """Return the values of the process' last diagnostics, by key.

        Another process' may be the last that was heard: then the next ones are waited for.
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
        """Wait until the process is heard, and some seconds more."""
        if not self.hearing.take_until(lambda: self.hearing.messages["waveform"] > 0, _STARTING):
            raise RuntimeError(f"nothing was heard within {_STARTING:g} s")
        self.listen(seconds)

    def reset(self) -> None:
        """Let the drill begin again: its counts of blocks are those from now on."""
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
        self.listen(seconds)
        elapsed = time.monotonic() - began
        differences = zip(self._counts(), before, strict=True)
        return Counted(*((now - then) / elapsed for now, then in differences))

    def _counts(self) -> tuple[float, float, float]:
        return (
            self.hearing.bytes,
            self.hearing.messages["contact_force"],
            used_by(self._process.pid),
        )


def end(talks: Sequence[Talk], seconds: float = _ENDING) -> int:
    """Interrupt all processes, and kill those that still run after some seconds.

    It prints and returns their number. Another interrupt ends the wait.
    """
    try:
        deadline = time.monotonic() + seconds
        for talk in talks:
            talk.interrupt()
        for talk in talks:
            talk.wait(deadline - time.monotonic())
    finally:
        killed = sum([talk.close() for talk in talks])
        if killed:
            line = f"  {killed} of {len(talks)} drills killed: they had not ended after SIGINT"
            print(line, file=sys.stderr, flush=True)
    return killed
