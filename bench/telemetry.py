"""The node's telemetry: its share of a core, how late its blocks are, how much it publishes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from bench.hearing import Hearing
from bench.row import Row, row
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.drill.publishers import DIAGNOSTICS
from rpud_sim.ros.lateness import Lateness
from rpud_sim.ros.types import message_class
from rpud_sim.simulation.topics import TOPICS

PERIOD = 0.01  # of blocks at the default rate [s]
SECONDS = 20.0  # of listening at each load
TURNS = 5  # of the comparison of bytes
TURN_SECONDS = 3.0
LOADS: Mapping[str, Mapping[str, object]] = {
    "default": {},
    # Five channels and more at 100 kHz, about 1,500 impacts per second, scalars at 1 kHz.
    "largest": {"weight_on_bit": 80.0, "sample_rate": 100_000, "telemetry_rate": 1000},
}
_KINDS = {
    name: message_class(topic.type)
    for name, topic in {**TOPICS, "/diagnostics": DIAGNOSTICS}.items()
}
_STARTING = 60.0  # that a process may take until it is heard [s]
_SETTLING = 2.0  # between the first message and the first figure [s]


def telemetry(seconds: float = SECONDS) -> Iterator[Row]:
    """Run the node under an independent listener, at its default rates and at the largest.

    Args:
        seconds: of listening at each load.
    """
    yield from _timer(seconds)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        for name, parameters in LOADS.items():
            yield from _real_time(name, parameters, seconds)
        for name, parameters in LOADS.items():
            yield from _throughput(name, parameters)
    finally:
        rclpy.try_shutdown()


def _timer(seconds: float) -> Iterator[Row]:
    """How late this machine wakes a thread that waits for every default period and does nothing."""
    wake, lateness = threading.Event(), Lateness()
    due = time.monotonic_ns()
    for _ in range(round(seconds / PERIOD)):
        due += round(PERIOD * SECOND)
        wake.wait(max(0.0, (due - time.monotonic_ns()) / SECOND))
        lateness.add(time.monotonic_ns() - due)
    for key, share in (("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999)):
        late = 1e3 * lateness.quantile(share)
        yield row(f"telemetry: lateness of a bare timer, {key}", [late], "ms")


def _real_time(name: str, parameters: Mapping[str, object], seconds: float) -> Iterator[Row]:
    with _Talk("drill_node", parameters) as talk:
        counted = talk.measure(seconds)
        talk.interrupt()
        hearing = talk.hearing
        hearing.take_until(lambda: talk.status().state == "stopped", 30.0)
        status, timing = talk.status(), hearing.last("/diagnostics").status[0]
        values = {pair.key: pair.value for pair in timing.values}
        yield row(f"telemetry, {name}: share of one core", [100.0 * counted.share], "%")
        yield row(f"telemetry, {name}: impacts per second", [counted.impacts], "1/s")
        yield row(f"telemetry, {name}: bytes per second", [counted.bytes], "B/s")
        for key in ("p50", "p99", "p99.9"):
            late = 1e3 * float(values[f"lateness_{key} [s]"])
            yield row(f"telemetry, {name}: lateness of blocks, {key}", [late], "ms")
        yield row(f"telemetry, {name}: greatest lateness of each second", talk.late, "ms")
        yield row(f"telemetry, {name}: blocks late by a period", [status.deadlines_missed])
        yield row(f"telemetry, {name}: messages dropped", [status.messages_dropped])
        yield row(f"telemetry, {name}: load of the machine", [os.getloadavg()[0]])


def _throughput(name: str, parameters: Mapping[str, object]) -> Iterator[Row]:
    """Bytes per second of the node in a hurry and of a bare loop, in turns."""
    ours, bare = [], []
    for _ in range(TURNS):
        with _Talk("drill_node", {**parameters, "real_time_factor": 0.0}) as talk:
            ours.append(talk.measure(TURN_SECONDS).bytes)
        with _Talk("bare_talker", parameters) as talk:
            bare.append(talk.measure(TURN_SECONDS).bytes)
    yield row(f"telemetry, {name}: bytes per second, as fast as possible", ours, "B/s")
    yield row(f"telemetry, {name}: bytes per second, bare rclpy", bare, "B/s")
    ratios = [a / b for a, b in zip(ours, bare, strict=True)]
    yield row(f"telemetry, {name}: bytes per second over bare rclpy", ratios)


class _Counted(NamedTuple):
    """What was heard per second, and the process' share of one core."""

    bytes: float
    impacts: float
    share: float


class _Talk:
    """A process that publishes a drill's topics, and what is heard of it."""

    def __init__(self, program: str, parameters: Mapping[str, object]) -> None:
        namespace = f"/bench_{os.getpid()}_{time.monotonic_ns()}"
        self._node: Node = rclpy.create_node("listener", namespace=namespace)
        kinds = {name: kind for name, kind in _KINDS.items() if name != "faults"}
        self.hearing = Hearing(self._node, kinds, ("status", "/diagnostics"))
        words = [f"{key}:={value}" for key, value in parameters.items()]
        talker = (sys.executable, "-m", f"bench.{program}")
        self._process = subprocess.Popen(
            [
                *(("drill_node",) if program == "drill_node" else talker),
                *("--ros-args", "-r", f"__ns:={namespace}"),
                *("--log-level", "error"),
                *(word for pair in words for word in ("-p", pair)),
            ]
        )
        self.late: list[float] = []

    def __enter__(self) -> _Talk:
        return self

    def __exit__(self, *_: object) -> None:
        self.interrupt()
        try:
            self._process.wait(30.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._node.destroy_node()

    def interrupt(self) -> None:
        """Ask the process to end."""
        self._process.send_signal(signal.SIGINT)

    def status(self) -> Any:
        """The last status."""
        return self.hearing.last("status")

    def measure(self, seconds: float) -> _Counted:
        """Listen for some time, once the process is heard."""
        hearing = self.hearing
        if not hearing.take_until(lambda: hearing.messages["waveform"] > 0, _STARTING):
            raise RuntimeError(f"nothing was heard within {_STARTING:g} s")
        hearing.take_until(_never, _SETTLING)
        began, before = time.monotonic(), self._counts()
        while (elapsed := time.monotonic() - began) < seconds:
            hearing.take_until(_never, min(1.0, seconds - elapsed))
            if self.status() is not None:
                self.late.append(1e3 * self.status().lateness_max)
        differences = zip(self._counts(), before, strict=True)
        return _Counted(*((now - then) / elapsed for now, then in differences))

    def _counts(self) -> tuple[float, float, float]:
        return self.hearing.bytes, self.hearing.messages["contact_force"], self._used()

    def _used(self) -> float:
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _never() -> bool:
    return False
