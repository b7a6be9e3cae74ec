"""Pictures show the data of their plots, with a text for those who do not see them."""

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.pages import frame as svg
from rpud_sim.pages.frame import figure, figures
from rpud_sim.pages.plot import Axis, Line, Plot, Points, Rule, Zone

STYLE = (Path(svg.__file__).parent / "share" / "page.css").read_text()
X = np.arange(4.0)
Y = np.array([1.0, np.nan, 3.0, 4.0])
LAYERS = (
    Line("line", X, Y),
    Line("steps", X, Y, steps=True),
    Points("points", X, Y, Y - 0.1, Y + 0.1, joined=True),
    Points("across", X, Y, X - 0.1, X + 0.1, across=True),
    Points("cloud", X, Y, size=2.0),
    Rule("rule", 2.0),
    Zone("zone", 1.0, 2.0),
)
EVIL = '</svg><script>alert(1)</script>"&'


def parsed(html):
    return ElementTree.fromstring(str(html))


def paths(html):
    return [path for path in re.findall(r'<path d="([^"]*)"', str(html)) if path]


def titles(html):
    return re.findall(r"<title>([^<]*)</title>", str(html))


@pytest.mark.parametrize("layer", LAYERS, ids=lambda layer: layer.name)
def test_each_layer_is_drawn_in_colours_of_both_themes(layer):
    html = figure(Plot("title", (layer,), "What is seen.", Axis(unit="N")))
    parsed(html)
    names = set(re.findall(r"var\(--(\w+)\)", html))
    assert names
    light, dark = (set(re.findall(r"--(\w+):", part)) for part in STYLE.split("@media")[:2])
    assert names <= light == dark
    assert "nan" not in html
    assert "<title>title [N]</title><desc>What is seen.</desc>" in html


def test_a_gap_breaks_a_line_and_steps_hold_their_value():
    line, steps = (figure(Plot("a", (layer,))) for layer in LAYERS[:2])
    [way] = paths(line)
    assert way.count("M") == 2
    [way] = paths(steps)
    assert re.fullmatch(r"M[\d. ]+M[\d. ]+H[\d.]+V[\d.]+", way)


def test_the_pointer_shows_a_point_with_its_interval():
    layer = Points("a", np.array([8.0]), np.array([1.2]), np.array([1.1]), np.array([1.35]))
    plot = Plot("peak force", (layer,), y=Axis(unit="kN"), x=Axis("weight on bit", "N"))
    assert "weight on bit 8 N, peak force 1.2 kN (1.1 to 1.35)" in titles(figure(plot))
    named = Points("a", np.zeros(1), np.zeros(1), titles=("of its own",))
    assert "of its own" in titles(figure(Plot("b", (named,))))
    words = Plot("b", (Points("a", np.zeros(1), np.ones(1)),), y=Axis(categories=("no", "yes")))
    assert "0, yes" in titles(figure(words))


def test_many_points_are_one_path():
    values = np.linspace(0.0, 1.0, 5000)
    html = figure(Plot("a", (Points("b", values, values),)))
    assert len(paths(html)) == 1
    assert len(html) < 100_000


def test_columns_stand_beside_their_rows():
    columns = (("A", ("1 N", "2 N")), ("B", ("3 N", "4 N")))
    layer = Points("a", np.arange(2.0), np.arange(2.0))
    up = Axis(categories=("first", "second"), columns=columns, flipped=True)
    html = figure(Plot("b", (layer,), y=up, width=800))
    places = {
        text: float(y)
        for y, text in re.findall(r'<text [^>]*y="([\d.]+)"[^>]*>([^<]*)</text>', html)
    }
    assert places["first"] == places["1 N"] == places["3 N"] < places["second"] == places["4 N"]


def test_plots_of_one_legend_share_it():
    plots = [Plot(name, LAYERS[:2]) for name in "ab"]
    assert figures(plots).count('class="key"') == 2
    assert figures([*plots, Plot("c", LAYERS[2:4])]).count('class="key"') == 6
    assert figures([]).count("svg") == 0


def test_texts_stay_texts():
    axis = Axis(EVIL, EVIL)
    points = Points(EVIL, np.zeros(1), np.zeros(1))
    html = figure(Plot(EVIL, (points, Rule(EVIL, 1.0)), EVIL, axis, axis))
    assert "<script" not in html
    parsed(html)
    words = Axis(categories=(EVIL,), columns=((EVIL, (EVIL,)),))
    parsed(figure(Plot(EVIL, (points,), y=words)))


@given(
    st.lists(st.tuples(st.floats(), st.floats()), min_size=1, max_size=30),
    st.booleans(),
    st.booleans(),
)
def test_any_data_make_a_picture(items, log, steps):
    x, y = np.array(items, float).T
    layers = Line("a", x, y, steps), Points("b", x, y, y - 1.0, y + 1.0, joined=True)
    with np.errstate(divide="raise", invalid="raise"):
        html = figure(Plot("d", layers, y=Axis(log=log), x=Axis(log=log)))
    parsed(html)
    assert "nan" not in "".join(paths(html))
    assert "inf" not in "".join(paths(html))
