"""Drawing of single layers into a Bokeh figure."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from bokeh.models import (
    BasicTicker,
    ColorBar,
    ColumnDataSource,
    GlyphRenderer,
    LinearColorMapper,
    Span,
    Whisker,
)
from bokeh.models.annotations import BoxAnnotation
from bokeh.plotting import figure as Figure  # noqa: N812 - a class of that name

from rpud_sim.pages.paint import paint
from rpud_sim.pages.plot import (
    Bars,
    Envelope,
    Layer,
    Line,
    Points,
    Rule,
    Spans,
    Stems,
    Zone,
)
from rpud_sim.pages.pointing import is_cloud
from rpud_sim.pages.theme import PALETTE

_BAND = 0.3  # opacity

Drawing = tuple["ColumnDataSource | None", list[GlyphRenderer]]


def draw(figure: Figure, layer: Layer, color: str, number: int) -> Drawing:
    """Draw a layer; return its data, if it has any, and what is drawn of them."""
    if isinstance(layer, Line):
        return _line(figure, layer, color, number)
    if isinstance(layer, Envelope):
        return _envelope(figure, layer, color, number)
    if isinstance(layer, Points):
        return _points(figure, layer, color, number)
    if isinstance(layer, Bars):
        return _bars(figure, layer, color, number)
    if isinstance(layer, Stems):
        return _stems(figure, layer, color, number)
    if isinstance(layer, Spans):
        return _spans(figure, layer, color)
    return _straight(figure, layer, color)


def _read_out(source: ColumnDataSource, number: int, how: str, **columns: str) -> None:
    """Name the columns whose values the cursor shows.

    ``how`` is ``held`` for the last value before the cursor, ``nearest`` for the one beside it. The
    columns are ``x`` and ``y``; ``low`` and ``high`` if there is a band.
    """
    source.tags = [*source.tags, json.dumps({"read": {"layer": number, "how": how, **columns}})]


def _source(layer: Layer, **columns: Any) -> ColumnDataSource:
    held = {name: _array(values) for name, values in columns.items() if values is not None}
    return ColumnDataSource(held, name=layer.name)


def _array(values: Any) -> np.ndarray:
    found = np.asarray(values)
    return found if found.dtype in (np.float32, np.float64) else found.astype(float)


def _line(figure: Figure, layer: Line, color: str, number: int) -> Drawing:
    source = _source(layer, x=layer.x, y=layer.y)
    style: dict[str, Any] = {"line_width": layer.width, "line_dash": layer.dash, "source": source}
    drawn = [
        figure.step("x", "y", mode="after", **style)
        if layer.steps
        else figure.line("x", "y", **style)
    ]
    if layer.marker:
        drawn.append(figure.scatter("x", "y", size=5, source=source))
    for renderer in drawn:
        _paint_glyph(renderer, color, filled=renderer is not drawn[0])
    _read_out(source, number, "held" if layer.steps else "nearest", x="x", y="y")
    return source, drawn


def _envelope(figure: Figure, layer: Envelope, color: str, number: int) -> Drawing:
    until = np.append(layer.x[1:], layer.x[-1:])
    source = _source(layer, x=layer.x, until=until, low=layer.low, y=layer.y, high=layer.high)
    band = figure.quad(
        left="x", right="until", bottom="low", top="high", source=source,
        fill_alpha=_BAND, line_color=None,
    )  # fmt: skip
    mean = figure.step("x", "y", mode="after", source=source, line_width=1.2)
    paint(band.glyph, fill_color=color)
    _paint_glyph(mean, color)
    _read_out(source, number, "held", x="x", y="y", low="low", high="high")
    return source, [band, mean]


def _points(figure: Figure, layer: Points, color: str, number: int) -> Drawing:
    source = _source(
        layer, x=layer.x, y=layer.y, low=layer.low, high=layer.high, values=layer.values
    )
    drawn = []
    if layer.joined:
        drawn.append(figure.line("x", "y", source=source, line_width=1.2))
        _paint_glyph(drawn[-1], color)
    dots = figure.scatter("x", "y", source=source, size=layer.size, marker=layer.marker)
    drawn.append(dots)
    if layer.values is None:
        _paint_glyph(dots, color, filled=True)
    else:
        mapper = _mapper(layer.values, *(layer.values_ends or (None, None)))
        dots.glyph.fill_color = dots.glyph.line_color = {"field": "values", "transform": mapper}
        _color_bar(figure, mapper, layer.values_label)
    read = {"x": "x", "y": "y"}
    if layer.low is not None and layer.high is not None:
        whisker = Whisker(
            source=source, base="y" if layer.across else "x", lower="low", upper="high",
            dimension="width" if layer.across else "height", line_width=1.2,
        )  # fmt: skip
        paint(whisker, line_color=color)
        for head in (whisker.upper_head, whisker.lower_head):
            head.size = 6
            paint(head, line_color=color)
        figure.add_layout(whisker)
        read |= {"low": "low", "high": "high"}
    if not is_cloud(layer):
        _read_out(source, number, "nearest", **read)
    return source, drawn


def _bars(figure: Figure, layer: Bars, color: str, number: int) -> Drawing:
    source = _source(layer, left=layer.edges[:-1], right=layer.edges[1:], top=layer.y)
    # Zero is not on a logarithmic axis.
    floor = 1e-300 if "Log" in type(figure.y_scale).__name__ else 0
    bars = figure.quad(
        left="left", right="right", bottom=floor, top="top", source=source,
        fill_alpha=0.75, line_width=0.5,
    )  # fmt: skip
    paint(bars.glyph, fill_color=color, line_color=color)
    _read_out(source, number, "held", x="left", until="right", y="top")
    return source, [bars]


def _stems(figure: Figure, layer: Stems, color: str, number: int) -> Drawing:
    source = _source(layer, x=layer.x, y=layer.y)
    stems = figure.segment(x0="x", x1="x", y0=0, y1="y", source=source, line_width=1)
    _paint_glyph(stems, color)
    _read_out(source, number, "nearest", x="x", y="y")
    return source, [stems]


def _spans(figure: Figure, layer: Spans, color: str) -> Drawing:
    source = _source(layer, x=layer.begin, until=layer.end, y=layer.row)
    bars = figure.hbar(
        left="x", right="until", y="y", height=0.7, source=source, fill_alpha=0.75, line_width=1.5
    )
    _paint_glyph(bars, color, filled=True)
    return source, [bars]


def _straight(figure: Figure, layer: Rule | Zone, color: str) -> Drawing:
    if isinstance(layer, Rule):
        rule = Span(
            location=layer.value,
            dimension="width" if layer.across else "height",
            line_dash=layer.dash,
            line_width=1.3,
        )
        paint(rule, line_color=color)
        figure.add_layout(rule)
    else:
        ends = ("bottom", "top") if layer.across else ("left", "right")
        zone = BoxAnnotation(
            **dict(zip(ends, (layer.low, layer.high), strict=True)),
            fill_alpha=0.15,
            line_color=None,
            level="underlay",
        )
        paint(zone, fill_color=color)
        figure.add_layout(zone)
    return None, []


def _mapper(values: Any, low: float | None, high: float | None) -> LinearColorMapper:
    found = np.asarray(values, float)
    found = found[np.isfinite(found)]
    least, greatest = (float(found.min()), float(found.max())) if len(found) else (0.0, 1.0)
    return LinearColorMapper(
        PALETTE, low=least if low is None else low, high=greatest if high is None else high
    )


def _color_bar(figure: Figure, mapper: LinearColorMapper, title: str) -> None:
    bar = ColorBar(
        color_mapper=mapper,
        title=title,
        height=10,
        width="auto",
        orientation="horizontal",
        ticker=BasicTicker(desired_num_ticks=4),
        padding=4,
        title_text_font_style="normal",
        title_text_font_size="12px",
    )
    paint(
        bar,
        background_fill_color="paper",
        title_text_color="text",
        major_label_text_color="text",
        major_tick_line_color="muted",
    )
    figure.add_layout(bar, "above")


def _paint_glyph(renderer: GlyphRenderer, color: str, *, filled: bool = False) -> None:
    if filled:
        paint(renderer.glyph, line_color=color, fill_color=color)
    else:
        paint(renderer.glyph, line_color=color)
