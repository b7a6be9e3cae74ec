"""Plots as pictures in a page: SVG in the colours of the page, which needs no script.

The text of a picture says what is seen; the pointer shows the values of a point.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.plot import Axis, Bars, Envelope, Layer, Line, Plot, Points, Rule, Zone
from rpud_sim.pages.quantities import number_text
from rpud_sim.pages.scale import Scale, scale_of
from rpud_sim.pages.theme import series_color

_LETTER = 7.2  # mean width of a letter of 12 pixels [pixels]
_APART = 32.0  # least distance of ticks upward [pixels]
_LINE = 18  # height of a line of text [pixels]
_GAP = 8  # pixels between a plot and its text
_MOST_TITLES = 400  # points of a cloud have no texts under the pointer: they are one path
_DASHES = {"dashed": "6 4", "dotted": "2 3", "dotdash": "6 3 2 3"}
_FIGURE = Markup('<figure class="plot"><figcaption>{}{}</figcaption>{}</figure>')
_GRID = Markup('{}<div class="plots" style="--least:{}em">{}</div>')
_LEGEND = Markup('<p class="keys">{}</p>')
_KEY = Markup('<span class="key"><i style="background:var(--{})"></i>{}</span>')
_PICTURE = Markup(
    '<div class="wide"{}><svg role="img" class="picture" viewBox="0 0 {} {}" width="{}"'
    ' style="min-width:{}px"><title>{}</title><desc>{}</desc>{}</svg></div>'
)
_SCROLLED = Markup(' tabindex="0" role="region" aria-label="{}"')
_NARROW = 480  # pixels; a wider picture can be scrolled on a phone


def figure(plot: Plot) -> Markup:
    """Return a plot with its title and its legend as an element of a page."""
    return _figure(plot, _keys(plot.layers))


def _figure(plot: Plot, keys: str) -> Markup:
    columns = plot.y.columns
    texts = [text for _, text in scale_of(plot, "y", plot.height, 0.0).ticks(_APART)]
    left = _GAP + min(max(map(_width, texts), default=0.0), 0.42 * plot.width)
    widths = [max(map(_width, (head, *cells))) + 14 for head, cells in columns]
    right = sum(widths) + 14
    top = _LINE + 4 if columns else _GAP
    below = _LINE + (_LINE if plot.x.label else 0) + 4
    inner = plot.width - left - right
    parts = [*_panel(plot, left, top, inner, plot.height)]
    place = left + inner
    for (head, cells), width in zip(columns, widths, strict=True):
        place += width
        parts.append(_text(head, place, top - _GAP, "end", "head"))
        rows = scale_of(plot, "y", plot.height, 0.0)(np.arange(len(cells)))
        parts += [
            _text(cell, place, top + row + 4, "end") for cell, row in zip(cells, rows, strict=True)
        ]
    picture = _picture(plot.heading, plot.alt, plot.width, top + plot.height + below, parts)
    return _FIGURE.format(_title(plot.heading), keys, picture)


def figures(plots: Sequence[Plot], least: float = 20.0) -> Markup:
    """Return plots side by side, with one legend if they have the same.

    ``least`` is the width of a plot in the width of a letter.
    """
    keys = [_keys(plot.layers) for plot in plots]
    one = len(keys) > 1 and len(set(keys)) == 1
    drawn = [_figure(plot, "" if one else each) for plot, each in zip(plots, keys, strict=True)]
    legend = _LEGEND.format(keys[0]) if one and keys[0] else ""
    return _GRID.format(legend, least, Markup("").join(drawn))


def corner(title: str, rows: Sequence[Sequence[Plot]], alt: str, width: int = 1000) -> Markup:
    """Return plots as a triangle: those of a column share x, and those of a row, but the last, y.

    Every last plot of a row has no scale upward.
    """
    count = len(rows)
    texts = [text for row in rows[1:] for _, text in scale_of(row[0], "y", 0, 150).ticks(_APART)]
    left = 2.0 * _LINE + max(map(_width, texts), default=0.0)
    size = min((width - left) / count, 260.0)
    parts: list[Markup] = []
    for number, row in enumerate(rows):
        for place, plot in enumerate(row):
            outer = number == count - 1, place == 0 and number > 0
            x, y = left + place * size, _GAP + number * size
            parts += _panel(plot, x, y, size - _GAP, size - _GAP, *outer)
        if number:
            middle = _GAP + (number + 0.5) * size
            turned = f"rotate(-90 12 {middle:.0f})"
            heading = _heading(row[0].y)
            parts.append(_text(heading, 12, middle, "middle", "label", transform=turned))
    whole, height = math.ceil(left + count * size), math.ceil(2 * _GAP + count * size + 2 * _LINE)
    layers = {layer.name: layer for row in rows for plot in row for layer in plot.layers}
    picture = _picture(title, alt, whole, height, parts)
    return _FIGURE.format(_title(title), _keys(tuple(layers.values())), picture)


def _picture(title: str, alt: str, width: float, height: float, parts: Sequence[Markup]) -> Markup:
    title, alt = printable(title), printable(alt)
    scrolled = _SCROLLED.format(title) if width > _NARROW else ""
    least = round(min(0.7 * width, 720.0))
    body = Markup("").join(parts)
    return _PICTURE.format(scrolled, width, round(height), width, least, title, alt, body)


def _title(heading: str) -> Markup:
    return Markup('<span class="plot-title">{}</span>').format(printable(heading))


def _keys(layers: Sequence[Layer]) -> Markup:
    named = [layer for layer in layers if layer.name]
    keys = [_KEY.format(_color(layer), printable(layer.name)) for layer in named]
    return Markup("").join(keys) if len(keys) > 1 else Markup("")


def _panel(
    plot: Plot,
    left: float,
    top: float,
    width: float,
    height: float,
    labelled_x: bool = True,
    labelled_y: bool = True,
) -> Iterator[Markup]:
    """Yield the parts of one plot: its grid and texts, and its layers inside its frame."""
    x, y = scale_of(plot, "x", 0.0, width), scale_of(plot, "y", height, 0.0)
    for value, text in x.ticks(max(46.0, _widest(x))):
        place = left + float(x(value))
        yield _line("grid", place, top, place, top + height)
        if labelled_x:
            yield _text(text, place, top + height + _LINE - 2, "middle")
    if labelled_x and plot.x.label:
        middle = left + 0.5 * width
        yield _text(_heading(plot.x), middle, top + height + 2 * _LINE, "middle", "label")
    for value, text in y.ticks(_APART) if labelled_y or plot.y.categories else ():
        place = top + float(y(value))
        yield _line("grid", left, place, left + width, place)
        if labelled_y:
            yield _text(_shortened(text, left), left - _GAP, place + 4, "end")
    # An inner picture cuts off what is outside of it.
    inner = Markup("").join(part for layer in plot.layers for part in _draw(layer, x, y, plot))
    yield Markup('<svg x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}">{}</svg>').format(
        left, top, width, height, inner
    )


def _draw(layer: Layer, x: Scale, y: Scale, plot: Plot) -> Iterator[Markup]:
    color = f"var(--{_color(layer)})"
    if isinstance(layer, Line):
        width, dash = layer.width, _DASHES.get(layer.dash, "")
        yield _path(_track(x(layer.x), y(layer.y), layer.steps), color, width, dash)
    elif isinstance(layer, Envelope):
        at, low, high = x(layer.x), y(layer.low), y(layer.high)
        for part in _whole(np.isfinite(low + high + at)):
            way = np.concatenate([at[part], at[part][::-1]])
            edge = np.concatenate([high[part], low[part][::-1]])
            yield _path(_track(way, edge) + "Z", "none", fill=color, opacity=0.25)
        yield _path(_track(at, y(layer.y)), color, 1.4)
    elif isinstance(layer, Bars):
        edges, tops, base = x(layer.edges), y(layer.y), float(y.begin)
        way = "".join(
            f"M{a:.1f} {base:.1f}V{b:.1f}H{c:.1f}V{base:.1f}"
            for a, b, c in zip(edges, tops, edges[1:], strict=False) if math.isfinite(b)
        )  # fmt: skip
        yield _path(way, color, 0.5, fill=color, opacity=0.6)
    elif isinstance(layer, Rule):
        at = float((y if layer.across else x)(layer.value))
        ends = (
            (0, at, max(x.begin, x.end), at) if layer.across else (at, 0, at, max(y.begin, y.end))
        )
        dash = _DASHES.get(layer.dash, "none")
        yield _line("rule", *ends, layer.text, stroke=color, stroke_dasharray=dash)
    elif isinstance(layer, Zone):
        first, last = sorted((y if layer.across else x)([layer.low, layer.high]).tolist())
        place = (
            (0, first, max(x.begin, x.end), last - first)
            if layer.across
            else (first, 0, last - first, max(y.begin, y.end))
        )
        sides = dict(zip(("x", "y", "width", "height"), place, strict=True))
        yield _element("rect", (_titled(layer.text),), **sides, fill=color, opacity=0.16)
    elif isinstance(layer, Points):
        yield from _points(layer, x, y, plot, color)


def _points(layer: Points, x: Scale, y: Scale, plot: Plot, color: str) -> Iterator[Markup]:
    across, upward = x(layer.x), y(layer.y)
    shown = np.isfinite(across + upward)
    if layer.joined:
        yield _path(_track(across, upward), color, 1.4)
    if len(across) > _MOST_TITLES or layer.size < 3.0:
        dots = zip(across[shown], upward[shown], strict=True)
        way = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in dots)
        yield _path(way, color, layer.size, opacity=0.5, stroke_linecap="round")
        return
    scale = x if layer.across else y
    ends = () if layer.low is None or layer.high is None else (scale(layer.low), scale(layer.high))
    for number in np.flatnonzero(shown):
        a, b = float(across[number]), float(upward[number])
        text = layer.titles[number] if layer.titles else _values(layer, number, plot)
        parts = [_titled(text)]
        if ends and math.isfinite(low := float(ends[0][number])):
            high = float(ends[1][number])
            lines = ((low, b, high, b), (low, b - 3, low, b + 3), (high, b - 3, high, b + 3))
            if not layer.across:
                lines = ((a, low, a, high), (a - 3, low, a + 3, low), (a - 3, high, a + 3, high))
            parts.append(_path("".join(_segment(*line) for line in lines), color, 1.5))
        half = 0.5 * layer.size
        if layer.marker == "x":
            way = _segment(a - half, b - half, a + half, b + half)
            way += _segment(a - half, b + half, a + half, b - half)
            parts.append(_path(way, color, 2.2))
        else:
            parts.append(_element("circle", cx=a, cy=b, r=half, fill=color))
        yield _element("g", parts)


def _values(layer: Points, number: int, plot: Plot) -> str:
    """Return the values of a point with their names, and its interval."""
    texts = []
    for axis, values, spread in (
        (plot.x, layer.x, layer.across),
        (plot.y, layer.y, not layer.across),
    ):
        value = float(values[number])
        if axis.categories:
            texts.append(axis.categories[min(max(round(value), 0), len(axis.categories) - 1)])
            continue
        text = f"{number_text(value)} {axis.unit}".rstrip()
        if spread and layer.low is not None and layer.high is not None:
            low, high = (number_text(float(end[number])) for end in (layer.low, layer.high))
            text = f"{text} ({low} to {high})"
        name = axis.label or plot.title
        texts.append(f"{name} {text}".lstrip())
    return ", ".join(texts)


def _whole(known: np.ndarray) -> Iterator[slice]:
    """Yield the parts of a series between its gaps."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    yield from (slice(*pair) for pair in edges.reshape(-1, 2))


