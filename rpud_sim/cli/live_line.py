"""Live line and summary of ``rpud run``: what the drill does, and how well."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import TYPE_CHECKING, TypeVar

from rpud_sim.foundation.terminal import columns, printable
from rpud_sim.pages.quantities import QUANTITIES

if TYPE_CHECKING:
    from rpud_sim.drilling.borehole import BoreholeState
    from rpud_sim.drilling.mount import MountState
    from rpud_sim.drilling.rotor import RotorState
    from rpud_sim.ros.drill.report import Report
    from rpud_sim.simulation.faults import FaultRecord
    from rpud_sim.simulation.statistics import Figures

Opened = TypeVar("Opened")

_JAMMED = "free_mass_jammed"
_FAULTS_LISTED = 10  # in the summary

_LOG_FORMAT = "RCUTILS_CONSOLE_OUTPUT_FORMAT"
_ROS_LOG_FORMAT = "[{severity}] [{time}] [{name}]: {message}"
_ERASE = "\r\x1b[K"

# Parts of the live line that get shorter where the terminal is narrow, step by step in this order.
_SHORTENED = (
    *("reacting", "contact", "factor", "contact", "reacting", "late", "weight", "impacts"),
    *("contact", "depth", "rotation", "feed", "faults", "faults", "dropped", "rotation", "feed"),
)


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
        which the drill moved, and none while simulation time stands still.
        """
        if not self._shown or report is None or report is self._last:
            return
        self._last = report
        moved = bool(report.figures["duration"])
        if self._terminal:
            # Before the first block there is nothing to tell, unless it waits.
            if moved or self._printed is not None or report.status["state"] == "paused":
                self._printed = report
                text = live_text(report, columns(sys.stderr))
                print(f"{_ERASE}{text}", end="", file=sys.stderr, flush=True)
        elif moved and (self._printed is None or report.figures is not self._printed.figures):
            self._printed = report
            print(live_text(report), file=sys.stderr, flush=True)

    def end(self) -> None:
        """Begin a new line after the last report."""
        if self._terminal and self._printed is not None:
            print(file=sys.stderr, flush=True)


@contextmanager
def logging_above(live: bool, opening: AbstractContextManager[Opened]) -> Iterator[Opened]:
    """Enter a context that starts ROS, whose log lines erase a live line first.

    A refused command is logged with its reason. Without this the text would continue the live line.
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

    Less important parts get shorter or are left out where the line is as long: a longer one would
    wrap, and scroll.
    """
    parts = _parts(report)
    if width is None:
        return _joined(parts)
    for name in _SHORTENED:
        if len(_joined(parts)) < width:
            break
        parts[name] = parts[name][1:] or parts[name]
    return _joined(parts)[: max(0, width - 1)]


def summary_text(
    figures: Figures, report: Report | None, faults: Sequence[FaultRecord] = ()
) -> str:
    jammed = any(record.fault.kind == _JAMMED for record in faults)
    rate = _rate_texts(figures, jammed)[0]
    lines = [
        f"drilled {figures['duration']:.2f} s: {_joined({'rate': (rate,), **_forces(figures)})}"
    ]
    if report is None:
        return lines[0]
    status = report.status
    lines.append(
        f"{status['impacts']} impacts, {status['deadlines_missed']} deadlines missed, "
        f"{status['commands_accepted']} commands accepted, {status['commands_rejected']} refused, "
        f"{status['messages_dropped']} messages dropped"
    )
    if math.isfinite(status["depth"]):
        lines.append(f"depth {QUANTITIES['depth'].text(status['depth'])}")
    if report.requests_refused:
        lines.append(f"{report.requests_refused} requests refused")
    if report.last_refusal:
        lines.append(f"last refusal: {printable(report.last_refusal)}")
    lines += [_fault_line(record) for record in faults[-_FAULTS_LISTED:]]
    if len(faults) > _FAULTS_LISTED:
        lines.append(f"{len(faults) - _FAULTS_LISTED} earlier faults")
    return "\n".join(lines)


