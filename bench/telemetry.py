"""The node's telemetry: its share of a core, and how late its blocks and its replies are."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import rclpy
from rclpy.client import Client
from rpud_msgs.msg import WeightOnBit
from rpud_msgs.srv import ListFaults

from bench.bare_timer import SHARES
from bench.command import RPUD
from bench.table import Goal, Row, row
from bench.talk import Talk, ros
from rpud_sim.ros.threads import DelayHistogram
from rpud_sim.simulation.configuration import Settings

SECONDS = 600.0  # of listening at the default rates: one block of 1,000 comes in 10 s
LARGEST_SECONDS = 60.0  # of listening at the largest, where it comes each second
LOADS: Mapping[str, Mapping[str, object]] = {
    "default": {},
    # Five channels and more at 100 kHz, about 1,500 impacts per second, scalars at 1 kHz.
    "largest": {"weight_on_bit": 80.0, "sample_rate": 100_000, "telemetry_rate": 1000},
}
RATIO = Goal(most=1.1)
CORE = Goal(most=8.0)  # [%]
LATEST = Goal(most=5.0)  # [ms]
IN_TIME = Goal(least=99.9)  # [%]
REPLY = Goal(most=50.0)  # [ms]
_REQUESTS = 20.0  # of commands and of calls of a service, each [1/s]
_PRIORITY = Settings().thread_priority
_TIME_SHARING = "an ordinary bare timer, without a priority"
_OF_ITS_PRIORITY = "a bare timer with the node's priority"
_CALLS = 200  # of a service
_ANSWERING = 10.0  # that a reply may take [s]
_POLL_PERIOD = 1e-4  # between looks for a reply [s]
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
        running: dict[str, _BareTimer] = {}
        if largest:
            stack.enter_context(_recorder(talk.namespace))
        else:
            for key, priority in ((_TIME_SHARING, 0), (_OF_ITS_PRIORITY, _PRIORITY)):
                running[key] = stack.enter_context(_BareTimer(priority))
        talk.settle()
        talk.reset()  # the starts of the others took time from it
        counted = talk.measure(seconds)
        late = {key: each.quantiles() for key, each in running.items()}
        values = talk.diagnostics()
        impacts = talk.hearing.delays["contact_force"]
        yield row(
            f"telemetry, {name}: share of one core",
            [100.0 * counted.share],
            "%",
            None if largest else CORE,
        )
        yield row(f"telemetry, {name}: impacts per second", [counted.impacts], "1/s")
        yield row(f"telemetry, {name}: bytes per second", [counted.bytes], "B/s")
        for key in SHARES:
            ours = 1e3 * float(values[f"lateness_{key} [s]"])
            last = key == "p99.9"
            goal = LATEST if largest and last else None
            yield row(f"telemetry, {name}: lateness of blocks, {key}", [ours], "ms", goal)
            for bare, quantiles in late.items():
                what = f"telemetry, {name}: lateness of {bare}, {key}"
                yield row(what, [quantiles[key]], "ms")
                what = f"telemetry, {name}: lateness of blocks over that of {bare}, {key}"
                goal = RATIO if last and bare == _OF_ITS_PRIORITY else None  # like with like
                yield row(what, [ours / quantiles[key]], "", goal)
        missed = int(values["deadlines_missed"])
        yield row(f"telemetry, {name}: blocks late by a period", [missed])
        in_time = 100.0 * (1.0 - missed / int(values["blocks"]))
        goal = IN_TIME if largest else None
        yield row(f"telemetry, {name}: blocks within their period", [in_time], "%", goal)
        for key, share in SHARES.items():
            delay = 1e3 * impacts.quantile(share)
            yield row(f"telemetry, {name}: an impact, stamp to arrival, {key}", [delay], "ms")
        yield row(f"telemetry, {name}: messages dropped", [int(values["messages_dropped"])])
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
        client.call_async(ListFaults.Request())
        _await_reply(client)
        replies.add(time.monotonic_ns() - began)
        talk.listen(max(0.0, 1.0 / _REQUESTS - (time.monotonic_ns() - began) / 1e9))
    caller.destroy_node()
    yield row(f"telemetry, {name}: reply to a call, p50", [1e3 * replies.quantile(0.5)], "ms")
    yield row(f"telemetry, {name}: reply to a call, p99", [1e3 * replies.quantile(0.99)], "ms")
    yield row(f"telemetry, {name}: slowest reply to a call", [1e3 * replies.greatest], "ms", REPLY)


def _await_reply(client: Client) -> None:
    """Take a reply when the middleware has it: an executor would add milliseconds of its own."""
    end = time.monotonic() + _ANSWERING
    while client.handle.take_response(client.srv_type.Response)[1] is None:
        if time.monotonic() > end:
            raise RuntimeError(f"no reply within {_ANSWERING:g} s")
        time.sleep(_POLL_PERIOD)


class _BareTimer:
    """The program `bench.bare_timer` in a process of its own, with a priority."""

    def __init__(self, priority: int) -> None:
        words = (sys.executable, "-m", "bench.bare_timer", str(priority))
        self._process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)

    def __enter__(self) -> _BareTimer:
        assert self._process.stdout
        self._process.stdout.readline()  # it has begun
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()

    def quantiles(self) -> dict[str, float]:
        """End it, and return the quantiles of its lateness [ms]."""
        self._process.send_signal(signal.SIGINT)
        said, _ = self._process.communicate(timeout=30.0)
        found: dict[str, float] = json.loads(said)
        return found


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
