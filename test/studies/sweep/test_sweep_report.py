"""Plots and page of a sweep: means with intervals."""

import numpy as np
import pytest
from plain_values import parse_specification
from scipy import stats

from rpud_sim.foundation.shown_quantities import number_text
from rpud_sim.simulation.metrics import METRICS
from rpud_sim.studies.sweep.specification import error_name
from rpud_sim.studies.sweep.sweep_report import (
    marginal_means,
    point_picture,
    sweep_page,
)

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
    for name in METRICS:
        table[name] = random.normal(100.0, 1.0, count)
        table[error_name(name)] = np.full(count, 0.5)
    return table


def picture_of(table, name, figure="contact_force_mean"):
    return point_picture(GRID, table, name, figure)


def test_a_marker_is_the_mean_over_all_points_with_one_value():
    table = table_of(GRID)
    found = np.array(list(marginal_means(GRID, table, "weight_on_bit", "contact_force_mean")))
    for at, mean, half in found:
        values = table["contact_force_mean"][table["weight_on_bit"] == at]
        assert mean == pytest.approx(values.mean())
        error = values.std(ddof=1) / np.sqrt(len(values))
        assert half == pytest.approx(stats.t.ppf(0.975, len(values) - 1) * error)
    drawn = picture_of(table, "weight_on_bit")
    assert drawn.title == "contact force mean [kN] by weight on bit"
    assert "weight on bit [N]" in drawn.content
    least = table["contact_force_mean"].min()  # of one point for each colour
    assert drawn.alt.startswith(f"Mean from {number_text(1e-3 * least)} kN to ")


def test_the_second_factor_has_colours_that_a_mean_would_hide():
    table = table_of(GRID)
    table["contact_force_mean"] = np.where(table["contact_model"] == "printed", 100.0, 10.0)
    drawn = picture_of(table, "weight_on_bit")
    assert drawn.alt == "Mean from 0.01 kN to 0.1 kN."
    for number, word in enumerate(("printed", "rayleigh")):
        assert word in drawn.content
        assert f"var(--series{number})" in drawn.content


def test_many_points_leave_a_page_small():
    force = {"minimum": 5, "maximum": 40, "points": 100}
    swept = {"weight_on_bit": force, "gravity": [0.1 * i for i in range(100)]}
    wide = parse_specification({"design": "grid", "duration": 0.5, "swept": swept})
    page = sweep_page(wide, table_of(wide), 0)
    assert len(page.encode()) < 1_100_000