def _parts(report: Report) -> dict[str, tuple[str, ...]]:
    status = report.status
    kinds = [record.fault.kind for record in report.faults]
    weight = QUANTITIES["weight_on_bit"].text(status["weight_on_bit"])
    drive = "" if status["drive_enabled"] else "drive off"
    jammed = _JAMMED in kinds
    depth = QUANTITIES["depth"].text(status["depth"]) if math.isfinite(status["depth"]) else ""
    refused = status["commands_rejected"] + report.requests_refused
    dropped = status["messages_dropped"]
    return {
        "time": (f"{report.time / 1e9:7.1f} s",),
        "state": (status["state"],),
        "weight": (f"{weight} on bit", weight),
        "drive": (drive,),
        "lost": ("commands lost" if status["commands_lost"] else "",),
        "impacts": _rate_texts(report.figures, jammed),
        **_forces(report.figures),
        "feed": _feed_texts(report.process.mount),
        "rotation": _rotation_texts(report.process.rotation),
        "depth": (depth and f"depth {depth}", depth),
        "layer": _layer_texts(report.process.borehole),
        "faults": _faults_texts(kinds),
        "refused": (f"{refused} refused" if refused else "",),
        "dropped": (f"{dropped} messages dropped", f"{dropped} dropped") if dropped else ("",),
        "late": (f"late {QUANTITIES['lateness'].text(status['lateness_max'])}", ""),
        "factor": (f"x{status['real_time_factor']:.3f}", ""),
    }


def _forces(figures: Figures) -> dict[str, tuple[str, ...]]:
    mean, most, reacting = (
        figures[name] for name in ("contact_force_mean", "contact_force_max", "reacting_force_mean")
    )
    forces: dict[str, tuple[str, ...]] = {"contact": ("",), "reacting": ("",)}
    if mean is not None and most is not None:
        shown = QUANTITIES["peak_force"]
        forces["contact"] = (
            f"{shown.label} {shown.text(mean)} mean {shown.text(most)} max",
            f"peak {shown.text(mean)}, max {shown.text(most)}",
            f"peak {shown.text(mean)}",
            "",
        )
    if reacting is not None:
        shown = QUANTITIES["reacting_force"]
        text = shown.text(reacting)
        forces["reacting"] = (f"{shown.label} {text}", f"load {text}", "")
    return forces


def _rate_texts(figures: Figures, jammed: bool) -> tuple[str, ...]:
    """Return the rate of impacts; why there are none, if there are none."""
    rate = figures["drill_tool_impact_rate"]
    if not rate:
        return ("jammed" if jammed else "no impacts",)
    shown = QUANTITIES["impact_rate"]
    text = shown.text(rate, unit=False)
    return (f"{text} {shown.label}{shown.unit}", f"{text}{shown.unit}")


def _faults_texts(kinds: Sequence[str]) -> tuple[str, ...]:
    if not kinds:
        return ("",)
    names = ", ".join(dict.fromkeys(kinds))
    count = "1 fault" if len(kinds) == 1 else f"{len(kinds)} faults"
    first = kinds[0] if len(kinds) == 1 else f"{kinds[0]} +{len(kinds) - 1}"
    return (f"faults: {names}", first, count)


def _feed_texts(mount: MountState | None) -> tuple[str, ...]:
    """Return where the feed is and whether the tool touches the rock; empty without a feed."""
    if mount is None:
        return ("",)
    feed = f"feed {QUANTITIES['feed'].text(mount.feed)}"
    return (f"{feed}, {QUANTITIES['feed_rate'].text(mount.rate)}", feed, "")


def _rotation_texts(rotation: RotorState | None) -> tuple[str, ...]:
    """Return rate and torque of the rotation; empty without one."""
    if rotation is None:
        return ("",)
    rate = "stalled" if rotation.stalled else QUANTITIES["rotation_rate"].text(rotation.rate)
    return (f"{rate}, torque {QUANTITIES['torque'].text(rotation.torque)}", rate, "")


def _layer_texts(hole: BoreholeState | None) -> tuple[str, ...]:
    """Return the layer at the bottom of the hole; empty without a hole."""
    if hole is None:
        return ("",)
    return (f"in {printable(hole.layer)}" if hole.layer else "broken through",)


def _fault_line(record: FaultRecord) -> str:
    end = "on" if record.clear is None else f"to {record.clear / 1e9:.3f} s"
    channel = f" on {record.fault.channel}" if record.fault.channel else ""
    return (
        f"fault {record.number}: {record.fault.kind}{channel} from {record.onset / 1e9:.3f} s {end}"
    )


def _joined(parts: dict[str, tuple[str, ...]]) -> str:
    return "  ".join(texts[0] for texts in parts.values() if texts[0])
