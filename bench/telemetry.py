"""The node's telemetry: its share of a core, and how late its blocks and its replies are."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import rclpy
from rpud_msgs.msg import WeightOnBit
from rpud_msgs.srv import ListFaults

from bench.bare_timer import PRIORITY, SHARES, BareTimer
from bench.command import RPUD
from bench.table import Row, row, used_by
from bench.talk import Talk, called, ros
from rpud_sim.ros.threads import DelayHistogram

SECONDS = 600.0  # of listening at the default rates: one block of 1,000 comes in 10 s
LARGEST_SECONDS = 60.0  # of listening at the largest, where it comes each second
LOADS: Mapping[str, Mapping[str, object]] = {
    "default": {},
    # Five channels and more at 100 kHz, about 1,500 impacts per second, scalars at 1 kHz.
    "largest": {"weight_on_bit": 80.0, "sample_rate": 100_000, "telemetry_rate": 1000},
}
_REQUESTS = 20.0  # of commands and of calls of a service, each [1/s]
_TIME_SHARING = "an ordinary bare timer, without a priority"
_OF_ITS_PRIORITY = "a bare timer with the node's priority"
_CALLS = 200  # of a service
_WEIGHTS = (59.0, 60.0)  # of the commands, in turns [N]


def telemetry(seconds: float = SECONDS) -> Iterator[Row]:
    """Run the node under an independent listener, at its default rates and at the largest."""
    with ros():
        yield from _real_time("default", seconds)
        yield from _real_time("largest", min(seconds, LARGEST_SECONDS))


def _real_time(name: str, seconds: float) -> Iterator[Row]:
    """Listen to the node beside bare timers; at the largest load beside a recorder."""
    largest = name == "largest"
    with contextlib.ExitStack() as stack:
        talk = stack.enter_context(Talk(LOADS[name]))
        running: dict[str, BareTimer] = {}
        if largest:
            stack.enter_context(_recorder(talk.namespace))
        else:
            for key, priority in ((_TIME_SHARING, 0), (_OF_ITS_PRIORITY, PRIORITY)):
                running[key] = stack.enter_context(BareTimer(priority))
        talk.settle()  # the starts of the others took time from it
        began, heard, sent = time.monotonic(), talk.hearing.delays.count, talk.hearing.bytes
        used = used_by(talk.process.pid)
        talk.listen(seconds)
        elapsed = time.monotonic() - began
        share = 100.0 * (used_by(talk.process.pid) - used) / elapsed
        late = {key: each.end() for key, each in running.items()}
        values = talk.diagnostics()
        impacts = talk.hearing.delays
        goals = {} if largest else {"most": 8.0}
        what = f"telemetry, {name}"
        yield row(f"{what}: share of one core", share, "%", **goals)
        yield row(f"{what}: impacts", (impacts.count - heard) / elapsed, "1/s")
        yield row(f"{what}: bytes", (talk.hearing.bytes - sent) / elapsed, "B/s")
        for key, quantile in SHARES.items():
            ours = 1e3 * float(values[f"lateness_{key} [s]"])
            goals = {"most": 5.0} if largest and key == "p99.9" else {}
            yield row(f"{what}: lateness of blocks, {key}", ours, "ms", **goals)
            for bare, quantiles in late.items():
                # Like with like.
                goals = {"most": 1.1} if key == "p99.9" and bare == _OF_ITS_PRIORITY else {}
                over = f"{what}: lateness of blocks over {bare}, {key}"
                yield row(over, ours / quantiles[key], **goals)
            delay = 1e3 * impacts.quantile(quantile)
            yield row(f"{what}: an impact, stamp to arrival, {key}", delay, "ms")
        missed, count = int(values["deadlines_missed"]), int(values["blocks"])
        goals = {"least": 99.9} if largest else {}
        yield row(f"{what}: blocks within their period", 100.0 * (1 - missed / count), "%", **goals)
        yield row(f"{what}: messages dropped", int(values["messages_dropped"]), most=0)
        yield from _answers(name, talk)


def _answers(name: str, talk: Talk) -> Iterator[Row]:
    """Give commands and call a service, both served by the thread that publishes the blocks."""
    caller = rclpy.create_node("caller", namespace=talk.namespace)
    commands = caller.create_publisher(WeightOnBit, "command/weight_on_bit", 10)
    client = caller.create_client(ListFaults, "list_faults")
    if not client.wait_for_service(10.0):
        raise RuntimeError("there is no service list_faults")
    replies = DelayHistogram()
    for number in range(_CALLS):
        commands.publish(WeightOnBit(force=_WEIGHTS[number % 2]))
        began = time.monotonic_ns()
        called(client)
        replies.add(time.monotonic_ns() - began)
        talk.listen(max(0.0, 1.0 / _REQUESTS - (time.monotonic_ns() - began) / 1e9))
    caller.destroy_node()
    what = f"telemetry, {name}: reply to a call"
    yield row(f"{what}, p50", 1e3 * replies.quantile(0.5), "ms")
    yield row(f"{what}, p99", 1e3 * replies.quantile(0.99), "ms")
    yield row(f"{what}, slowest", 1e3 * replies.greatest, "ms", most=50.0)


@contextlib.contextmanager
def _recorder(namespace: str) -> Iterator[None]:
    """Record a namespace; it has begun when the context is entered."""
    with tempfile.TemporaryDirectory() as folder:
        begun, ready = os.pipe()
        words = ("--out", str(Path(folder, "bag")), "--ready-fd", str(ready))
        process = subprocess.Popen(
            (*RPUD, "record", "--namespace", namespace, *words),
            stdout=subprocess.DEVNULL,
            pass_fds=(ready,),
        )
        os.close(ready)
        try:
            with os.fdopen(begun) as line:
                line.readline()
            yield
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(60.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
