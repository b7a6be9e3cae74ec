"""Bands of a flow are as wide as their amounts, and each has its name and amount."""

import re

import pytest

from rpud_sim.pages.flow import flow_picture


def bands(picture):
    """Return the height of each band where it leaves the bar in the middle."""
    found = []
    for path in re.findall(r'class="band" d="([^"]+)"', picture):
        start = float(re.match(r"M\d+,([-\d.]+)", path)[1])
        end = float(re.search(r"([-\d.]+)Z$", path)[1])
        found.append(end - start)
    return found


def test_bands_are_as_wide_as_their_amounts():
    picture = flow_picture({"vibration": 8.0}, {"rock": 6.0, "spring": 2.0}, "W", "8 W come in.")
    whole, rock, spring = bands(picture)
    assert (rock / whole, spring / whole) == (pytest.approx(0.75), pytest.approx(0.25))
    for text in ("vibration", "8 W", "rock", "6 W", "spring", "2 W"):
        assert f">{text}</tspan>" in picture
    assert 'aria-label="8 W come in."' in picture


def test_names_are_text():
    picture = flow_picture({"<script>": 1.0}, {"b": 1.0}, "W", '"><script>')
    assert "<script" not in picture
