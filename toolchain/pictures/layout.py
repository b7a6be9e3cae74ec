"""Picture of a recorded run as a Foxglove layout shows it, drawn without Foxglove.

``python -m toolchain.pictures.layout BAG LAYOUT.json OUT.png`` draws the plots of the layout
below each other.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

import rpud_sim.bag
from rpud_sim.bag import BagError, BagReader
from rpud_sim.foundation.terminal import complain
from rpud_sim.foundation.time import SECOND

PANEL = (9.0, 1.9)  # width and height of one plot [inch]
STAMP = "header.stamp"


def read_plots(path: Path) -> list[Mapping[str, Any]]:
    """Return the plot panels of a layout, in its order.

    Raises:
        BagError: if the file is not a layout with plots.
    """
    try:
        panels = json.loads(path.read_text(encoding="utf-8"))["configById"]
        plots = [panel for name, panel in panels.items() if name.startswith("Plot!")]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise BagError(f"{path} is no layout of Foxglove: {error!r}") from error
    if not plots:
        raise BagError(f"{path} has no plots")
    return plots


def draw(bag: BagReader, plots: Sequence[Mapping[str, Any]]) -> Figure:
    """Return a figure with plots of a bag.

    Raises:
        BagError: if the bag lacks the topic or the field of a series.
    """
    figure = Figure(figsize=(PANEL[0], PANEL[1] * len(plots)), dpi=110, layout="constrained")
    rows = figure.subplots(len(plots), 1, sharex=True, squeeze=False)[:, 0]
    for axes, plot in zip(rows, plots, strict=True):
        for series in plot["paths"]:
            _draw_series(axes, bag, series)
        axes.set_title(plot["foxglovePanelTitle"], loc="left", fontsize="medium")
        axes.set_ylabel(plot["yAxisLabel"])
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False)
    rows[-1].set_xlabel("time [s]")
    return figure


def _draw_series(axes: Axes, bag: BagReader, series: Mapping[str, Any]) -> None:
    topic, _, field = series["value"].partition(".")
    columns = bag.arrays(topic)
    if field not in columns:
        raise BagError(f"{topic} has no field {field}")
    time = (columns[STAMP] - bag.start_time) / SECOND
    dots = series.get("showLine") is False
    axes.plot(
        time,
        columns[field],
        color=series["color"],
        label=series["label"],
        drawstyle="steps-post" if series.get("lineInterpolation") == "step" else "default",
        linestyle="none" if dots else "solid",
        linewidth=1.2,
        marker="." if dots else "none",
        markersize=1.5,
    )


def main() -> int:
    """Draw the picture; return the exit code."""
    parser = argparse.ArgumentParser(prog="layout_picture", description=__doc__)
    parser.add_argument("bag", metavar="BAG", help="a bag of the drill")
    parser.add_argument("layout", metavar="LAYOUT", type=Path, help="a layout of Foxglove")
    parser.add_argument("out", metavar="OUT", type=Path, help="the picture's file")
    arguments = parser.parse_args()
    try:
        plots = read_plots(arguments.layout)
        with rpud_sim.bag.open(arguments.bag) as bag:
            figure = draw(bag, plots)
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(arguments.out)
    except (BagError, OSError) as error:
        complain("layout_picture", error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
