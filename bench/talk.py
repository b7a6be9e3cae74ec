"""A drill's node in a separate process, and what an independent listener receives from it."""

from __future__ import annotations

import contextlib
import os
import signal
import struct
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from rclpy.client import Client
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rpud_msgs.msg import Result
from rpud_msgs.srv import ResetSimulation

from rpud_sim.foundation.child_process import end_with_parent
from rpud_sim.foundation.time import join_seconds
from rpud_sim.ros.drill.publishers import OF_NODE
from rpud_sim.ros.endpoints import SequenceGaps
from rpud_sim.ros.graph import message_class
from rpud_sim.ros.threads import DelayHistogram
from rpud_sim.simulation.topics import TOPICS

_KINDS = {name: message_class(topic.type) for name, topic in {**TOPICS, **OF_NODE}.items()}
_STARTING = 60.0  # that a process may take until its first message [s]
_ENDING = 30.0  # that a process may take to end after SIGINT [s]
_SETTLING = 2.0  # between the first message and the first result [s]
_TAKE_PERIOD = 0.002  # [s]
_ANSWERING = 10.0  # that a reply may take [s]
_POLL_PERIOD = 1e-4  # between looks for a reply [s]
_STAMP = struct.Struct("<iI")  # after the four bytes of the encapsulation


@contextlib.contextmanager
def ros() -> Iterator[None]:
    """Initialise ROS, and shut it down."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        rclpy.try_shutdown()


def called(client: Client) -> Any:
    """Call a service; take its reply when the middleware has it.

    An executor would add milliseconds, and take messages.
    """
    client.call_async(client.srv_type.Request())
    end = time.monotonic() + _ANSWERING
    while (reply := client.handle.take_response(client.srv_type.Response)[1]) is None:
        if time.monotonic() > end:
            raise RuntimeError(f"no reply within {_ANSWERING:g} s")
        time.sleep(_POLL_PERIOD)
    return reply


class Hearing:
    """Counts of messages received on all topics of a drill, and the last message of each.

    Messages are taken as bytes and in batches: an executor costs so much more for each that on a
    busy machine the listener would be what loses them.
    """

    def __init__(self, node: Node) -> None:
        kinds = {name: kind for name, kind in _KINDS.items() if name != "faults"}
        self.messages = dict.fromkeys(kinds, 0)
        # Others publish /diagnostics, too.
        self.gaps = {name: SequenceGaps(partial(node.count_publishers, name)) for name in kinds}
        self.bytes = 0
        self.delays = DelayHistogram()  # of impacts, from the stamp to the arrival
        self.soonest: tuple[int, int] | None = None  # stamp and monotonic arrival of a nodal plane
        self._last: dict[str, bytes] = {}
        self._subscriptions = {
            name: node.create_subscription(
                kind, name, lambda _: None, QoSProfile(depth=5000), raw=True
            )
            for name, kind in kinds.items()
        }

    def last(self, topic: str) -> Any:
        """Return the last message of a topic, None before the first."""
        content = self._last.get(topic)
        return deserialize_message(content, _KINDS[topic]) if content else None

    def take(self) -> None:
        """Take the messages that arrived since the last call."""
        for name, subscription in self._subscriptions.items():
            handle, kind = subscription.handle, _KINDS[name]
            with handle:
                while (taken := handle.take_message(kind, True)) is not None:
                    self._count(name, *taken)

    def _count(self, name: str, data: bytes, info: Mapping[str, int]) -> None:
        self.gaps[name].record(info["publication_sequence_number"])
        self.messages[name] += 1
        self.bytes += len(data)
        self._last[name] = data
        if name in ("contact_force", "nodal_plane"):
            stamp = join_seconds(*_STAMP.unpack_from(data, 4))
            if name == "contact_force":
                self.delays.add(info["received_timestamp"] - stamp)
                return
            # When it came to this process, however much later it is taken.
            arrival = time.monotonic_ns() - (time.time_ns() - info["received_timestamp"])
            if self.soonest is None or arrival - stamp < self.soonest[1] - self.soonest[0]:
                self.soonest = stamp, arrival

    def take_until(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Take messages until a condition holds, or so many seconds; return whether it holds."""
        end = time.monotonic() + seconds
        while not (holds := condition()) and time.monotonic() < end:
            self.take()
            time.sleep(_TAKE_PERIOD)
        return holds


class Talk:
    """A drill's node in a separate process, and the messages received from it."""

    def __init__(self, parameters: Mapping[str, object]) -> None:
        self.namespace = f"/bench_{os.getpid()}_{time.monotonic_ns()}"
        self.node: Node = rclpy.create_node("listener", namespace=self.namespace)
        self.hearing = Hearing(self.node)
        words = [word for k, v in parameters.items() for word in ("-p", f"{k}:={v}")]
        command = ("drill_node", "--ros-args", "-r", f"__ns:={self.namespace}")
        self.process = subprocess.Popen(
            (*command, "--log-level", "error", *words), preexec_fn=end_with_parent
        )

    def __enter__(self) -> Talk:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        self.node.destroy_node()

    def end(self) -> int:
        """End the process as Ctrl-C does, taking its last messages; return its exit code."""
        self.process.send_signal(signal.SIGINT)
        if not self.hearing.take_until(lambda: self.process.poll() is not None, _ENDING):
            self.process.kill()
        self.process.wait()
        self.listen(0.5)  # what is still on its way
        return self.process.returncode

    def memory(self) -> float:
        """Return the resident memory of the process [KiB]."""
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        return float(text.partition("VmRSS:")[2].split()[0])

    def diagnostics(self) -> dict[str, str]:
        """Return the values of the process' last diagnostics, by key."""
        own: dict[str, str] = {}

        def found() -> bool:
            last = self.hearing.last("/diagnostics")
            for status in last.status if last else ():
                if status.name.startswith(f"{self.namespace}/"):  # not another process'
                    own.update({pair.key: pair.value for pair in status.values})
            return bool(own)

        if not self.hearing.take_until(found, _STARTING):
            raise RuntimeError(f"no diagnostics within {_STARTING:g} s")
        return own

    def settle(self) -> None:
        """Wait for the first waveform, and some seconds more; then let the drill begin again.

        Its counts of blocks are those from then on.
        """
        if not self.hearing.take_until(lambda: self.hearing.messages["waveform"] > 0, _STARTING):
            raise RuntimeError(f"nothing was received within {_STARTING:g} s")
        self.listen(_SETTLING)
        client = self.node.create_client(ResetSimulation, "simulation/reset")
        if not client.wait_for_service(_STARTING):
            raise RuntimeError("there is no service simulation/reset")
        reply = called(client)
        if reply.result.result != Result.RESULT_OK:
            raise RuntimeError(f"the drill has not begun again: {reply}")

    def listen(self, seconds: float) -> None:
        """Take messages for some time."""
        self.hearing.take_until(lambda: False, seconds)
