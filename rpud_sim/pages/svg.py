"""Plots as pictures in a page: SVG in the colours of the page, which needs no script.

The text of a picture says what is seen; the pointer shows the values of a point.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.plot import Axis, Bars, Envelope, Layer, Line, Plot, Points, Rule, Zone
from rpud_sim.pages.quantities import number_text
from rpud_sim.pages.theme import series_color

_LETTER = 6.9  # mean width of a letter of 12 pixels [pixels]
_LINE = 18  # height of a line of text [pixels]
_GAP = 8  # pixels between a plot and its text
_MARGIN = 0.05  # of the range of the data
_MOST_TITLES = 400  # points of a cloud have no texts under the pointer: they are one path
_DASHES = {"dashed": "6 4", "dotted": "2 3", "dotdash": "6 3 2 3"}
_FIGURE = Markup('<figure class="plot"><figcaption>{}{}</figcaption>{}</figure>')
_GRID = Markup('<div class="plots" style="--least:{}em">{}</div>')
_KEY = Markup('<span class="key"><i style="background:var(--{})"></i>{}</span>')
_PICTURE = Markup(
    '<div class="wide"{}><svg role="img" class="picture" viewBox="0 0 {} {}" width="{}"'
    ' style="min-width:{}px"><title>{}</title><desc>{}</desc>{}</svg></div>'
)
_SCROLLED = Markup(' tabindex="0" role="region" aria-label="{}"')
_NARROW = 480  # pixels; a wider picture can be scrolled on a phone


@dataclass(frozen=True)
class _Scale:
    """Map from values to pixels along one side of a plot."""

    axis: Axis
    low: float
    high: float
    begin: float  # begin, end: pixels of the least and of the greatest value
    end: float

    def __call__(self, values: Any) -> np.ndarray:
        low, high, found = self.low, self.high, np.asarray(values, float)
        if self.axis.log:
            found = np.log(np.where(found > 0.0, found, np.nan))
            low, high = math.log(low), math.log(high)
        found = (found - low) / (high - low)
        # A path has no use for what is far outside, and a browser none for its digits.
        return self.begin + np.clip(found, -9.0, 10.0) * (self.end - self.begin)

    def ticks(self, apart: float) -> list[tuple[float, str]]:
        """Return values and texts of ticks that are about so many pixels apart."""
        if self.axis.categories:
            return [(float(n), str(text)) for n, text in enumerate(self.axis.categories)]
        most = max(2.0, abs(self.end - self.begin) / apart)
        if self.axis.log:
            found = _log_ticks(self.low, self.high, most)
            if len(found) > 1:
                return [(value, number_text(value)) for value in found]
        step = _step((self.high - self.low) / most)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        places = max(0, -math.floor(math.log10(step) + 1e-9))
        far = max(abs(self.low), abs(self.high)) >= 1e7 or places > 6
        return [
            (n * step, f"{n * step:.4g}" if far else f"{n * step:.{places}f}".replace("-", "−"))
            for n in range(first, last + 1)
        ]


def figure(plot: Plot) -> Markup:
    """Return a plot with its title and its legend as an element of a page."""
    across, columns = plot.y.categories, plot.y.columns
    flexible = Axis(log=plot.y.log)
    low, high = _ends(plot, "y")
    texts = across or [text for _, text in _Scale(flexible, low, high, plot.height, 0).ticks(40)]
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
        rows = _scale(plot, "y", plot.height, 0.0)(np.arange(len(cells)))
        parts += [
            _text(cell, place, top + row + 4, "end") for cell, row in zip(cells, rows, strict=True)
        ]
    picture = _picture(plot.heading, plot.alt, plot.width, top + plot.height + below, parts)
    return _FIGURE.format(_title(plot.heading), _keys(plot.layers), picture)


def figures(plots: Sequence[Plot], least: float = 20.0) -> Markup:
    """Return plots side by side; ``least`` is the width of one in the width of a letter."""
    return _GRID.format(least, Markup("").join(map(figure, plots)))


def corner(title: str, rows: Sequence[Sequence[Plot]], alt: str, width: int = 1000) -> Markup:
    """Return plots as a triangle: those of a column share x, and those of a row, but the last, y.

    Every last plot of a row has no scale upward.
    """
    count = len(rows)
    texts = [text for row in rows[1:] for _, text in _scale(row[0], "y", 0, 150).ticks(40)]
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
    x, y = _scale(plot, "x", 0.0, width), _scale(plot, "y", height, 0.0)
    for value, text in x.ticks(max(46.0, _widest(x))):
        place = left + float(x(value))
        yield _line("grid", place, top, place, top + height)
        if labelled_x:
            yield _text(text, place, top + height + _LINE - 2, "middle")
    if labelled_x and plot.x.label:
        middle = left + 0.5 * width
        yield _text(_heading(plot.x), middle, top + height + 2 * _LINE, "middle", "label")
    for value, text in y.ticks(40.0) if labelled_y or plot.y.categories else ():
        place = top + float(y(value))
        yield _line("grid", left, place, left + width, place)
        if labelled_y:
            yield _text(_shortened(text, left), left - _GAP, place + 4, "end")
    # An inner picture cuts off what is outside of it.
    inner = Markup("").join(part for layer in plot.layers for part in _draw(layer, x, y, plot))
    yield Markup('<svg x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}">{}</svg>').format(
        left, top, width, height, inner
    )


def _draw(layer: Layer, x: _Scale, y: _Scale, plot: Plot) -> Iterator[Markup]:
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
        ends = (0, at, max(x.begin, x.end), at) if layer.across else (at, 0, at, max(y.begin, y.end))
        dash = _DASHES.get(layer.dash, "none")
        yield _line("rule", *ends, layer.text, stroke=color, stroke_dasharray=dash)
    elif isinstance(layer, Zone):
        first, last = sorted((y if layer.across else x)([layer.low, layer.high]).tolist())
        place = (0, first, max(x.begin, x.end), last - first) if layer.across else (first, 0, last - first, max(y.begin, y.end))
        sides = dict(zip(("x", "y", "width", "height"), place, strict=True))
        yield _element("rect", (_titled(layer.text),), **sides, fill=color, opacity=0.16)
    elif isinstance(layer, Points):
        yield from _points(layer, x, y, plot, color)


def _points(layer: Points, x: _Scale, y: _Scale, plot: Plot, color: str) -> Iterator[Markup]:
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
            way = (
                f"M{low:.1f} {b:.1f}H{high:.1f}M{low:.1f} {b - 3:.1f}v6M{high:.1f} {b - 3:.1f}v6"
                if layer.across
                else f"M{a:.1f} {low:.1f}V{high:.1f}M{a - 3:.1f} {low:.1f}h6M{a - 3:.1f} {high:.1f}h6"
            )
            parts.append(_path(way, color, 1.5))
        half = 0.5 * layer.size
        if layer.marker == "x":
            way = f"M{a - half:.1f} {b - half:.1f}l{2 * half} {2 * half}m0 {-2 * half}l{-2 * half} {2 * half}"
            parts.append(_path(way, color, 2.2))
        else:
            parts.append(_element("circle", cx=a, cy=b, r=half, fill=color))
        yield _element("g", parts)


def _values(layer: Points, number: int, plot: Plot) -> str:
    """Return the values of a point with their names, and its interval."""
    texts = []
    for axis, values, spread in ((plot.x, layer.x, layer.across), (plot.y, layer.y, not layer.across)):
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


def _scale(plot: Plot, side: str, begin: float, end: float) -> _Scale:
    axis: Axis = getattr(plot, side)
    if axis.flipped:
        begin, end = end, begin
    return _Scale(axis, *_ends(plot, side), begin, end)


def _ends(plot: Plot, side: str) -> tuple[float, float]:
    """Return the ends of an axis that hold all data and all intervals, with a margin."""
    axis: Axis = getattr(plot, side)
    if axis.categories:
        return -0.6, len(axis.categories) - 0.4
    parts = [np.asarray(v, float).ravel() for each in plot.layers for v in _held(each, side)]
    found = np.concatenate([np.empty(0), *parts])
    found = found[np.isfinite(found) & ((found > 0.0) | (not axis.log))]
    low, high = (float(found.min()), float(found.max())) if len(found) else (1.0, 1.0)
    if axis.log:
        more = (high / low) ** _MARGIN if high > low else 2.0
        low, high = low / more, high * more
    else:
        wide = high - low > 1e-9 * max(abs(low), abs(high))
        more = _MARGIN * (high - low) if wide else 0.5 * abs(high) or 0.5
        bars = side == "y" and low == 0.0 and any(isinstance(each, Bars) for each in plot.layers)
        low, high = low if bars else low - more, high + more
    low = low if axis.low is None else axis.low
    high = high if axis.high is None else axis.high
    return low, high if high > low else low + 1.0


def _held(layer: Layer, side: str) -> Iterator[Any]:
    """Yield the values of a layer that an axis has to hold."""
    if isinstance(layer, Rule | Zone):
        if layer.across == (side == "y"):
            yield from (layer.value,) if isinstance(layer, Rule) else (layer.low, layer.high)
    elif isinstance(layer, Bars):
        yield layer.edges if side == "x" else np.append(layer.y, 0.0)
    elif isinstance(layer, Envelope) and side == "y":
        yield from (layer.low, layer.high)
    elif isinstance(layer, Line | Envelope | Points):
        yield getattr(layer, side)
        if isinstance(layer, Points) and layer.across == (side == "x") and layer.low is not None:
            yield from (layer.low, layer.high)


def _step(least: float) -> float:
    power = 10.0 ** math.floor(math.log10(least))
    return next(step for m in (1, 2, 5, 10) if (step := m * power) >= least * (1.0 - 1e-9))


def _log_ticks(low: float, high: float, most: float) -> list[float]:
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    for parts in ((1.0, 2.0, 3.0, 5.0), (1.0, 2.0, 5.0), (1.0, 3.0), (1.0,)):
        found = [part * 10.0**n for n in range(first, last + 1) for part in parts]
        found = [value for value in found if low <= value * (1 + 1e-9) <= high * (1 + 2e-9)]
        if len(found) <= most:
            return found
    return found[:: math.ceil(len(found) / most)]


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


def _path(way: str, stroke: str, width: float = 0.0, dash: str = "", **style: Any) -> Markup:
    style = {"fill": "none", "stroke": stroke, "stroke_width": width} | style
    return _element("path", d=way, **style, **({"stroke_dasharray": dash} if dash else {}))


def _line(
    name: str, x1: float, y1: float, x2: float, y2: float, text: str = "", **style: Any
) -> Markup:
    return _element("line", (_titled(text),), class_=name, x1=x1, y1=y1, x2=x2, y2=y2, **style)


def _text(
    text: str, x: float, y: float, anchor: str, name: str = "tick", **style: Any
) -> Markup:
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
    return _LETTER * len(printable(text))


def _widest(scale: _Scale) -> float:
    return max((_width(text) + 10.0 for _, text in scale.ticks(70.0)), default=0.0)


def _shortened(text: str, room: float) -> str:
    most = max(int((room - _GAP) / _LETTER + 0.5), 4)
    return text if len(text) <= most else f"{text[: most - 1]}…"
