"""A drilling session: the node in this process, a recorder beside it, and a live line."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from typing import Any

import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.logging import get_logger
from rclpy.parameter import Parameter
from rclpy.validate_namespace import validate_namespace

import rpud_sim.bag
from rpud_sim.bag import BagError
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.terminal import complain, printable
from rpud_sim.ros.arguments import MAX_LOSS
from rpud_sim.ros.drill.drill_node import NAME, DrillNode, spin
from rpud_sim.ros.drill.namesakes import NamesakeSearch
from rpud_sim.ros.drill.report import Report
from rpud_sim.ros.starting import StartError, start_ros
from rpud_sim.ros.stopping import StopRequest
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.ensemble import Figures, compile_kernels

_READY = 15.0  # that the recorder may take to be ready [s]
_HEARD = 5.0  # that the middleware may then take to tell each of the other [s]
_CLOSING = 30.0  # that it may take to close its bag [s]


class RecorderProcess:
    """A recorder in a process of its own, so that a slow disk cannot make the drill late.

    Args:
        bag: the new bag's folder.
        namespace: to record.
        max_loss: that a crash of the recorder may cost at most [s].
    """

    def __init__(self, bag: str, namespace: str, max_loss: float) -> None:
        self._bag = bag
        self._ready, ready = os.pipe()
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-m", "rpud_sim.cli.main", "record"),
                *("--out", bag, "--namespace", namespace, "--until-eof"),
                # What it lacks is known here by numbers, not by whether there is anything.
                *("--max-loss", str(max_loss), "--allow-empty", "--ready-fd", str(ready)),
            ],
            pass_fds=(ready,),
            stdin=subprocess.PIPE,  # it ends with this process, whatever ends that
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="backslashreplace",
            # Ctrl-C must stop the drill first, and the recorder when it has everything.
            start_new_session=True,
        )
        os.close(ready)
        self._errors: list[str] = []
        # Its errors are read here alone: communicate() would take some of them away.
        self._stream, self._process.stderr = self._process.stderr or (), None
        self._reader = threading.Thread(target=self._read_errors, daemon=True)
        self._reader.start()

    def wait_until_ready(self, stop: StopRequest) -> bool:
        """Wait until it records; tell whether it does."""
        end = time.monotonic() + _READY
        while time.monotonic() < end and not stop.requested:
            readable, _, _ = select.select([self._ready], [], [], 0.05)
            if readable:
                return bool(os.read(self._ready, 1))  # nothing is read where it has ended
        return False

    def close(self) -> int:
        """Have it close its bag, show its summary, and return 0 if it recorded until now."""
        early = self._process.poll() is not None
        if not early:
            self._process.terminate()
        try:
            summary, _ = self._process.communicate(timeout=_CLOSING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            summary, _ = self._process.communicate()
        self._reader.join(1.0)
        os.close(self._ready)
        if summary:
            print(summary, end="", flush=True)
        code = self._process.returncode
        if code != 0:
            shown = [line for line in self._errors if line.startswith("rpud")]
            if not shown and code < 0:
                shown = [f"rpud run: the recorder was ended by signal {-code}; its bag is torn"]
            print("\n".join(shown or self._errors[-3:]), file=sys.stderr)
        elif early:
            complain("rpud run", "the recorder was stopped before the drill")
            return 1
        return code

    def missing(self, sent: Mapping[str, int]) -> list[str]:
        """Compare the closed bag with the messages that were sent on each topic; say what lacks."""
        try:
            with rpud_sim.bag.open(self._bag) as bag:
                recorded = {item.topic.name: item.message_count for item in bag.topics}
        except BagError as error:
            return [str(error)]
        return [
            f"{name}: {count} messages were sent, {recorded.get(name, 0)} are in the bag"
            for name, count in sorted(sent.items())
            if recorded.get(name, 0) < count
        ]

    def _read_errors(self) -> None:
        for line in self._stream:
            self._errors.append(line.rstrip("\n"))


def drill(
    values: Mapping[str, Any],
    namespace: str,
    duration: float | None = None,
    bag: str | None = None,
    live: bool = True,
    max_loss: float = MAX_LOSS,
    allow_duplicate: bool = False,
) -> int:
    """Drill in real time and return the exit code.

    Args:
        values: parameters by name.
        namespace: of the node.
        duration: after which it stops [s]; None for never.
        bag: folder of a bag to record into.
        live: whether to show a live line.
        max_loss: that a crash of the recorder may cost at most [s].
        allow_duplicate: whether to drill beside a drill of the same name.
    """
    try:
        settings = to_settings(values)
        validate_namespace(f"/{namespace.removeprefix('/')}")
    except ParameterError as error:
        complain("rpud run", error)
        return 2
    except InvalidNamespaceException as error:
        what, name, *_ = str(error).splitlines()  # below them it points at the character
        complain("rpud run", f"{what} {name.strip()}")
        return 2
    with StopRequest() as stop:
        try:
            start_ros()
        except StartError as error:
            print(f"rpud run: {error}", file=sys.stderr)
            return 2
        try:
            if not allow_duplicate:
                search = NamesakeSearch(NAME, namespace)
                # Meanwhile, so that the search costs no time.
                compile_kernels(settings.configuration.parameters, get_logger(NAME).info)
                if search.finish():
                    print(
                        f"rpud run: a drill named {search.name} runs already: choose another "
                        "--namespace, or give --allow-duplicate",
                        file=sys.stderr,
                    )
                    return 1
            overrides = [
                Parameter(name, value=float(value) if _is_whole(value) else value)
                for name, value in values.items()
            ]
            try:
                node = DrillNode(duration, namespace=namespace, parameter_overrides=overrides)
            except ParameterError as error:
                complain("rpud run", error)
                return 2
            return _drill(node, stop, bag, namespace, live, max_loss)
        finally:
            rclpy.try_shutdown()


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _drill(
    node: DrillNode,
    stop: StopRequest,
    bag: str | None,
    namespace: str,
    live: bool,
    max_loss: float,
) -> int:
    recorder = None
    if bag:
        try:
            node.prepare()  # so that the recorder finds its topics, and has the first message
        except RuntimeError as error:
            complain("rpud run", error)
            return 1
        recorder = RecorderProcess(bag, namespace, max_loss)
        if not recorder.wait_until_ready(stop):
            code = recorder.close()
            return 0 if stop.requested and code == 0 else 1
        _await_recorder(node, stop)
        node.count_sent()
    line = LiveLine(live)
    try:
        code = spin(node, stop, line.show)
    finally:
        line.end()
        recorded = recorder is None or recorder.close() == 0
    if recorder is not None and recorded:
        for text in recorder.missing(node.sent):
            recorded = False
            print(f"rpud run: {text}", file=sys.stderr)
    print(summary_text(node.totals.figures(), node.report), flush=True)
    if bag and recorded:
        print(f"bag: {printable(bag)}", flush=True)
    return code if recorded else 1


def _await_recorder(node: DrillNode, stop: StopRequest) -> None:
    """Wait until all topics are heard, and say so where some are not."""
    end = time.monotonic() + _HEARD
    while node.unheard and time.monotonic() < end and not stop.wait(0.01):
        pass
    if node.unheard and not stop.requested:
        node.get_logger().warning(f"not heard by the recorder: {', '.join(node.unheard)}")


class LiveLine:
    """Rate and forces of the last second: a line that a terminal sees rewritten."""

    def __init__(self, shown: bool) -> None:
        self._shown = shown
        self._terminal = sys.stderr.isatty()
        self._last: Report | None = None

    def show(self, report: Report | None) -> None:
        """Show a report that has not been shown yet."""
        if not self._shown or report is None or report is self._last:
            return
        self._last = report
        if report.figures["duration"]:
            start, end = ("\r\x1b[K", "") if self._terminal else ("", "\n")
            print(start + live_text(report), end=end, file=sys.stderr, flush=True)

    def end(self) -> None:
        """Leave the line."""
        if self._shown and self._terminal and self._last is not None:
            print(file=sys.stderr, flush=True)


def live_text(report: Report) -> str:
    """Return the live line of a report."""
    timing = report.timing
    return (
        f"{report.time / 1e9:7.1f} s  {_figures_text(report.figures)}  "
        f"late {1e3 * timing.lateness_max:.1f} ms  x{timing.real_time_factor:.3f}"
    )


def summary_text(figures: Figures, report: Report | None) -> str:
    """Return the summary of a session."""
    text = f"drilled {figures['duration']:.2f} s: {_figures_text(figures)}"
    if report is None:
        return text
    counts = report.bookkeeping
    return (
        f"{text}\n{report.status['impacts']} impacts, {counts.deadlines_missed} deadlines missed, "
        f"{counts.commands_accepted} commands accepted, {counts.commands_rejected} refused, "
        f"{counts.messages_dropped} messages dropped"
    )


def _figures_text(figures: Figures) -> str:
    def shown(name: str, places: int) -> str:
        value = figures[name]
        return "-" if value is None else f"{value:.{places}f}"

    return (
        f"{shown('drill_tool_impact_rate', 0)} impacts/s  "
        f"contact force {shown('contact_force_mean', 0)} N mean "
        f"{shown('contact_force_max', 0)} N max  "
        f"reacting force {shown('reacting_force_mean', 1)} N"
    )
