"""Clouds of points: their values stand beside the pointer, where a cursor along x finds none."""

import numpy as np
from bokeh.models import HoverTool

from rpud_sim.pages.figures import draw_plot
from rpud_sim.pages.plot import Axis, Line, Plot, Points
from rpud_sim.pages.pointing import is_cloud

ORDERED = Points("a", np.array([1.0, 2.0, 2.0]), np.array([5.0, 4.0, 3.0]))
CLOUD = Points("b", np.array([1.0, 3.0, 2.0]), np.array([0.0, 1.1, 0.9]))


def hover(plot):
    return [tool for tool in draw_plot(plot, "p").figure.tools if isinstance(tool, HoverTool)]


def test_points_in_no_order_are_a_cloud():
    assert is_cloud(CLOUD)
    assert not is_cloud(ORDERED)
    assert not is_cloud(Line("c", CLOUD.x, CLOUD.y))


def test_the_cursor_reads_points_in_order_and_the_pointer_those_of_a_cloud():
    ordered, cloud = draw_plot(Plot("t", (ORDERED,)), "p"), draw_plot(Plot("t", (CLOUD,)), "p")
    assert any('"read"' in tag for tag in ordered.sources["a"].tags)
    assert not any('"read"' in tag for tag in cloud.sources["b"].tags)
    assert not hover(Plot("t", (ORDERED,)))
    [tool] = hover(Plot("force", (CLOUD,), y=Axis(unit="N"), x=Axis("time", "s")))
    assert tool.tooltips == [("force [N]", "@y{%.4g}"), ("time [s]", "@x{%.4g}")]


def test_intervals_shades_and_words_are_shown_too():
    cloud = Points(
        "b", CLOUD.x, CLOUD.y, CLOUD.x - 1.0, CLOUD.x + 1.0, across=True, values=CLOUD.y,
        values_label="misfit",
    )  # fmt: skip
    drawn = draw_plot(Plot("t", (cloud,), y=Axis(categories=("<first>", "second"))), "p")
    [tool] = [each for each in drawn.figure.tools if isinstance(each, HoverTool)]
    assert [label for label, _ in tool.tooltips] == ["", "", "from", "to", "misfit"]
    assert list(drawn.sources["b"].data["y_word"]) == ["<first>", "second", "second"]
