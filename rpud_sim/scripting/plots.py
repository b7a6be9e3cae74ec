"""Plot of a run by matplotlib: impacts, reacting force, bodies, and a close look."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rpud_sim.foundation.quantities import ExpectedError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rpud_sim.scripting.runs import DrillRun

_CLOSE = 0.002  # length of the close look [s]
_CLOSE_RATE = 500_000  # [Hz]


class NoPlotError(ExpectedError, RuntimeError):
    """matplotlib is missing; the text says how to install it."""


def plot_run(run: DrillRun) -> Figure:
    """Return a figure of a run."""
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError:
        raise NoPlotError("a plot needs matplotlib: pip install 'rpud_sim[web]'") from None
    figure = Figure(figsize=(10, 8), layout="constrained")
    impacts, force, bodies, close = figure.subplots(4)
    peaks = run["contact_force"]["peak_force"]
    impacts.plot(run.times("contact_force"), peaks, ".", ms=1.5, rasterized=True)
    impacts.set_ylabel("peak force [N]")
    force.plot(run.times("reacting_force"), run["reacting_force"]["force"], lw=0.7)
    force.set_ylabel("reacting force [N]")
    bodies.plot(run.times("nodal_plane"), 1e3 * run["nodal_plane"]["position"], lw=0.7)
    bodies.set_ylabel("nodal plane [mm]")
    bodies.set_xlabel("time [s]")
    begin = max(0.0, run.duration - _CLOSE)
    waveform = run.waveform(_CLOSE_RATE, start=begin)
    milliseconds = 1e3 * (waveform["time"] - begin)
    for name in ("actuator_position", "free_mass_position", "drill_tool_displacement"):
        label = name.rpartition("_")[0].replace("_", " ")
        close.plot(milliseconds, 1e6 * waveform[name], label=label)
    close.set_ylabel("displacement [um]")
    close.set_xlabel(f"time since {begin:g} s [ms]")
    close.legend(loc="upper right")
    for axes in (impacts, force, bodies, close):
        axes.margins(x=0)
    figure.suptitle(f"{run.duration:g} s, {len(peaks)} impacts")
    return figure
