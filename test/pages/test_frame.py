"""Pages stand alone, and take no text of their context for HTML or for steering characters."""

import re

import pytest
from jinja2 import UndefinedError

from rpud_sim.pages.frame import render_page


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
