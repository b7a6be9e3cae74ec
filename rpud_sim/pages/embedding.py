"""Plots inside a page: their host elements, their data, and the scripts that draw them.

A page with plots holds BokehJS once, the data of each plot, and ``share/plots.js``. Plots are drawn
when they come into view. The policy of the page names its scripts by their digests, so that no
other text can run.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.extent import layer_color
from rpud_sim.pages.grid import grid_groups, grid_html
from rpud_sim.pages.plot import Mark, Plot, TimeColumn
from rpud_sim.pages.theme import DARK, LIGHT

if TYPE_CHECKING:
    from rpud_sim.pages.figures import Drawn

_SHARE = Path(__file__).parent / "share"
_HOST = Markup(
    '<figure class="plot" data-plot="{name}" data-group="{group}"><figcaption>'
    '<span class="plot-title">{heading}</span>{keys}{seen}</figcaption>'
    '<div class="plot-area" tabindex="0" role="group" aria-label="{heading}, plot">'
    '<div class="plot-drawing" role="img" {label} style="min-height:{height}px">{inner}</div>'
    "</div></figure>"
)
_KEY = Markup(
    '<span class="key" data-layer="{layer}"><i style="background:var(--{color})"></i>'
    "{text} <output></output></span>"
)
_CONTROLS = Markup(
    '<div class="plot-controls" data-group="{group}" role="group" aria-label="{label}">'
    '<button type="button" data-act="back" title="earlier (arrow left)">'
    '<span aria-hidden="true">◀</span><span class="unseen">earlier</span></button>'
    '<button type="button" data-act="on" title="later (arrow right)">'
    '<span aria-hidden="true">▶</span><span class="unseen">later</span></button>'
    '<button type="button" data-act="in" title="zoom in (+)">'
    '<span aria-hidden="true">+</span><span class="unseen">zoom in</span></button>'
    '<button type="button" data-act="out" title="zoom out (-)">'
    '<span aria-hidden="true">−</span><span class="unseen">zoom out</span></button>'
    '<button type="button" data-act="whole" title="whole time (Home)">whole</button>'
    '<span class="plot-range"></span><span class="plot-cursor"></span>'
    '<span class="plot-spoken unseen" aria-live="polite"></span></div>'
)
_COLUMN = Markup('<div class="plots-group">{}{}</div>')
_EXTRA = 50  # pixels of the axis and the border of a figure


class Embedding:
    """Collection of the plots of one page."""

    def __init__(self) -> None:
        self._drawn: list[Drawn] = []
        self._groups: dict[str, dict[str, Any]] = {}

    def plot(self, plot: Plot) -> Markup:
        """Return the element of a plot that stands alone."""
        from rpud_sim.pages.figures import draw_plot

        name = f"plot-{len(self._drawn) + 1}"
        self._drawn.append(draw_plot(plot, name))
        return host(plot, name)

    def column(self, column: TimeColumn) -> Markup:
        """Return the elements of a column, with the controls of its time above them."""
        from rpud_sim.pages.figures import draw_column

        first = len(self._drawn) + 1
        names = [f"plot-{number}" for number in range(first, first + len(column.plots))]
        self._drawn += draw_column(column, names)
        if column.name not in self._groups:
            self._groups[column.name] = group_content(
                column.begin, column.end, column.marks, column.unit
            )
        hosts = (host(*pair, column.name) for pair in zip(column.plots, names, strict=True))
        return _COLUMN.format(controls(column.name), Markup("").join(hosts))

    def grid(self, name: str, plots: Sequence[Plot], least: float = 26.0) -> Markup:
        """Return the elements of plots side by side; those over one quantity zoom together.

        The name is unique in the page; ``least`` is the width of a plot in the width of a letter.
        """
        from rpud_sim.pages.figures import draw_plot

        html = Markup("")
        for group in grid_groups(name, plots):
            first = len(self._drawn) + 1
            names = [f"plot-{number}" for number in range(first, first + len(group.plots))]
            pairs = list(zip(group.plots, names, strict=True))
            self._drawn += [draw_plot(plot, host_name) for plot, host_name in pairs]
            bar = Markup("")
            if group.name:
                x = group.x
                self._groups[group.name] = group_content(x.low or 0.0, x.high or 0.0, (), x.unit)
                bar = controls(group.name, x.label)
            html += grid_html([host(*pair, group.name) for pair in pairs], bar, least)
        return html

    @property
    def empty(self) -> bool:
        """Whether the page has no plots, and needs no scripts."""
        return not self._drawn

    def scripts(self) -> tuple[Markup, list[str]]:
        """Return the elements at the end of the page, and the sources that its policy allows."""
        if self.empty:
            return Markup(""), []
        from rpud_sim.pages.figures import standalone

        parts = [
            json_element(content, "plot-group", name) for name, content in self._groups.items()
        ]
        parts += [
            json_element(standalone(drawn.figure), "plot-data", drawn.figure.name)
            for drawn in self._drawn
        ]
        parts.append(_theme_element())
        codes = [bokeh_script(), plots_script()]
        parts += [Markup("<script>{}</script>").format(Markup(code)) for code in codes]
        return Markup("\n").join(parts), [_digest(code) for code in codes]


def server_scripts(groups: Mapping[str, Mapping[str, Any]]) -> Markup:
    """Return the elements at the end of a server's page, which has BokehJS already.

    ``groups`` has, by name, what ``group_content`` gives; empty for a time that is open.
    """
    parts = [json_element(content, "plot-group", name) for name, content in groups.items()]
    script = Markup("<script>{}</script>").format(Markup(plots_script()))
    return Markup("\n").join([*parts, _theme_element(), script])


def host(plot: Plot, name: str, group: str = "", inner: Markup | None = None) -> Markup:
    """Return the element that holds a figure, its title, its legend and the values at the cursor.

    Plots of a ``group`` zoom together. A server embeds the figure into ``inner``.
    """
    keys = [
        _KEY.format(layer=number, color=layer_color(layer), text=printable(layer.name))
        for number, layer in enumerate(plot.layers)
        if getattr(layer, "values", None) is None
    ]
    seen = Markup("")
    label = Markup('aria-label="{}"').format(plot.heading)
    if plot.alt:
        seen = Markup('<span class="plot-seen" id="{}-seen">{}</span>').format(
            name, printable(plot.alt)
        )
        label = Markup('aria-labelledby="{}-seen"').format(name)
    return _HOST.format(
        name=name,
        group=group,
        heading=printable(plot.heading),
        keys=Markup('<span class="keys">{}</span>').format(Markup("").join(keys)),
        seen=seen,
        label=label,
        height=plot.height + _EXTRA,
        inner=inner or Markup(""),
    )


def controls(group: str, quantity: str = "time") -> Markup:
    """Return the buttons that move and zoom a group of plots along x, the time in a column."""
    return _CONTROLS.format(group=group, label=f"Range of {quantity}")


def group_content(
    begin: float, end: float, marks: Sequence[Mark], unit: str = "s"
) -> dict[str, Any]:
    """Return what the scripts know of a group: its whole time, and the texts of its marks."""
    return {
        "begin": begin,
        "end": end,
        "unit": unit,
        "marks": [
            {
                "kind": mark.kind,
                "time": mark.time,
                "end": mark.end,
                "text": printable(mark.text),
            }
            for mark in marks
            if math.isfinite(mark.time)
        ],
    }


def json_element(content: Any, kind: str, name: str) -> Markup:
    """Return data for the scripts; no text in them ends the element."""
    text = json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")
    return Markup('<script type="application/json" class="{}" data-name="{}">{}</script>').format(
        kind, name, Markup(text)
    )


def _theme_element() -> Markup:
    return json_element({"light": dict(LIGHT), "dark": dict(DARK)}, "plot-theme", "")


@cache
def plots_script() -> str:
    """Return the script of the plots: theme, zoom, cursor and keyboard."""
    return (_SHARE / "plots.js").read_text(encoding="utf-8")


@cache
def page_style() -> str:
    """Return the style of all pages, without the colours."""
    return (_SHARE / "page.css").read_text(encoding="utf-8")


@cache
def bokeh_script() -> str:
    """Return BokehJS, as small as it comes, without its widgets."""
    from bokeh.resources import Resources

    [code] = Resources(mode="inline", components=["bokeh"]).js_raw[:1]
    return code


def _digest(script: str) -> str:
    found = hashlib.sha256(script.encode()).digest()
    return f"'sha256-{base64.b64encode(found).decode()}'"
