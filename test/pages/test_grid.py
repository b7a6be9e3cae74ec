"""Plots side by side: those over one quantity zoom together, within ends that hold them all."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.pages.grid import grid_groups
from rpud_sim.pages.plot import Axis, Line, Plot

FORCE, SPEED = Axis("weight on bit", "N"), Axis("speed", "m/s")


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


@given(st.lists(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=4), min_size=1, max_size=4))
def test_no_point_is_outside_of_the_range(values):
    [group] = grid_groups("g", [plot(str(i), FORCE, *each) for i, each in enumerate(values)])
    found = [value for each in values for value in each]
    assert group.x.low <= min(found) <= max(found) <= group.x.high
