"""Self-contained HTML pages: their style, their tables, their pictures and plots in the page."""

from __future__ import annotations

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.embedding import Embedding, page_style
from rpud_sim.pages.svg import figure, figures
from rpud_sim.pages.theme import css_variables

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
# The policy forbids everything from elsewhere, and every script but ours: such a page cannot load
# or send anything, and no text in it can become a program.
_FRAME = """\
<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:;
 style-src 'unsafe-inline'{% if sources %}; script-src {{ sources | join(" ") }}{% endif %}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{{ title }}</title>
<style>
{{ style }}</style></head><body>
<a class="skip" href="#main">Skip to the content</a>
<header><h1>{{ title }}</h1></header>
<main id="main" tabindex="-1">
{{ body }}</main>
{{ scripts }}</body></html>
"""


def render_page(body: str, title: str, **context: object) -> str:
    """Return an HTML page; texts of the context are escaped, never interpreted as HTML.

    ``body`` is a template for jinja2 of everything below the title. It may use ``table(heading,
    rows, numeric=true, caption="")``, ``plot(Plot)``, ``column(TimeColumn)`` and ``grid(name,
    plots, least=26)``; ``figure(Plot)`` and ``figures(plots, least=20)`` need no script.
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
    embedding = Embedding()
    content = environment.from_string(f"{_MACROS}{body}").render(
        plot=embedding.plot,
        column=embedding.column,
        grid=embedding.grid,
        figure=figure,
        figures=figures,
        title=title,
        **context,
    )
    scripts, sources = embedding.scripts()
    return environment.from_string(_FRAME).render(
        title=title,
        style=Markup(page_head_style()),
        body=Markup(content),
        scripts=scripts,
        sources=[Markup(source) for source in sources],
    )


def page_head_style() -> str:
    """Return the whole style of a page: colours and layout."""
    return css_variables() + page_style()
