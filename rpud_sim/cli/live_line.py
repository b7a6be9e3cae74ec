"""Live line and summary of ``rpud run``: rate of impacts, forces and timing."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rpud_sim.ros.drill.report import Report
    from rpud_sim.simulation.ensemble import Figures


class LiveLine:
    """Rate and forces of the last second: one line that a terminal sees rewritten.

    Args:
        shown: whether to write anything.
    """

    def __init__(self, shown: bool) -> None:
        self._shown = shown
        self._terminal = sys.stderr.isatty()
        self._last: Report | None = None

    def show(self, report: Report | None) -> None:
        """Show a report, unless it was the last one shown."""
        if not self._shown or report is None or report is self._last:
            return
        self._last = report
        if report.figures["duration"]:
            start, end = ("\r\x1b[K", "") if self._terminal else ("", "\n")
            print(start + live_text(report), end=end, file=sys.stderr, flush=True)

    def end(self) -> None:
        """Begin a new line after the last report."""
        if self._terminal and self._last is not None:
            print(file=sys.stderr, flush=True)


def live_text(report: Report) -> str:
    """Return the live line of a report."""
    timing = report.timing
    return (
        f"{report.time / 1e9:7.1f} s  {_figures_text(report.figures)}  "
        f"late {1e3 * timing.lateness_max:.1f} ms  x{timing.real_time_factor:.3f}"
    )


def summary_text(figures: Figures, report: Report | None) -> str:
    """Return the summary of a run of the drill."""
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
    def rounded(name: str, places: int) -> str:
        value = figures[name]
        return "-" if value is None else f"{value:.{places}f}"

    return (
        f"{rounded('drill_tool_impact_rate', 0)} impacts/s  "
        f"contact force {rounded('contact_force_mean', 0)} N mean "
        f"{rounded('contact_force_max', 0)} N max  "
        f"reacting force {rounded('reacting_force_mean', 1)} N"
    )
