"""HTML pages that need no network and no script, with plots as SVG pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup, escape

from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.plot import (
    Axis,
    Layer,
    Line,
    Plot,
    Points,
    Rule,
    Scale,
    Zone,
    scale_of,
)
from rpud_sim.pages.quantities import number_text

_LETTER = 7.2  # mean width of a letter of 12 pixels [pixels]
_SERIES = 7  # colours; further series begin again with the first
_APART = 32.0  # least distance of ticks upward [pixels]
_OVERHANG = 14.0  # of a text beyond a side; a longer one would reach into its neighbour [pixels]
_STROKE = 1.4  # width of a line [pixels]
_LINE = 18  # height of a line of text [pixels]
_GAP = 8  # pixels between a plot and its text
_MOST_TITLES = 400  # points of a cloud have no texts under the pointer: they are one path
_FIGURE = Markup(
    '<figure class="plot"><figcaption><span class="plot-title">{}</span>{}</figcaption>{}</figure>'
)
_GRID = Markup('{}<div class="plots" style="--least:{}em">{}</div>')
_LEGEND = Markup('<p class="keys">{}</p>')
_KEY = Markup('<span class="key"><i style="background:var(--{})"></i>{}</span>')
_PICTURE = Markup(
    '<div class="wide"{}><svg role="img" class="picture" viewBox="0 0 {} {}" width="{}"'
    ' style="min-width:{}px"><title>{}</title><desc>{}</desc>{}</svg></div>'
)
_SCROLLED = Markup(' tabindex="0" role="region" aria-label="{}"')
_NARROW = 480  # pixels; a wider picture can be scrolled on a phone


def figure(plot: Plot, keys: str | None = None) -> Markup:
    """Return a plot with its title and its legend, or other ``keys``, as an element of a page."""
    keys = _keys(plot.layers) if keys is None else keys
    columns = plot.y.columns
    upward = scale_of(plot, "y", plot.height, 0.0)
    texts = [text for _, text in upward.ticks(_APART)]
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
        parts.append(text_at(head, place, top - _GAP, "end", "head"))
        rows = upward(np.arange(len(cells)))
        for cell, row in zip(cells, rows, strict=True):
            parts.append(text_at(cell, place, top + row + 4, "end"))
    picture = _picture(plot.heading, plot.alt, plot.width, top + plot.height + below, parts)
    return _FIGURE.format(printable(plot.heading), keys, picture)


def figures(plots: Sequence[Plot], least: float = 20.0) -> Markup:
    """Return plots side by side, with one legend if they have the same.

    ``least`` is the width of a plot in the width of a letter.
    """
    keys = [_keys(plot.layers) for plot in plots]
    one = len(keys) > 1 and len(set(keys)) == 1
    drawn = [figure(plot, "" if one else each) for plot, each in zip(plots, keys, strict=True)]
    legend = _LEGEND.format(keys[0]) if one and keys[0] else ""
    return _GRID.format(legend, least, Markup("").join(drawn))


def _picture(title: str, alt: str, width: float, height: float, parts: Sequence[Markup]) -> Markup:
    title, alt = printable(title), printable(alt)
    scrolled = _SCROLLED.format(title) if width > _NARROW else ""
    least = round(min(0.7 * width, 720.0))
    body = Markup("").join(parts)
    return _PICTURE.format(scrolled, width, round(height), width, least, title, alt, body)


def _keys(layers: Sequence[Layer]) -> Markup:
    named = [layer for layer in layers if layer.name]
    keys = [_KEY.format(_color(layer), printable(layer.name)) for layer in named]
    return Markup("").join(keys) if len(keys) > 1 else Markup("")


def _panel(plot: Plot, left: float, top: float, width: float, height: float) -> Iterator[Markup]:
    """Yield the parts of one plot: its grid and texts, and its layers inside its frame."""
    x, y = scale_of(plot, "x", 0.0, width), scale_of(plot, "y", height, 0.0)
    for value, text in x.ticks(max(46.0, _widest(x))):
        place = left + float(x(value))
        yield line("grid", (place, top, place, top + height))
        over = 0.5 * _width(text) - min(place - left, left + width - place)
        if over < _OVERHANG:
            yield text_at(text, place, top + height + _LINE - 2, "middle")
    if plot.x.label:
        middle = left + 0.5 * width
        yield text_at(_heading(plot.x), middle, top + height + 2 * _LINE, "middle", "label")
    for value, text in y.ticks(_APART):
        place = top + float(y(value))
        yield line("grid", (left, place, left + width, place))
        yield text_at(_shortened(text, left), left - _GAP, place + 4, "end")
    # An inner picture cuts off what is outside of it.
    inner = Markup("").join(part for layer in plot.layers for part in _draw(layer, x, y, plot))
    yield Markup('<svg x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}">{}</svg>').format(
        left, top, width, height, inner
    )


def _draw(layer: Layer, x: Scale, y: Scale, plot: Plot) -> Iterator[Markup]:
    color = f"var(--{_color(layer)})"
    height = max(y.begin, y.end)
    if isinstance(layer, Line):
        yield path(track(x(layer.x), y(layer.y), layer.steps), color, _STROKE)
    elif isinstance(layer, Rule):
        place = float(x(layer.value))
        yield line("rule", (place, 0.0, place, height), stroke=color)
    elif isinstance(layer, Zone):
        first, last = x([layer.low, layer.high]).tolist()
        box = {"x": first, "y": 0.0, "width": last - first, "height": height}
        yield element("rect", **box, fill=color, opacity=0.16)
    else:
        yield from _points(layer, x, y, plot, color)


def _points(layer: Points, x: Scale, y: Scale, plot: Plot, color: str) -> Iterator[Markup]:
    across, upward = x(layer.x), y(layer.y)
    shown = np.isfinite(across + upward)
    if layer.joined:
        yield path(track(across, upward), color, _STROKE)
    if len(across) > _MOST_TITLES or layer.size < 3.0:
        dots = zip(across[shown], upward[shown], strict=True)
        way = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in dots)
        yield path(way, color, layer.size, opacity=0.5, stroke_linecap="round")
        return
    scale = x if layer.across else y
    ends = () if layer.low is None or layer.high is None else (scale(layer.low), scale(layer.high))
    marks = []
    for number in np.flatnonzero(shown).tolist():
        a, b = float(across[number]), float(upward[number])
        text = layer.titles[number] if layer.titles else _values(layer, number, plot)
        lines: list[tuple[float, float, float, float]] = []
        if ends and math.isfinite(ends[0][number] + ends[1][number]):
            low, high = (float(end[number]) for end in ends)
            if layer.across:
                lines = [(low, b, high, b), *((at, b - 3, at, b + 3) for at in (low, high))]
            else:
                lines = [(a, low, a, high), *((a - 3, at, a + 3, at) for at in (low, high))]
        way = "".join(f"M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" for x1, y1, x2, y2 in lines)
        ends_of = [element("path", d=way)] if lines else []
        dot = element("circle", cx=round(a, 1), cy=round(b, 1), r=0.5 * layer.size)
        marks.append(element("g", [titled(text), *ends_of, dot]))
    yield element("g", marks, class_="points", fill=color, stroke=color)


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
        name = axis.label or (plot.title if axis is plot.y else "")
        texts.append(f"{name} {text}".lstrip())
    return ", ".join(texts)


def _color(layer: Layer) -> str:
    number = layer.color
    return f"series{number % _SERIES}" if isinstance(number, int) else number


def _heading(axis: Axis) -> str:
    return f"{axis.label} [{axis.unit}]" if axis.unit else axis.label


def _width(text: str) -> float:
    return _LETTER * len(printable(text)) + 3.0


def _widest(scale: Scale) -> float:
    return max((_width(text) + 10.0 for _, text in scale.ticks(70.0)), default=0.0)


def _shortened(text: str, room: float) -> str:
    most = max(int((room - _GAP) / _LETTER + 0.5), 4)
    return text if len(text) <= most else f"{text[: most - 1]}…"


# Elements of a picture; places are in pixels


def track(x: np.ndarray, y: np.ndarray, steps: bool = False) -> str:
    """Return the way through points; NaN is a gap."""
    texts = []
    known = np.isfinite(x) & np.isfinite(y)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    for first, end in edges.reshape(-1, 2).tolist():
        points = list(zip(x[first:end].tolist(), y[first:end].tolist(), strict=True))
        texts.append(f"M{points[0][0]:.1f} {points[0][1]:.1f}")
        texts += [f"H{a:.1f}V{b:.1f}" if steps else f"L{a:.1f} {b:.1f}" for a, b in points[1:]]
    return "".join(texts)


def path(way: str, stroke: str, width: float = 0.0, **style: Any) -> Markup:
    """Return a path; it has no filling unless its style says so."""
    found: dict[str, Any] = {"fill": "none", "stroke": stroke, "stroke_width": width, **style}
    return element("path", d=way, **found)


def line(name: str, ends: tuple[float, float, float, float], **style: Any) -> Markup:
    places = dict(zip(("x1", "y1", "x2", "y2"), ends, strict=True))
    return element("line", (), class_=name, **places, **style)


def text_at(text: str, x: float, y: float, anchor: str, name: str = "tick", **style: Any) -> Markup:
    inner = (escape(printable(text)),)
    return element("text", inner, class_=name, x=x, y=y, text_anchor=anchor, **style)


def titled(text: str) -> Markup:
    """Return the text under the pointer; nothing for an empty one."""
    return element("title", (escape(printable(text)),)) if text else Markup("")


def element(tag: str, inner: Sequence[Markup] = (), **attributes: Any) -> Markup:
    """Return an element; ``_`` in the name of an attribute stands for ``-``."""
    texts = [
        Markup(' {}="{}"').format(
            name.rstrip("_").replace("_", "-"), f"{v:.4g}" if isinstance(v, float) else v
        )
        for name, v in attributes.items()
    ]
    return Markup("<{0}{1}>{2}</{0}>").format(
        Markup(tag), Markup("").join(texts), Markup("").join(inner)
    )


_STYLE = Path(__file__).parent / "share" / "page.css"
_MACROS = """\
{%- macro table(heading, rows, numeric=true, caption="") %}
<div class="wide" tabindex="0" role="region" aria-label="{{ caption or "table" }}"><table
{%- if numeric %} class="numeric"{% endif %}>
{%- if caption %}<caption>{{ caption }}</caption>{% endif %}
{%- if heading %}
<thead><tr>{% for name in heading %}<th scope="col">{{ name }}</th>{% endfor %}</tr></thead>
{%- endif %}
<tbody>
{%- for row in rows %}
<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{%- endfor %}
</tbody></table></div>
{%- endmacro %}
"""
# The policy forbids everything from elsewhere, and every script: such a page cannot load or send
# anything, and no text in it can become a program.
_FRAME = """\
<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none';
 style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{{ title }}</title>
<style>
{{ style }}</style></head><body>
<a class="skip" href="#main">Skip to the content</a>
<header><h1>{{ title }}</h1></header>
<main id="main" tabindex="-1">
{{ body }}</main>
</body></html>
"""


def render_page(body: str, title: str, **context: object) -> str:
    """Return an HTML page; texts of the context are escaped, never interpreted as HTML.

    ``body`` is a template for jinja2 of everything below the title. It may use ``table(heading,
    rows, numeric=true, caption="")``, ``figure(Plot)`` and ``figures(plots, least=20)``.
    """
    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        # Only plain texts: the results of macros are HTML already, with its line breaks.
        finalize=lambda value: printable(value) if type(value) is str else value,
    )
    content = environment.from_string(f"{_MACROS}{body}").render(
        figure=figure, figures=figures, title=title, **context
    )
    style = _STYLE.read_text(encoding="utf-8")
    return environment.from_string(_FRAME).render(
        title=title, style=Markup(style), body=Markup(content)
    )
