"""Live line and summary of ``rpud run``: what the drill does, and how well."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import TYPE_CHECKING, TypeVar

from rpud_sim.foundation.quantities import counted
from rpud_sim.foundation.shown_quantities import QUANTITIES
from rpud_sim.foundation.terminal import columns, printable

if TYPE_CHECKING:
    from rpud_sim.ros.drill.health import Report
    from rpud_sim.simulation.faults import FaultRecord
    from rpud_sim.simulation.metrics import Values

Opened = TypeVar("Opened")

_FAULTS_LISTED = 10  # greatest number of faults in the summary

_LOG_FORMAT = "RCUTILS_CONSOLE_OUTPUT_FORMAT"
_ROS_LOG_FORMAT = "[{severity}] [{time}] [{name}]: {message}"
_ERASE = "\r\x1b[K"

# Parts that are left out on a narrow terminal, the least important first.
_LEFT_OUT = ("reacting", "factor", "late", "contact", "dropped", "rotation", "feed", "faults")


class LiveLine:
    """State, forces and timing of the last second: one line that a terminal sees rewritten."""

    def __init__(self, shown: bool) -> None:
        self._shown = shown
        self._terminal = sys.stderr.isatty()
        self._last: Report | None = None
        self._printed: Report | None = None

    def show(self, report: Report | None) -> None:
        """Show a report, unless it was the last one shown.

        On a terminal each report rewrites the line. Elsewhere there is a line for each second in
        which the drill moved, and none while simulation time is paused.
        """
        if not self._shown or report is None or report is self._last:
            return
        self._last = report
        moved = bool(report.figures["duration"])
        if self._terminal:
            # Before the first block there is nothing to show, unless it waits.
            if moved or self._printed is not None or report.status["state"] == "paused":
                self._printed = report
                text = live_text(report, columns(sys.stderr))
                print(f"{_ERASE}{text}", end="", file=sys.stderr, flush=True)
        elif moved and (self._printed is None or report.figures is not self._printed.figures):
            self._printed = report
            print(live_text(report), file=sys.stderr, flush=True)

    def __enter__(self) -> LiveLine:
        return self

    def __exit__(self, *_: object) -> None:
        """Begin a new line after the last report."""
        if self._terminal and self._printed is not None:
            print(file=sys.stderr, flush=True)


@contextmanager
def logging_above(live: bool, opening: AbstractContextManager[Opened]) -> Iterator[Opened]:
    """Enter a context that starts ROS, whose log lines erase a live line first.

    A rejected command is logged with its reason. Otherwise the text would continue the live line.
    Processes that are started later do not inherit it.
    """
    with ExitStack() as stack:
        before = os.environ.get(_LOG_FORMAT)
        if live and sys.stderr.isatty():
            os.environ[_LOG_FORMAT] = r"\r\x1b[K" + (before or _ROS_LOG_FORMAT)
        try:
            opened = stack.enter_context(opening)
        finally:
            if before is not None:
                os.environ[_LOG_FORMAT] = before
            else:
                os.environ.pop(_LOG_FORMAT, None)
        yield opened


def live_text(report: Report, width: int | None = None) -> str:
    """Return the live line of a report, at most as wide as a terminal of ``width`` columns.

    Where it is as long, its parts are shorter, and less important ones are left out: it would wrap,
    and scroll.
    """
    parts = _parts(report)
    text = _joined(parts)
    if width is None:
        return text
    for name in ("", *_LEFT_OUT):
        if len(text) < width:
            return text
        parts.pop(name, None)
        text = _joined(parts, -1)
    return text[: max(0, width - 1)]


def summary_text(metrics: Values, report: Report | None, faults: Sequence[FaultRecord] = ()) -> str:
    motion = _joined(_motion(metrics, [record.fault.kind for record in faults]))
    lines = [f"drilled {metrics['duration']:.2f} s: {motion}"]
    if report is None:
        return lines[0]
    status, timing = report.status, report.timing
    lines.append(
        f"{counted(status['impacts'], 'impact')}, "
        f"{counted(timing['deadlines_missed'], 'deadline')} missed, "
        f"{counted(status['commands_accepted'], 'command')} accepted, "
        f"{status['commands_rejected']} rejected, "
        f"{counted(timing['messages_dropped'], 'message')} dropped"
    )
    if math.isfinite(status["depth"]):
        lines.append(f"depth {_shown('depth', status['depth'])}")
    if report.requests_refused:
        lines.append(f"{counted(report.requests_refused, 'request')} rejected")
    if report.last_refusal:
        lines.append(f"last rejection: {printable(report.last_refusal)}")
    for record in faults[-_FAULTS_LISTED:]:
        end = "on" if record.clear is None else f"to {record.clear / 1e9:.3f} s"
        since = f"from {record.onset / 1e9:.3f} s {end}"
        lines.append(f"fault {record.number}: {record.fault} {since}")
    if len(faults) > _FAULTS_LISTED:
        lines.append(f"{len(faults) - _FAULTS_LISTED} earlier faults")
    return "\n".join(lines)


def _parts(report: Report) -> dict[str, tuple[str, ...]]:
    """Return the parts of a live line, some with a longer and a shorter form."""
    status, timing, process = report.status, report.timing, report.process
    kinds = [record.fault.kind for record in report.faults]
    parts: dict[str, tuple[str, ...]] = {
        "time": (f"{report.time / 1e9:7.1f} s",),
        "state": (status["state"],),
        "weight": (f"{_shown('weight_on_bit', status['weight_on_bit'])} on bit",),
        "drive": ("" if status["drive_enabled"] else "drive off",),
        "lost": ("commands lost" if status["commands_lost"] else "",),
        **_motion(report.figures, kinds),
    }
    if mount := process.mount:
        feed = f"feed {_shown('feed', mount.feed)}"
        parts["feed"] = (f"{feed}, {_shown('feed_rate', mount.rate)}", feed)
    if rotor := process.rotation:
        rate = "stalled" if rotor.stalled else _shown("rotation_rate", rotor.rate)
        parts["rotation"] = (f"{rate}, torque {_shown('torque', rotor.torque)}", rate)
    if math.isfinite(status["depth"]):
        depth = _shown("depth", status["depth"])
        parts["depth"] = (f"depth {depth}", depth)
    if hole := process.borehole:
        parts["layer"] = (f"in {printable(hole.layer)}" if hole.layer else "broken through",)
    if kinds:
        first = kinds[0] if len(kinds) == 1 else f"{kinds[0]} +{len(kinds) - 1}"
        parts["faults"] = (f"faults: {', '.join(dict.fromkeys(kinds))}", first)
    if rejected := status["commands_rejected"] + report.requests_refused:
        parts["rejected"] = (f"{rejected} rejected",)
    if dropped := timing["messages_dropped"]:
        parts["dropped"] = (f"{dropped} messages dropped", f"{dropped} dropped")
    parts["late"] = (f"late {_shown('lateness', timing['lateness_max'])}",)
    parts["factor"] = (f"x{timing['real_time_factor']:.3f}",)
    return parts


def _motion(metrics: Values, faults: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the rate of impacts, or why there are none, and the forces."""
    rate, mean = metrics["drill_tool_impact_rate"], metrics["contact_force_mean"]
    most, reacting = metrics["contact_force_max"], metrics["reacting_force_mean"]
    none = "jammed" if "free_mass_jammed" in faults else "no impacts"
    number = _shown("impact_rate", rate, unit=False)
    parts: dict[str, tuple[str, ...]] = {
        "impacts": (f"{number} impacts/s", f"{number}/s") if rate else (none,)
    }
    if mean is not None and most is not None:
        peak, greatest = _shown("peak_force", mean), _shown("peak_force", most)
        long = f"peak force {peak} mean {greatest} max"
        parts["contact"] = (long, f"peak {peak}, max {greatest}")
    if reacting is not None:
        load = _shown("reacting_force", reacting)
        parts["reacting"] = (f"reacting force {load}", f"reacting {load}")
    return parts


def _shown(name: str, value: float | None, unit: bool = True) -> str:
    return QUANTITIES[name].text(value, unit=unit)


def _joined(parts: dict[str, tuple[str, ...]], form: int = 0) -> str:
    return "  ".join(texts[form] for texts in parts.values() if texts[form])
