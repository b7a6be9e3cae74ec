"""Words beside the pointer: the values of a point in a cloud, which no cursor along x can find."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool

from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.plot import Axis, Layer, Plot, Points

_NUMBER = "{%.4g}"


def is_cloud(layer: Layer) -> bool:
    """Whether a layer has points in no order along x."""
    return isinstance(layer, Points) and bool(np.any(np.diff(np.asarray(layer.x, float)) < 0.0))


def pointing_tool(
    plot: Plot, layer: Points, source: ColumnDataSource, renderers: list[Any]
) -> HoverTool:
    """Return the tool that shows the values of the point under the pointer, in the axes' words."""
    lines: list[tuple[str, str]] = []
    formats: dict[str, str] = {}

    def add(label: str, column: str) -> None:
        lines.append((printable(label), f"@{column}{_NUMBER}"))
        formats[f"@{column}"] = "printf"

    for column, axis, label in (("y", plot.y, plot.heading), ("x", plot.x, _heading(plot.x))):
        if axis.categories:
            words = [_word(axis, value) for value in np.asarray(getattr(layer, column), float)]
            source.data[f"{column}_word"] = words
            lines.append(("", f"@{column}_word"))
        else:
            add(label, column)
    if layer.low is not None and layer.high is not None:
        add("from", "low")
        add("to", "high")
    if layer.values is not None:
        add(layer.values_label, "values")
    return HoverTool(renderers=renderers[-1:], tooltips=lines, formatters=formats)


def _word(axis: Axis, value: float) -> str:
    return printable(axis.categories[min(max(round(value), 0), len(axis.categories) - 1)])


def _heading(axis: Axis) -> str:
    return f"{axis.label} [{axis.unit}]" if axis.unit else axis.label
