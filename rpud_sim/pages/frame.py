"""Self-contained HTML pages: their style, their tables, and their pictures inside the page."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from jinja2 import Environment, StrictUndefined

from rpud_sim.foundation.terminal import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The policy forbids scripts and anything from elsewhere: such a page cannot load or send anything.
_FRAME = """\
{%- macro table(heading, rows, numeric=true) %}
<div class="wide"><table{% if numeric %} class="numeric"{% endif %}>
{%- if heading %}
<thead><tr>{% for name in heading %}<th>{{ name }}</th>{% endfor %}</tr></thead>
{%- endif %}
<tbody>
{%- for row in rows %}
<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{%- endfor %}
</tbody></table></div>
{%- endmacro %}
{%- macro picture(data, title) %}
<img alt="{{ title }}" src="data:image/png;base64,{{ data }}">
{%- endmacro -%}
<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:;
 style-src 'unsafe-inline'">
<title>{{ title }}</title>
<style>
body { font: 15px/1.5 system-ui, sans-serif; color: #1c2733; max-width: 1100px; margin: 2em auto;
 padding: 0 1em; }
h1 { margin-bottom: 0; overflow-wrap: anywhere; }
h2 { margin-top: 2.2em; border-bottom: 2px solid #0072B2; padding-bottom: 3px; }
h3 { margin: 1.6em 0 .3em; overflow-wrap: anywhere; }
nav a { margin-right: 1.2em; color: #0072B2; }
img { max-width: 100%; display: block; margin: .5em 0; }
table { border-collapse: collapse; font-size: 13px; margin: .8em 0; }
th, td { border-bottom: 1px solid #dde3e9; padding: 3px 9px; text-align: left;
 vertical-align: top; overflow-wrap: anywhere; }
th { background: #eef3f7; }
.numeric td:not(:first-child) { font-variant-numeric: tabular-nums; }
.wide { overflow-x: auto; }
.parameters table { columns: 3; display: block; }
.tiles { display: flex; flex-wrap: wrap; gap: 12px; margin: 1.2em 0; }
.tile { background: #eef3f7; border-radius: 6px; padding: 10px 16px; }
.tile b { display: block; font-size: 20px; }
.none { color: #5b6b7a; font-style: italic; }
.warning, .paper { border-left: 4px solid #D55E00; padding-left: .8em; }
.model { border-left: 4px solid #0072B2; padding-left: .8em; }
@media print { body { max-width: none; margin: 0; font-size: 11px; } nav { display: none; }
 img, tr { break-inside: avoid; } h2, h3 { break-after: avoid; } .wide { overflow: visible; } }
</style></head><body>
<h1>{{ title }}</h1>
"""


def render_page(body: str, title: str, **context: object) -> str:
    """Return an HTML page; texts of the context are escaped, never interpreted as HTML.

    Args:
        body: template for jinja2 of everything below the title; it may use the macros
            ``table(heading, rows, numeric=true)`` and ``picture(base64, title)``.
        title: of the page.
        context: variables of the template.
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
    page = environment.from_string(f"{_FRAME}{body}</body></html>\n")
    return page.render(title=title, **context)


def to_png(figure: Figure, resolution: int) -> bytes:
    """Return a figure as a PNG file with so many dots per inch."""
    buffer = io.BytesIO()
    # Without the library's version in it, the same numbers give the same file.
    figure.savefig(buffer, format="png", dpi=resolution, metadata={"Software": None})
    return buffer.getvalue()
