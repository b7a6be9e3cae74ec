"""Plot of a run by matplotlib: impacts, reacting force, nodal plane, and a close look."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from rpud_sim.foundation.extras import import_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Series = tuple[np.ndarray, np.ndarray]  # times [s] and values

_BODIES = ("actuator_position", "free_mass_position", "drill_tool_displacement")


def plot_run(
    peaks: Series, force: Series, plane: Series, waveform: Mapping[str, np.ndarray]
) -> Figure:
    """Return a figure of peak forces [N], reacting force [N], nodal plane [m] and a waveform."""
    pictures = import_extra("matplotlib.figure", "a plot", "'rpud_sim[web]'")
    figure: Figure = pictures.Figure(figsize=(10, 8), layout="constrained")
    axes = figure.subplots(4)
    axes[0].plot(*peaks, ".", ms=1.5, rasterized=True)
    axes[0].set_ylabel("peak force [N]")
    axes[1].plot(*force, lw=0.7)
    axes[1].set_ylabel("reacting force [N]")
    axes[2].plot(plane[0], 1e3 * plane[1], lw=0.7)
    axes[2].set_ylabel("nodal plane [mm]")
    axes[2].set_xlabel("time [s]")
    begin = waveform["time"][0]
    for name in _BODIES:
        label = name.rpartition("_")[0].replace("_", " ")
        axes[3].plot(1e3 * (waveform["time"] - begin), 1e6 * waveform[name], label=label)
    axes[3].set_ylabel("displacement [um]")
    axes[3].set_xlabel(f"time since {begin:g} s [ms]")
    axes[3].legend(loc="upper right")
    for each in axes:
        each.margins(x=0)
    return figure
