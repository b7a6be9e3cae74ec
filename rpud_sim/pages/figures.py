"""Bokeh figures of plots, for files and for a server that updates their data.

Colours are set by name in the models' tags; ``share/plots.js`` gives them their values, as the
reader prefers light or dark. It also draws the cursor and the values at it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import bokeh
import numpy as np
from bokeh.document import Document
from bokeh.models import (
    BasicTickFormatter,
    BoxZoomTool,
    ColumnDataSource,
    DataRange1d,
    FixedTicker,
    LogTickFormatter,
    Range1d,
)
from bokeh.plotting import figure as Figure  # noqa: N812 - a class of that name

from rpud_sim.pages.drawing import draw
from rpud_sim.pages.extent import axis_ends, layer_color
from rpud_sim.pages.paint import paint
from rpud_sim.pages.plot import COMMAND, FAULT, GAP, Axis, Mark, Plot, Points, TimeColumn
from rpud_sim.pages.pointing import is_cloud, pointing_tool

_LEFT, _RIGHT, _TOP = 62, 14, 8  # pixels beside the frame, equal for all plots of a column
_AXIS = 42  # pixels of the axis below the frame
_FONT = "12px"
_MOST_MARKS = 300  # of a kind; further ones would be a solid surface


@dataclass(frozen=True)
class Drawn:
    """Bokeh figure of a plot, with what a server updates."""

    plot: Plot  # its description
    figure: Figure  # model to embed; its ``name`` is that of the host element in the page
    # data of the layers, by their names. The columns are those of the layer's description
    # (``x``, ``y``, ``low``, ``high``); an envelope also has ``until``, the end of each part,
    # and bars have ``left``, ``right`` and ``top``.
    sources: Mapping[str, ColumnDataSource]
    # times of the marks by their kind: columns ``time``, ``end``
    marks: Mapping[str, ColumnDataSource]


def standalone(figure: Figure) -> dict[str, Any]:
    """Return a figure as ``Bokeh.embed.embed_item`` takes it.

    The same as Bokeh's ``json_item``, which looks through all models twice more, for callbacks in
    Python and for warnings: ours have none, and a page has many figures.
    """
    document = Document(title="")
    document.add_root(figure)
    content = document.to_json(deferred=False)
    return {"target_id": None, "root_id": figure.id, "doc": content, "version": bokeh.__version__}


def draw_plot(plot: Plot, name: str, *, live: bool = False) -> Drawn:
    """Return the figure of a plot that stands alone; ``live`` lets its axes follow the data."""
    return _draw(plot, name, _range(plot, "x", live), live, {})


def draw_column(
    column: TimeColumn, names: Sequence[str], *, live: bool = False
) -> tuple[Drawn, ...]:
    """Return the figures of a column; they show one range of time and the same marks.

    ``names`` are of the host elements. With ``live`` the figures belong to one document of a
    server, whose data change, and share the models of the range of time and of the marks. Whoever
    updates the data moves the range, ``figure.x_range``. In a file each figure stands alone, and
    the page's script links the ranges.
    """
    end = max(column.end, column.begin + 1e-9)
    time = Axis(column.label, column.unit, low=column.begin, high=end)
    shared = Range1d(column.begin, end)
    marks = mark_sources(column.marks, end)
    return tuple(
        _draw(
            _with_time(plot, time),
            name,
            shared if live else Range1d(column.begin, end),
            live,
            marks if live else mark_sources(column.marks, end),
        )
        for plot, name in zip(column.plots, names, strict=True)
    )


def mark_sources(marks: Sequence[Mark], end: float) -> dict[str, ColumnDataSource]:
    """Return the times of marks by their kind; those that last end at ``end`` [s]."""
    found = {}
    for kind in (GAP, FAULT, COMMAND):
        group = [mark for mark in marks if mark.kind == kind][:_MOST_MARKS]
        times = np.array([mark.time for mark in group], float)
        ends = np.array([_end(mark, end) for mark in group], float)
        found[kind] = ColumnDataSource({"time": times, "end": ends}, name=f"marks {kind}")
    return found


def _end(mark: Mark, end: float) -> float:
    if mark.end is not None:
        return mark.end
    return mark.time if mark.kind == COMMAND else end


def _with_time(plot: Plot, time: Axis) -> Plot:
    values = {name: getattr(plot, name) for name in ("title", "layers", "alt", "y", "height")}
    return Plot(x=time, **values)


def _draw(
    plot: Plot, name: str, x_range: Any, live: bool, marks: Mapping[str, ColumnDataSource]
) -> Drawn:
    drawn = Figure(
        name=name,
        height=plot.height + _AXIS + _TOP,
        sizing_mode="stretch_width",
        min_width=200,
        x_axis_type="log" if plot.x.log else "linear",
        y_axis_type="log" if plot.y.log else "linear",
        x_range=x_range,
        y_range=_range(plot, "y", live),
        toolbar_location=None,
        tools="",
        min_border_left=_LEFT,
        min_border_right=_RIGHT,
        min_border_top=_TOP,
        min_border_bottom=_AXIS,
        match_aspect=plot.square,
        lod_threshold=None,
        border_line_color=None,
    )
    zoom = BoxZoomTool(dimensions="both" if plot.square else "width")
    drawn.add_tools(zoom)
    drawn.toolbar.active_drag = zoom
    _dress(drawn, plot)
    for kind, source in marks.items():
        if live or len(source.data["time"]):  # a file stays as it is
            _draw_marks(drawn, kind, source)
    sources: dict[str, ColumnDataSource] = {}
    for number, layer in enumerate(plot.layers):
        source, renderers = draw(drawn, layer, layer_color(layer), number)
        if source is not None:
            sources[layer.name] = source
            if isinstance(layer, Points) and is_cloud(layer):
                drawn.add_tools(pointing_tool(plot, layer, source, renderers))
        for renderer in renderers:
            if live and isinstance(drawn.y_range, DataRange1d):
                drawn.y_range.renderers = [*_renderers(drawn.y_range), renderer]
    return Drawn(plot, drawn, sources, marks)


def _renderers(data_range: DataRange1d) -> list[Any]:
    found = data_range.renderers
    return list(found) if isinstance(found, list) else []


def _range(plot: Plot, side: str, live: bool) -> Any:
    axis: Axis = getattr(plot, side)
    if axis.categories:
        ends = (-0.6, len(axis.categories) - 0.4)
        return Range1d(*(ends[::-1] if side == "y" else ends))
    if live and axis.low is None and axis.high is None:
        return DataRange1d(flipped=axis.flipped, only_visible=True)
    low, high = axis_ends(plot, side)
    if live and (axis.low is None or axis.high is None):
        known = {"start": axis.low, "end": axis.high}
        given = {name: value for name, value in known.items() if value is not None}
        return DataRange1d(flipped=axis.flipped, only_visible=True, **given)
    return Range1d(high, low) if axis.flipped else Range1d(low, high)


def _dress(drawn: Figure, plot: Plot) -> None:
    # The page shows through.
    drawn.background_fill_color = drawn.border_fill_color = None
    paint(drawn, outline_line_color="rule")
    for axis, side in ((drawn.xaxis[0], plot.x), (drawn.yaxis[0], plot.y)):
        axis.major_label_text_font_size = _FONT
        axis.axis_label_text_font_size = _FONT
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_standoff = 4
        axis.minor_tick_line_color = None
        axis.ticker.update(**({} if side.log or side.categories else {"num_minor_ticks": 0}))
        if side.categories:
            axis.ticker = FixedTicker(ticks=list(range(len(side.categories))))
            axis.major_label_overrides = dict(enumerate(side.categories))
        elif side.log:
            axis.formatter = LogTickFormatter(min_exponent=4)
        else:
            axis.formatter = BasicTickFormatter(power_limit_high=5, power_limit_low=-4)
        paint(
            axis,
            axis_label_text_color="text",
            major_label_text_color="text",
            axis_line_color="muted",
            major_tick_line_color="muted",
        )
    drawn.yaxis[0].ticker.update(
        **({} if plot.y.categories else {"desired_num_ticks": max(2, plot.height // 45)})
    )
    x = plot.x
    drawn.xaxis[0].axis_label = (f"{x.label} [{x.unit}]" if x.unit else x.label) or None
    for grid in (drawn.xgrid[0], drawn.ygrid[0]):
        paint(grid, grid_line_color="rule")


def _draw_marks(drawn: Figure, kind: str, source: ColumnDataSource) -> None:
    if kind in (FAULT, GAP):
        area = drawn.vstrip(
            x0="time",
            x1="end",
            source=source,
            fill_alpha=0.14,
            line_color=None,
            line_width=1,
            hatch_pattern="/" if kind == GAP else " ",
            hatch_alpha=0.5,
            hatch_weight=0.5,
            name=f"mark {kind}",
        )
        paint(area.glyph, fill_color=kind, hatch_color=kind)
        if kind == GAP:  # one that is shorter than a pixel is a line
            paint(area.glyph, line_color=kind)
    if kind != GAP:
        places = ("time", "end") if kind == FAULT else ("time",)
        for place in places:
            line = drawn.vspan(
                x=place,
                source=source,
                line_width=1.2,
                line_dash="solid" if place == "time" else "dashed",
                name=f"mark {kind}",
            )
            paint(line.glyph, line_color=kind)
