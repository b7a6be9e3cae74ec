"""Flow of power through the drill: from where it comes on the left, to where it goes on the right.

Bands are as wide as their powers. A source with a negative power takes it: it is on the right.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Fields of ``rpud_msgs/Status``, and their names in the picture.
INFLOWS = {
    "actuator_power": "work of the vibration",
    "weight_power": "weight on bit and gravity",
    "change_power": "changed parameters",
}
OUTFLOWS = {
    "absorbed_power": "drill tool and rock",
    "collision_power": "collisions of actuator and free mass",
    "load_damper_power": "damping of the load spring",
    "stored_power": "stored in motion and springs",
}
_COLOURS = ("#0072B2", "#009E73", "#D55E00", "#CC79A7", "#E69F00", "#56B4E9", "#999999")
_SHOWN = 1e-6  # share of the whole below which a flow has no band
_STEPS = 50


def flows(powers: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Return inflows and outflows by their names in the picture, all positive [W].

    Args:
        powers: by the names of ``INFLOWS`` and ``OUTFLOWS``.
    """
    signed = [(text, powers[name]) for name, text in INFLOWS.items()]
    signed += [(text, -powers[name]) for name, text in OUTFLOWS.items()]
    into = {text: power for text, power in signed if power > 0.0}
    out = {text: -power for text, power in signed if power < 0.0}
    return into, out


def power_flow(powers: Mapping[str, float]) -> Figure:
    """Draw the flow of mean powers; see ``flows``."""
    into, out = flows(powers)
    whole = max(sum(into.values()), sum(out.values()), 1e-300)
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    axis = figure.subplots()
    axis.set_axis_off()
    axis.set_xlim(0.0, 1.0)
    axis.set_ylim(-1.4, 0.2)
    colours = iter(_COLOURS * 2)
    for side, group in ((-1.0, into), (1.0, out)):
        shown = {text: power for text, power in group.items() if power > _SHOWN * whole}
        _draw_side(axis, side, shown, whole, colours)
    axis.fill([0.47, 0.53, 0.53, 0.47], [0.0, 0.0, -1.0, -1.0], color="#444444")
    axis.text(0.5, 0.05, f"{whole:.4g} W", ha="center")
    return figure


def _draw_side(
    axis: Axes, side: float, group: Mapping[str, float], whole: float, colours: Iterator[str]
) -> None:
    """Draw one side's bands, from the bar in the middle to their labels further apart."""
    gap = 0.15 / max(len(group), 1)
    inner = -np.cumsum([0.0, *(power / whole for power in group.values())])
    outer = 0.12
    share = np.linspace(0.0, 1.0, _STEPS)
    bend = share * share * (3.0 - 2.0 * share)
    for (text, power), (top, bottom) in zip(group.items(), pairwise(inner), strict=True):
        width = top - bottom
        across = 0.5 + side * (0.03 + 0.2 * share)
        axis.fill_between(
            across,
            top + (outer - top) * bend,
            bottom + (outer - width - bottom) * bend,
            color=next(colours),
            alpha=0.85,
            linewidth=0,
        )
        axis.text(
            0.5 + side * 0.24,
            outer - 0.5 * width,
            f"{text}\n{power:.4g} W",
            ha="left" if side > 0.0 else "right",
            va="center",
            fontsize="small",
        )
        outer -= max(width, 0.12) + gap
