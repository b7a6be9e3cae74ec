"""Plots side by side: those over one quantity zoom together, within ends that hold them all."""

import json
import re

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.pages.frame import render_page
from rpud_sim.pages.grid import grid_groups
from rpud_sim.pages.plot import Axis, Line, Plot

FORCE, SPEED = Axis("weight on bit", "N"), Axis("speed", "m/s")
CHOICE = Axis("model", categories=("printed", "given"))


def plot(title, x, *values):
    return Plot(title, (Line("mean", np.array(values), np.ones(len(values))),), x=x)


def test_plots_over_one_quantity_are_a_group_with_one_range():
    plots = (plot("a", FORCE, 1.0, 2.0), plot("b", SPEED, 5.0, 6.0), plot("c", FORCE, 3.0, 9.0))
    force, speed = grid_groups("swept", plots)
    assert [each.title for each in force.plots] == ["a", "c"]
    assert [each.title for each in speed.plots] == ["b"]
    ends = {(each.x.low, each.x.high) for each in force.plots}
    assert ends == {(force.x.low, force.x.high)}
    assert force.x.low <= 1.0 < 9.0 <= force.x.high
    assert force.name != speed.name


def test_plots_over_words_do_not_zoom():
    [group] = grid_groups("swept", (plot("a", CHOICE, 0.0, 1.0),))
    assert group.name == ""
    page = render_page("{{ grid('swept', plots) }}", "t", plots=group.plots)
    assert 'class="plot-controls"' not in page


@given(st.lists(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=4), min_size=1, max_size=4))
def test_no_point_is_outside_of_the_range(values):
    [group] = grid_groups("g", [plot(str(i), FORCE, *each) for i, each in enumerate(values)])
    found = [value for each in values for value in each]
    assert group.x.low <= min(found) <= max(found) <= group.x.high


def test_the_page_has_each_plot_once_and_the_unit_of_the_range():
    plots = (plot("first", FORCE, 1.0, 2.0), plot("<second>", FORCE, 3.0, 9.0))
    page = render_page("{{ grid('swept', plots) }}", "t", plots=plots)
    hosts = re.findall(r'<figure class="plot" data-plot="([\w-]+)" data-group="swept-1"', page)
    assert len(set(hosts)) == 2
    assert "&lt;second&gt;" in page
    text = re.search(r'class="plot-group" data-name="swept-1">(.*?)</script>', page)[1]
    group = json.loads(text)
    assert group["unit"] == "N"
    assert group["begin"] <= 1.0
    assert group["end"] >= 9.0
