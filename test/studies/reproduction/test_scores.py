"""Scores, on values that are known."""

import numpy as np
import pytest

from rpud_sim.studies.reproduction.choices import ENERGIES, Before, Reading, Rock
from rpud_sim.studies.reproduction.paper_numbers import GROUPS, MEASURED, NUMBERS, SIMULATED
from rpud_sim.studies.reproduction.rows import grade
from rpud_sim.studies.reproduction.scores import Fit, Value, fit, not_reproduced
from rpud_sim.studies.reproduction.windows import Members

READING = Reading("", Before(), Rock())


def fit_with(**factors):
    """A fit that gives the paper's numbers, some times a factor."""
    values = {
        number.key: Value(number.paper * factors.get(number.key, 1.0), 0.0, 0.0, 0.0)
        for number in NUMBERS
    }
    return Fit(READING, values, 0.0, (0.0, 0.0), {}, 0)


def test_groups_hold_each_simulated_number_once():
    grouped = [number for group in GROUPS.values() for number in group]

    assert sorted(number.key for number in grouped) == sorted(number.key for number in SIMULATED)
    assert {number.source for number in GROUPS["drilling dynamics"]} == {
        "Fig. 8",
        "Fig. 13",
        "Fig. 14",
    }
    assert {number.source for number in GROUPS["contact"]} == {"Fig. 10", "Fig. 11", "Fig. 12"}
    assert len(SIMULATED) == 10
    assert len(MEASURED) == 3


def test_a_figure_is_close_if_all_of_its_numbers_are():
    assert fit_with().close_figures == 8
    assert fit_with(contact_peak_force=1.14).close_figures == 8
    assert fit_with(contact_peak_force=1.16).close_figures == 7
    both = fit_with(contact_peak_force=1.16, contact_peak_displacement=0.84)
    assert both.close_figures == 7


def test_fits_are_ordered_by_close_figures_then_by_numbers_within_10_percent():
    perfect, near = fit_with(), fit_with(free_impact_rate=1.12)
    off = fit_with(free_impact_rate=2.0)

    assert [item.near() for item in (perfect, near, off)] == [10, 9, 9]
    assert perfect.order < near.order < off.order


def test_a_measured_number_counts_in_no_score_of_the_simulated():
    assert fit_with(measured_reacting_force_mean=3.0).near() == 10
    assert fit_with(measured_reacting_force_mean=3.0).near(MEASURED) == 2


def test_a_number_that_no_reading_reproduces_is_named():
    off = fit_with(contact_peak_force=1.11)
    other = fit_with(contact_peak_force=1.09)

    assert [entry["key"] for entry in not_reproduced([off])] == ["contact_peak_force"]
    assert not_reproduced([off, other]) == []


def members(**values):
    columns = {
        "drill_tool_impact_rate": 470.0,
        "actuator_impact_rate": 30.0,
        "contact_force_max": 2600.0,
        "contact_force_low": 400.0,
        "contact_force_high": 2200.0,
        "kinetic_energy": 12.4,
        "nodal_plane_displacement": 2.6e-3,
        "drill_tool_displacement": 14e-3,
        "reacting_force_mean": 14.0,
    } | values
    return Members({name: np.full(5, value) for name, value in columns.items()}, 0)


def test_a_fit_takes_count_and_energy_from_the_reading():
    reading = Reading("", Before(), Rock(energy="common", count="both"))
    windows = {reading.parameters(regime): members() for regime in ("free", "drilling")}
    result = fit(reading, windows, 0)

    assert result.values["drilling_impact_rate"].mean == pytest.approx(500.0)
    assert result.values["free_impact_rate"].mean == pytest.approx(470.0)
    share = reading.rock.energy_share()
    assert result.values["drilling_kinetic_energy"].mean == pytest.approx(12.4 * share)
    assert set(result.energies()) == set(ENERGIES)
    assert result.energies()["arriving"] == pytest.approx(12.4)
    assert result.energies()["common"] == pytest.approx(12.4 * share)


def test_a_misfit_has_the_weight_of_each_number_once():
    windows = {READING.parameters(regime): members() for regime in ("free", "drilling")}
    result = fit(READING, windows, 0)
    ratios = [result.values[number.key].over(number) for number in SIMULATED]

    assert result.misfit == pytest.approx(np.sqrt(np.mean(np.log(ratios) ** 2)))
    low, high = result.misfit_interval
    assert low == pytest.approx(result.misfit)  # all members are the same
    assert high == pytest.approx(result.misfit)
    assert result.numbers()["near"] == result.near()


@pytest.mark.parametrize(
    ("ratio", "expected"),
    [
        (1.0, "near"), (0.91, "near"), (1.09, "near"), (0.88, "close"), (1.14, "close"),
        (0.8, "low"), (1.3, "high"), (0.5, "far-low"), (15.0, "far-high"),
    ],
)  # fmt: skip
def test_a_grade_says_how_far_and_on_which_side(ratio, expected):
    assert grade(ratio) == expected