def _track(x: np.ndarray, y: np.ndarray, steps: bool = False) -> str:
    """Return the way through points; NaN is a gap."""
    texts = []
    for part in _whole(np.isfinite(x) & np.isfinite(y)):
        points = list(zip(x[part].tolist(), y[part].tolist(), strict=True))
        texts.append(f"M{points[0][0]:.1f} {points[0][1]:.1f}")
        texts += [f"H{a:.1f}V{b:.1f}" if steps else f"L{a:.1f} {b:.1f}" for a, b in points[1:]]
    return "".join(texts)


def _segment(x1: float, y1: float, x2: float, y2: float) -> str:
    return f"M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}"


def _path(way: str, stroke: str, width: float = 0.0, dash: str = "", **style: Any) -> Markup:
    style = {"fill": "none", "stroke": stroke, "stroke_width": width} | style
    return _element("path", d=way, **style, **({"stroke_dasharray": dash} if dash else {}))


def _line(
    name: str, x1: float, y1: float, x2: float, y2: float, text: str = "", **style: Any
) -> Markup:
    return _element("line", (_titled(text),), class_=name, x1=x1, y1=y1, x2=x2, y2=y2, **style)


def _text(text: str, x: float, y: float, anchor: str, name: str = "tick", **style: Any) -> Markup:
    inner = (escape(printable(text)),)
    return _element("text", inner, class_=name, x=x, y=y, text_anchor=anchor, **style)


def _titled(text: str) -> Markup:
    return _element("title", (escape(printable(text)),)) if text else Markup("")


def _element(tag: str, inner: Sequence[Markup] = (), **attributes: Any) -> Markup:
    texts = [
        Markup(' {}="{}"').format(
            name.rstrip("_").replace("_", "-"), f"{v:.4g}" if isinstance(v, float) else v
        )
        for name, v in attributes.items()
    ]
    return Markup("<{0}{1}>{2}</{0}>").format(
        Markup(tag), Markup("").join(texts), Markup("").join(inner)
    )


def _color(layer: Layer) -> str:
    return series_color(layer.color) if isinstance(layer.color, int) else layer.color


def _heading(axis: Axis) -> str:
    return f"{axis.label} [{axis.unit}]" if axis.unit else axis.label


def _width(text: str) -> float:
    return _LETTER * len(printable(text)) + 3.0


def _widest(scale: Scale) -> float:
    return max((_width(text) + 10.0 for _, text in scale.ticks(70.0)), default=0.0)


def _shortened(text: str, room: float) -> str:
    most = max(int((room - _GAP) / _LETTER + 0.5), 4)
    return text if len(text) <= most else f"{text[: most - 1]}…"
