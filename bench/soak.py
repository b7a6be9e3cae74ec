"""Soak: a drill in a process of its own for a long time, under an independent listener's eyes.

`make soak` runs it for 30 minutes, `make soak DURATION=60` for 60 s, and `RECORD=DIR` adds a
recorder. It prints a table of verdicts and exits 1 if one of them is a failure.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rpud_msgs.msg import (
    ContactForce,
    DrillTool,
    NodalPlane,
    ReactingForce,
    Status,
    Timing,
    Trajectory,
    Waveform,
)
from sensor_msgs.msg import JointState
from tqdm import tqdm

from bench import soak_checks as checks
from bench.soak_checks import Tally, Verdict

SECOND = 1_000_000_000
TELEMETRY_RATE = 100  # the node's default [Hz]
TELEMETRY = {
    "nodal_plane": NodalPlane,
    "drill_tool": DrillTool,
    "reacting_force": ReactingForce,
    "wrench": WrenchStamped,
    "joint_states": JointState,
}
STREAMS = {"waveform": Waveform, "trajectory": Trajectory}
STARTING = 60.0  # that the drill may take until it is heard [s]
STOPPING = 30.0  # that a process may take to end [s]
_TAKE_PERIOD = 0.005  # [s]
_DEEP = QoSProfile(depth=5000)
_LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Listener:
    """Hears every topic of a drill and keeps nothing but counts, and one arrival per second.

    Messages are taken in batches: an executor costs so much more for each that on a busy machine
    the listener would be what loses them.

    Args:
        node: to subscribe with; its namespace is the drill's.
    """

    def __init__(self, node: Node) -> None:
        self.tallies = {name: Tally() for name in (*TELEMETRY, *STREAMS, "contact_force")}
        self.status: Status | None = None
        self.timing: Timing | None = None
        self.arrivals: list[tuple[int, int]] = []  # stamp and arrival of each second's soonest [ns]
        self._second = -1
        self._start: int | None = None
        self._hear = {
            **{name: (kind, self._on_telemetry) for name, kind in TELEMETRY.items()},
            "contact_force": (ContactForce, self._on_contact_force),
            "waveform": (Waveform, self._on_waveform),
            "trajectory": (Trajectory, self._on_trajectory),
            "status": (Status, self._on_report),
            "timing": (Timing, self._on_report),
        }
        self._subscriptions = {
            name: node.create_subscription(
                kind, name, lambda _: None, _LATCHED if name in ("status", "timing") else _DEEP
            )
            for name, (kind, _) in self._hear.items()
        }

    @property
    def stopped(self) -> bool:
        """Whether the drill has said that it ended."""
        return self.status is not None and self.status.state == Status.STATE_STOPPED

    def take(self) -> int:
        """Hear what has come since the last call, and return how many messages that was."""
        count = 0
        for name, subscription in self._subscriptions.items():
            kind, hear = self._hear[name]
            handle = subscription.handle
            with handle:
                while (taken := handle.take_message(kind, False)) is not None:
                    hear(name, *taken)
                    count += 1
        return count

    def take_until(self, condition: Callable[[], bool], seconds: float) -> None:
        """Hear until a condition holds, but not longer than this."""
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            self.take()
            time.sleep(_TAKE_PERIOD)

    def number(self, stamp: int) -> int:
        """Return the number of the sample at a stamp [ns], counted from the first one heard."""
        if self._start is None:
            self._start = stamp
        return round((stamp - self._start) * TELEMETRY_RATE / SECOND)

    def _on_telemetry(self, name: str, message: Any, info: Any) -> None:
        stamp = _stamp(message)
        self.tallies[name].add(self.number(stamp))
        if name != "nodal_plane":
            return
        # When it came to this process, however much later it is heard.
        waited = time.time_ns() - info["received_timestamp"]
        arrival = time.monotonic_ns() - waited
        if arrival // SECOND != self._second:
            self._second = arrival // SECOND
            self.arrivals.append((stamp, arrival))
        elif arrival - stamp < self.arrivals[-1][1] - self.arrivals[-1][0]:
            self.arrivals[-1] = stamp, arrival

    def _on_contact_force(self, name: str, message: ContactForce, info: Any) -> None:
        self.tallies[name].add(message.sequence)

    def _on_waveform(self, name: str, message: Waveform, info: Any) -> None:
        self.tallies[name].add(message.sequence, len(message.reacting_force))

    def _on_trajectory(self, name: str, message: Trajectory, info: Any) -> None:
        self.tallies[name].add(message.sequence, len(message.duration))

    def _on_report(self, name: str, message: Status | Timing, info: Any) -> None:
        setattr(self, name, message)


def _stamp(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


class Watched:
    """A process whose memory and CPU time are sampled.

    Args:
        name: for the table.
        command: that starts it.
    """

    def __init__(self, name: str, *command: str) -> None:
        self.name = name
        self.times: list[float] = []
        self.sizes: list[float] = []
        self._ticks: list[int] = []
        self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._process.poll() is None

    def check_running(self) -> None:
        """Raise RuntimeError if it has ended."""
        if not self.running:
            raise RuntimeError(f"{self.name} ended with exit code {self._process.returncode}")

    def sample(self) -> None:
        """Note memory [KiB] and CPU time; raise RuntimeError if it has ended."""
        self.check_running()
        folder = Path("/proc", str(self._process.pid))
        size = (folder / "status").read_text().partition("VmRSS:")[2].split()[0]
        fields = (folder / "stat").read_text().rpartition(")")[2].split()
        self.times.append(time.monotonic())
        self.sizes.append(float(size))
        self._ticks.append(int(fields[11]) + int(fields[12]))

    @property
    def cpu_share(self) -> float:
        """Share of one core between the first sample and the last [%]."""
        elapsed = self.times[-1] - self.times[0]
        used = (self._ticks[-1] - self._ticks[0]) / os.sysconf("SC_CLK_TCK")
        return 100.0 * used / elapsed if elapsed > 0.0 else 0.0

    def interrupt(self) -> None:
        """Ask it to end, as Ctrl-C does."""
        self._process.send_signal(signal.SIGINT)

    def wait(self) -> int | None:
        """Return its exit code, None if it had to be killed."""
        try:
            return self._process.wait(STOPPING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            return None


@dataclasses.dataclass(frozen=True)
class Result:
    """What a soak found: its verdicts, and what else is good to know, one line each."""

    verdicts: list[Verdict]
    notes: list[str]


def soak(duration: float, bag: str | None = None) -> Result:
    """Drill for some time and judge the drill.

    Args:
        duration: of the run after the drill was first heard [s].
        bag: folder of a new bag to record into; none is recorded without.

    Raises:
        RuntimeError: if a process ends early or the drill is not heard.
    """
    namespace = f"/soak_{os.getpid()}"  # two at once do not meet
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # Ctrl-C is ours to handle
    node = rclpy.create_node("listener", namespace=namespace)
    listener = Listener(node)
    processes: list[Watched] = []
    loads: list[float] = []
    try:
        if bag is not None:
            command = ("rpud", "record", "--namespace", namespace, "--out", bag)
            processes.append(Watched("recorder", *command))
        drill = Watched("drill", "drill_node", "--ros-args", "-r", f"__ns:={namespace}")
        processes.append(drill)
        tallies = listener.tallies.values()
        listener.take_until(
            lambda: not drill.running or all(tally.messages for tally in tallies), STARTING
        )
        drill.check_running()
        if not listener.arrivals:
            raise RuntimeError(f"the drill was not heard within {STARTING:g} s")
        _watch(listener, duration, processes, loads)
        drill.interrupt()
        listener.take_until(lambda: listener.stopped, STOPPING)
        listener.take_until(lambda: False, 1.0)  # what is still on its way
        ends = []
        for process in reversed(processes):
            if process is not drill:
                process.interrupt()
            ends.append(checks.ended(process.name, process.wait()))
        if listener.timing is None or not listener.stopped:
            raise RuntimeError("the drill's last status was not heard")
        verdicts = [*_verdicts(listener, processes, loads), *ends]
    finally:
        for process in processes:
            process.interrupt()
            process.wait()
        node.destroy_node()
        rclpy.try_shutdown()
    notes = [
        f"{process.name}: {process.cpu_share:.1f} % of one core, "
        f"{process.sizes[0] / 1024:.1f} MiB at first, {process.sizes[-1] / 1024:.1f} MiB at last"
        for process in processes
    ]
    return Result(verdicts, notes)


def _verdicts(listener: Listener, processes: list[Watched], loads: list[float]) -> list[Verdict]:
    status, timing = listener.status, listener.timing
    assert status
    assert timing
    last = listener.number(_stamp(status))
    stamps, arrivals = zip(*listener.arrivals, strict=True)
    tallies = listener.tallies
    return [
        *(checks.memory_growth(p.name, p.times, p.sizes) for p in processes),
        checks.real_time(stamps, arrivals),
        checks.deadlines(timing.deadlines_missed, last + 1, loads),
        checks.dropped(timing.messages_dropped),
        *(checks.telemetry(name, tallies[name], last) for name in TELEMETRY),
        checks.impacts(tallies["contact_force"], status.impacts),
        *(checks.stream(name, tallies[name]) for name in STREAMS),
    ]


def _watch(
    listener: Listener, duration: float, processes: list[Watched], loads: list[float]
) -> None:
    """Listen, and sample every second."""
    start = time.monotonic()
    with tqdm(total=round(duration), unit=" s", delay=2.0, disable=None, leave=False) as bar:
        for second in range(round(duration) + 1):
            listener.take_until(lambda: False, start + second - time.monotonic())
            for process in processes:
                process.sample()
            loads.append(os.getloadavg()[0])
            bar.update(second > 0)


def main() -> int:
    """Soak, print the table, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m bench.soak", description=__doc__)
    parser.add_argument("--duration", type=float, default=1800.0, metavar="S", help="of the run")
    parser.add_argument("--record", metavar="DIR", help="record into a new bag beside it")
    arguments = parser.parse_args()
    try:
        result = soak(arguments.duration, arguments.record)
    except (RuntimeError, KeyboardInterrupt) as error:
        print(f"soak: {str(error) or 'interrupted'}", file=sys.stderr)
        return 1
    print(checks.to_table(result.verdicts))
    print("\n".join(["", *result.notes]))
    failures = sum(not verdict.passed for verdict in result.verdicts)
    print(f"soak: {failures} of {len(result.verdicts)} failed" if failures else "soak: all passed")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
