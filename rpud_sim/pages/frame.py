"""Self-contained HTML pages: their style, their tables, their plots in the page."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.svg import figure, figures

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
