"""HTML pages that need no network and no script, with pictures by matplotlib in them."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from rpud_sim.foundation.terminal import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FIGURE = Markup(
    '<figure class="plot"><figcaption>{0}</figcaption><div class="wide"{1}><svg role="img"'
    ' class="picture" viewBox="0 0 {2} {3}" width="{2}" style="min-width:{4}px"><title>{0}</title>'
    "<desc>{5}</desc>{6}</svg></div></figure>"
)
_GRID = Markup('<div class="plots" style="--least:{}em">{}</div>')
_SCROLLED = Markup(' tabindex="0" role="region" aria-label="{}"')
_NARROW = 480  # pixels; a wider picture can be scrolled on a phone
_STYLE = Path(__file__).parent / "share" / "page.css"
# In a file of matplotlib: an id, or a reference to one.
_ID = re.compile(r'(\bid="|url\(#|href="#)')


@dataclass(frozen=True)
class Picture:
    """Drawing of a figure as SVG, in the colours of the page, light or dark."""

    title: str  # name of what it shows, with its unit
    alt: str  # sentence that shows what is seen, for those who do not see it
    width: int  # width with all texts [pixels]
    height: int
    content: str  # elements inside of ``svg``


def colors() -> dict[str, str]:
    """Return the colours of ``page.css`` by name, as ``#rrggbb``; pictures turn them into names."""
    light = _STYLE.read_text(encoding="utf-8").partition("@media")[0]
    return dict(re.findall(r"--(\w+):\s+(#\w{6})", light))


def picture(
    title: str, alt: str, draw: Callable[[Axes], object], height: int = 190, width: int = 344
) -> Picture:
    """Return a picture; ``draw`` draws it on axes, and a legend has what it labels, if several."""
    from cycler import cycler
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullLocator

    found = colors()
    style: Any = {
        "font.size": 10,
        "svg.fonttype": "none",
        "svg.hashsalt": title,  # the same file each time
        "text.parse_math": False,  # a $ in a name is a $
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.unicode_minus": True,
        "axes.xmargin": 0.02,
        "figure.facecolor": "none",
        "axes.facecolor": "none",
        "legend.frameon": False,
        "lines.linewidth": 1.4,
        "grid.color": found["rule"],
        "text.color": found["text"],
        "xtick.labelcolor": found["text"],
        "ytick.labelcolor": found["text"],
        "axes.labelcolor": found["text"],
        **dict.fromkeys(("axes.edgecolor", "xtick.color", "ytick.color"), found["muted"]),
        "axes.prop_cycle": cycler(color=[found[f"series{n}"] for n in range(7)]),
    }
    text = io.StringIO()
    with rc_context(style):
        figure = Figure((width / 72, height / 72), layout="constrained")
        axes = figure.add_subplot()
        draw(axes)
        for axis in (axes.xaxis, axes.yaxis):
            if axis.get_scale() == "log":
                axis.set_major_locator(LogLocator(subs=(1, 2, 3, 5), numticks=9))
                axis.set_major_formatter(lambda value, _: f"{value:g}")
                axis.set_minor_locator(NullLocator())
        handles, labels = axes.get_legend_handles_labels()
        if len(labels) > 1:
            figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
        about = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(text, format="svg", metadata=about)
    content = re.split(r"<svg [^>]*>", text.getvalue())[1].rpartition("</svg>")[0]
    for name, color in found.items():
        content = content.replace(color, f"var(--{name})")
    return Picture(printable(title), printable(alt), width, height, content)


def _figures(numbers: count[int], pictures: Sequence[Picture], least: float = 20.0) -> Markup:
    """Return pictures side by side; ``least`` is the width of one in the width of a letter."""
    drawn = []
    for each in pictures:
        scrolled = _SCROLLED.format(each.title) if each.width > _NARROW else ""
        # Each picture of a page needs different ids.
        content = Markup(_ID.sub(rf"\g<1>p{next(numbers)}-", each.content))
        size = each.width, each.height, round(min(0.7 * each.width, 720.0))
        drawn.append(_FIGURE.format(each.title, scrolled, *size, each.alt, content))
    return drawn[0] if len(drawn) == 1 else _GRID.format(least, Markup("").join(drawn))


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
    rows, numeric=true, caption="")`` and ``figures(pictures, least=20)``.
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
        figures=partial(_figures, count()), title=title, **context
    )
    style = _STYLE.read_text(encoding="utf-8")
    return environment.from_string(_FRAME).render(
        title=title, style=Markup(style), body=Markup(content)
    )
