"""Plots and page of a sweep: means with intervals, and every point up to a number of rows."""

import re

import numpy as np
import pytest
from scipy import stats

from rpud_sim.simulation.statistics import FIGURES
from rpud_sim.studies.sweep import sweep_report
from rpud_sim.studies.sweep.point_plots import marginal_means, point_plots
from rpud_sim.studies.sweep.specification_file import parse_specification
from rpud_sim.studies.sweep.sweep_report import sweep_page
from rpud_sim.studies.sweep.tables import error_name

GRID = parse_specification(
    {
        "design": "grid",
        "duration": 0.5,
        "repeat": 4,
        "swept": {
            "weight_on_bit": {"minimum": 5, "maximum": 40, "points": 3, "scale": "log"},
            "contact_model": ["printed", "rayleigh"],
        },
    }
)


def table_of(specification, seed=0):
    """A table of points whose figures are drawn, not simulated."""
    random = np.random.default_rng(seed)
    count = specification.point_count
    names = list(specification.swept)
    levels = np.meshgrid(*(specification.swept[name].levels() for name in names), indexing="ij")
    table = {name: grid.ravel() for name, grid in zip(names, levels, strict=True)}
    table |= {"point": np.arange(count), "members": np.full(count, specification.repeat)}
    for name in FIGURES:
        table[name] = random.normal(100.0, 1.0, count)
        table[error_name(name)] = np.full(count, 0.5)
    return table


def test_a_marker_is_the_mean_over_all_points_with_one_value():
    table = table_of(GRID)
    found = np.array(list(marginal_means(GRID, table, "weight_on_bit", "contact_force_mean")))
    for at, mean, half in found:
        values = table["contact_force_mean"][table["weight_on_bit"] == at]
        assert mean == pytest.approx(values.mean())
        error = values.std(ddof=1) / np.sqrt(len(values))
        assert half == pytest.approx(stats.t.ppf(0.975, len(values) - 1) * error)
    plot = point_plots(GRID, table)["weight_on_bit"][list(FIGURES).index("contact_force_mean")]
    means = plot.layers[-1]
    assert np.array_equal([means.x, means.y], found.T[:2])
    assert np.allclose(means.high - means.low, 2.0 * found.T[2])
    assert plot.x.log
    assert f"{found[:, 1].min():.4g} at" in plot.alt


def test_choices_stand_side_by_side_by_their_words():
    plots = point_plots(GRID, table_of(GRID))["contact_model"]
    assert len(plots) == len(FIGURES)
    assert plots[0].x.categories == ("printed", "rayleigh")
    assert not plots[0].layers[-1].joined
    assert sorted(set(plots[0].layers[0].x)) == [0.0, 1.0]


def test_a_figure_that_no_point_has_is_said_to_be_missing():
    table = table_of(GRID)
    table["contact_force_mean"][:] = np.nan
    plot = point_plots(GRID, table)["weight_on_bit"][list(FIGURES).index("contact_force_mean")]
    assert plot.alt == "No point has this figure."
    assert "<td>–</td>" in sweep_page(GRID, table, 24)


def test_the_page_has_all_plots_the_design_and_failures():
    table = table_of(GRID)
    page = sweep_page(GRID, table, 3)
    assert len(re.findall(r'<figure class="plot" data-plot="plot-\d+"', page)) == 2 * len(FIGURES)
    assert "3 simulations have no figures" in page
    assert "5 to 40, 3 values, logarithmic" in page
    assert "have no figures" not in sweep_page(GRID, table, 0)


def test_a_long_table_ends_and_says_so(monkeypatch):
    monkeypatch.setattr(sweep_report, "_MOST_ROWS", 4)
    page = sweep_page(GRID, table_of(GRID), 0)
    assert "The first 4 of 6 points" in re.sub(r"\s+", " ", page)
    assert len(re.findall("<tr><td>", page.partition("standard errors after")[2])) == 4


def test_many_points_leave_a_page_small():
    force = {"minimum": 5, "maximum": 40, "points": 100}
    swept = {"weight_on_bit": force, "gravity": [0.1 * i for i in range(100)]}
    wide = parse_specification({"design": "grid", "duration": 0.5, "swept": swept})
    page = sweep_page(wide, table_of(wide), 0)
    assert len(page.encode()) < 6_000_000
