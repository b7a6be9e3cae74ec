"""A sensitivity study of the drill: seeded, with noise of its own, and honest about failures."""

import json

import numpy as np
import pytest

from rpud_sim.simulation import preset
from rpud_sim.simulation.ensemble import run_ensemble
from rpud_sim.studies.sensitivity.sensitivity import FIGURES, PHASE, run_sensitivity
from rpud_sim.studies.sensitivity.specification import SensitivityError, parse_specification

STUDY = {
    "samples": 16,
    "settling": 0.0,
    "duration": 0.5,
    "inputs": {
        "free_mass": {"minimum": 3e-3, "maximum": 8e-3, "source": "test"},
        "gravity": {"minimum": 9.80, "maximum": 9.82, "source": "test"},
    },
}


@pytest.fixture(scope="module")
def result():
    return run_sensitivity(parse_specification(STUDY))


def test_the_free_mass_explains_the_contact_force_and_gravity_nothing_but_noise(result):
    inputs = result.content()["figures"]["contact_force_mean"]["inputs"]
    assert list(inputs) == ["free_mass", "gravity", PHASE]
    assert inputs["free_mass"]["total"] > 0.8
    assert inputs["gravity"]["total"] < 0.15


def test_the_noise_share_is_the_total_index_of_the_initial_phase(result):
    for figure in result.content()["figures"].values():
        assert figure["noise_share"] == figure["inputs"][PHASE]["total"]
        assert figure["noise_share"] >= 0.0


def test_the_distribution_is_that_of_the_independent_points(result):
    assert result.values.shape == (32, len(FIGURES))
    figure = result.content()["figures"]["drill_tool_impact_rate"]
    low, high = figure["interval_90"]
    assert low < figure["mean"] < high


def test_the_same_seed_gives_the_same_numbers(result):
    again = run_sensitivity(parse_specification(STUDY))
    assert json.dumps(again.content()) == json.dumps(result.content())


def test_the_figures_are_those_of_simulate():
    narrow = {"minimum": 5e-3, "maximum": 5e-3 * (1 + 1e-15), "source": "test"}
    study = run_sensitivity(
        parse_specification(STUDY | {"samples": 2, "inputs": {"free_mass": narrow}})
    )
    found = study.values[:, list(FIGURES).index("drill_tool_impact_rate")].mean()
    mean = run_ensemble(preset("drilling"), 0.5, np.linspace(0.0, 0.9, 10).tolist()).mean()
    assert found == pytest.approx(mean["drill_tool_impact_rate"], rel=0.1)


def test_a_point_without_an_impact_ends_the_study_with_its_reason():
    still = STUDY | {"fixed": {"vibration_amplitude": 0.0}}
    with pytest.raises(SensitivityError, match=r"^a point has no impact within 0\.5 s: "):
        run_sensitivity(parse_specification(still))


def test_a_drill_beyond_the_event_budget_ends_the_study_with_its_reason():
    # Before drilling the budget goes to events, which takes a tenth of the time of searches.
    free = {"fixed": {"regime": "free"}, "samples": 2}
    light = {"inputs": {"free_mass": {"minimum": 1e-11, "maximum": 2e-11, "source": "test"}}}
    with pytest.raises(SensitivityError, match="events exceed their budget"):
        run_sensitivity(parse_specification(STUDY | free | light))
