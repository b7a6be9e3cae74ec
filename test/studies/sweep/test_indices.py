"""Sobol indices: those of functions whose indices are known, and those of figures of the drill."""

import numpy as np
import pytest
from plain_values import parse_specification

from rpud_sim.studies.sweep.sweep import design_points, saltelli_shares
from rpud_sim.studies.sweep.sweep_report import figure_indices, find_indices, sweep_page

# Ishigami's function: first and total indices in closed form.
ISHIGAMI = ((0.3139, 0.4424, 0.0), (0.5576, 0.4424, 0.2437))
STUDY = {
    "design": "saltelli",
    "points": 16,
    "duration": 0.5,
    "figures": ["contact_force_mean", "reacting_force_mean"],
    "swept": {
        "free_mass": {"minimum": 3e-3, "maximum": 8e-3},
        "gravity": {"minimum": 9.80, "maximum": 9.82},
    },
}


def ishigami(shares):
    x = np.pi * (2.0 * shares - 1.0)
    return np.sin(x[..., 0]) + 7 * np.sin(x[..., 1]) ** 2 + 0.1 * x[..., 2] ** 4 * np.sin(x[..., 0])


def test_the_indices_of_ishigamis_function_are_the_known_ones():
    found = find_indices(ishigami(saltelli_shares(3, 4096, 1))[..., np.newaxis], 1)
    assert found[0, 0, 0] == pytest.approx((*ISHIGAMI[0], 0.0), abs=0.02)
    assert found[0, 1, 0] == pytest.approx((*ISHIGAMI[1], 0.0), abs=0.02)


def test_noise_adds_its_share_to_every_total_index_and_to_no_first_one():
    shares = saltelli_shares(2, 4096, 3)
    noise = np.random.default_rng(3).normal(0.0, np.sqrt(0.25 / 12.0), shares.shape[:2])
    found = find_indices((shares[..., 0] + noise)[..., np.newaxis], 3)
    assert found[0, 0, 0] == pytest.approx([0.8, 0.0, 0.0], abs=0.04)
    assert found[0, 1, 0] == pytest.approx([1.0, 0.2, 0.2], abs=0.04)


def table_of(specification):
    """Points whose figures are Ishigami's function, not simulated."""
    points = design_points(specification)
    shares = [
        (points[name] - item.minimum) / (item.maximum - item.minimum)
        for name, item in specification.swept.items()
    ]
    count = specification.point_count
    values = ishigami(np.column_stack(shares))
    return points | {
        "point": np.arange(count),
        "members": np.ones(count, int),
        **dict.fromkeys(specification.figures, values),
        **{f"{name}_standard_error": np.full(count, np.nan) for name in specification.figures},
    }


def test_a_point_without_a_figure_costs_the_indices_of_that_figure_alone():
    swept = STUDY["swept"] | {"weight_on_bit": {"minimum": 5, "maximum": 9}}
    specification = parse_specification(
        STUDY | {"swept": swept, "figures": [*STUDY["figures"], "events", "contact_force_p99"]}
    )
    table = table_of(specification)
    for name, number, members in (("contact_force_mean", 7, 1), ("contact_force_p99", 9, 0)):
        table[name] = table[name].copy()
        table[name][number] = np.nan
        table["members"][number] = members
    table["events"] = np.full(96, 3.0)
    found = figure_indices(specification, table)
    reasons = {name: item["missing"] for name, item in found.items() if "missing" in item}
    assert reasons == {
        "contact_force_mean": "1 of 96 points lack it; at point 7 there is nothing to average",
        "contact_force_p99": "1 of 96 points lack it; at point 9 every simulation failed",
        "events": "it is the same at all points",
    }
    assert set(found["reacting_force_mean"]["inputs"]) == set(swept)
    page = sweep_page(specification, table, 0, found)
    assert "contact_force_mean has no indices: 1 of 96 points lack it" in page
    assert "share of the variance" in page
