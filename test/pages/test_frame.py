"""Pages stand alone, and take no text of their context for HTML or for steering characters."""

import re

import pytest
from jinja2 import UndefinedError

from rpud_sim.pages.frame import colors, picture, render_page


def test_texts_are_escaped_and_macros_are_html():
    page = render_page("{{ table(('<a>',), [('<b>', 'c\x1b\u202e')]) }}", "<title>")
    assert "<title>&lt;title&gt;</title>" in page
    assert '<th scope="col">&lt;a&gt;</th>' in page
    assert "<td>&lt;b&gt;</td><td>c\\x1b\\u202e</td>" in page
    assert page.startswith("<!DOCTYPE html>")
    assert page.endswith("</body></html>\n")


def test_a_page_may_load_nothing():
    page = render_page("", "title")
    assert "default-src 'none'" in page
    assert not re.search("https?:|<script|<link", page)


def test_a_variable_that_is_missing_is_an_error():
    with pytest.raises(UndefinedError):
        render_page("{{ missing }}", "title")


EVIL = '</svg><script>alert("$x$")</script>&'


@pytest.mark.extended
def test_a_picture_has_the_colours_of_the_page_and_texts_that_stay_texts():
    def draw(axes):
        axes.plot([0.0, 1.0, 2.0], [1.0, float("nan"), 3.0], label=EVIL)
        axes.plot([0.0, 1.0], [2.0, 2.0], color=colors()["muted"], label="other")
        axes.set_xlabel(EVIL)

    drawn = picture(EVIL, EVIL, draw)
    page = render_page("{{ figures([one, one]) }}", "title", one=drawn)
    assert page.count("<svg ") == page.count("</svg>") == page.count('role="img"') == 2
    assert "<script" not in page
    assert "$x$" in drawn.content  # and no formula
    assert {"series0", "muted", "text"} <= set(re.findall(r"var\(--(\w+)\)", drawn.content))
    assert not re.search(r"#[0-9a-f]{6}|https?:|nan", drawn.content)
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    assert {f"#{name}" for name in ids} >= set(re.findall(r'href="(#p[^"]+)"', page))
    assert picture(EVIL, EVIL, draw) == drawn
