"""The parts of the reproduction, each on a case that is known."""

import dataclasses

import numpy as np
import pytest

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.parameters import CONTACT_MODELS
from rpud_sim.simulation import preset
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics
from rpud_sim.studies.reproduction.jobs import gather, silent
from rpud_sim.studies.reproduction.paper_numbers import NUMBERS
from rpud_sim.studies.reproduction.parameter_studies import OUTPUTS, Study, find_trends, holm
from rpud_sim.studies.reproduction.readings import (
    Fit,
    Reading,
    Value,
    all_readings,
    not_reproduced,
)
from rpud_sim.studies.reproduction.reproduction import figure_12_implies
from rpud_sim.studies.reproduction.single_contact import contact_history, single_contact
from rpud_sim.studies.reproduction.windows import run_windows


def study(*slopes, noise=0.01, seed=0):
    """A study in which each output follows its slope from 1 on, with noise."""
    values = np.linspace(0.0, 1.0, 9)
    random = np.random.default_rng(seed)
    members = {
        output: 1.0 + slope * values[:, None] + noise * random.standard_normal((9, 12))
        for output, slope in zip(OUTPUTS, slopes, strict=True)
    }
    return Study("free_mass", values, members)


def test_a_trend_rises_falls_or_is_flat():
    trends = find_trends([study(0.5, -0.5, 0.0, 0.02)])

    assert [trend.verdict for trend in trends] == ["rises", "falls", "flat", "flat"]
    assert trends[3].p_value < 0.05, "a change of 2 % is significant here, and little"
    assert trends[0].change == pytest.approx(0.5 / 1.25, abs=0.02)


def test_noise_alone_is_seldom_a_trend():
    noisy = [study(0.0, 0.0, 0.0, 0.0, noise=0.5, seed=seed) for seed in range(40)]
    verdicts = [trend.verdict for case in noisy for trend in find_trends([case])]

    assert sum(verdict != "flat" for verdict in verdicts) <= 5


def test_a_trend_that_turns_back_is_marked():
    case = study(0.5, 0.5, 0.5, 0.5)
    case.members[OUTPUTS[0]][4] += 1.0

    assert [trend.turns for trend in find_trends([case])] == [True, False, False, False]


def test_stalled_members_are_left_out_of_a_study():
    case = study(0.5, 0.5, 0.5, 0.5)
    case.members[OUTPUTS[0]][2, :3] = np.nan

    assert np.isfinite(case.mean(OUTPUTS[0])).all()
    assert find_trends([case])[0].verdict == "rises"


def test_holm_is_no_less_strict_than_each_test_and_no_stricter_than_bonferroni():
    p_values = [0.04, 0.001, 0.02, 0.5]

    assert holm(p_values) == pytest.approx([0.08, 0.004, 0.06, 0.5])


def test_readings_are_the_full_product():
    readings = all_readings()

    assert len(readings) == len(set(readings)) == 2 * 7 * 2 * 2 * 2
    assert {reading.parameters("free").weight_on_bit for reading in readings} == {0.0}


def test_a_number_that_no_reading_reproduces_is_named():
    reading = all_readings()[0]
    values = {number.key: Value(number.paper, 0.0, 0.0, 0.0) for number in NUMBERS}
    values["contact_peak_force"] = Value(1650.0 * 1.11, 0.0, 0.0, 0.0)
    fit = Fit(reading, values, 0.0, (0.0, 0.0), 0.0, 0.0, 0)

    assert [entry["key"] for entry in not_reproduced([fit])] == ["contact_peak_force"]
    assert fit.near == len(NUMBERS) - 1
    other = dataclasses.replace(
        fit, values={**values, "contact_peak_force": Value(1650.0 * 1.09, 0.0, 0.0, 0.0)}
    )
    assert not_reproduced([fit, other]) == []


def test_windows_of_the_presets_are_what_they_were():
    members = run_windows(preset("drilling"), np.linspace(-0.1, 0.1, 12))
    means = {name: column.mean() for name, column in members.values.items()}

    assert members.stalled == 0
    assert means["drill_tool_impact_rate"] == pytest.approx(380.0, rel=0.1)
    assert means["kinetic_energy"] == pytest.approx(0.6 * 59.5, rel=0.1)
    assert means["reacting_force_mean"] == pytest.approx(20.5, rel=0.05)


def test_the_papers_mean_reacting_force_has_no_weight_on_bit_behind_it():
    members = run_windows(preset("drilling").replace(weight_on_bit=0.0), np.linspace(-0.1, 0.1, 12))

    assert members.values["reacting_force_mean"].mean() == pytest.approx(14.0, rel=0.05)


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_the_reacting_force_is_the_impulse_of_the_collisions(regime):
    """What the tool receives in a long run, less the weight of the free mass, the RPUD gives."""
    parameters = preset(regime)
    simulation = Simulation(parameters)
    block = simulation.advance_to(60 * SECOND)
    statistics = Statistics()
    statistics.add(block)

    received = float(block.impacts["impulse"].sum()) / 60.0
    expected = received - parameters.free_mass * parameters.gravity
    assert statistics.figures()["reacting_force_mean"] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("model", CONTACT_MODELS)
def test_an_undisturbed_impact_of_the_engine_is_a_single_contact(model):
    """Eqs. (36)-(39) against what the engine does with the same blow."""
    parameters = preset("drilling").replace(contact_model=model, gravity=0.0)
    # The first one is the start, with the actuator upon the free mass.
    impacts = Simulation(parameters).advance_to(5 * SECOND).impacts[1:]
    contacts = [single_contact(parameters, float(v)) for v in impacts["impact_velocity"]]
    durations = np.array([contact.duration for contact in contacts])
    undisturbed = np.abs(impacts["contact_duration"] / durations - 1.0) < 1e-6

    assert np.count_nonzero(undisturbed) > 0.5 * len(impacts)
    forces = np.array([contact.peak_force for contact in contacts])[undisturbed]
    np.testing.assert_allclose(impacts["peak_force"][undisturbed], forces, rtol=1e-6)


def test_a_contact_begins_and_ends_at_rest_and_peaks_as_it_says():
    parameters = preset("drilling")
    contact = single_contact(parameters, 5.0)
    displacement, force = contact_history(parameters, 5.0, np.linspace(0.0, contact.duration, 1001))

    assert displacement[[0, -1]] == pytest.approx(0.0, abs=1e-12)
    assert displacement.max() == pytest.approx(contact.peak_displacement, rel=1e-5)
    assert force.max() == pytest.approx(contact.peak_force, rel=1e-5)


def test_the_tool_that_figure_12_implies_gives_figure_12():
    implied = figure_12_implies()
    free_mass = 5e-3
    rate = np.sqrt(implied["tool_spring_rate"] / (free_mass + implied["tool_mass"]))
    velocity = 5.0 * free_mass / (free_mass + implied["tool_mass"])

    assert velocity / rate == pytest.approx(42e-6)
    assert free_mass * rate * velocity == pytest.approx(1650.0)


def test_work_keeps_its_order_and_its_errors():
    assert gather(lambda number: number**2, range(50), "", silent) == [n**2 for n in range(50)]
    with pytest.raises(ZeroDivisionError):
        gather(lambda number: 1 / number, [1, 0], "", silent)


def test_a_reading_names_only_what_matters():
    reading = Reading(17.5e-6, 10.0, 1.96e11, "rayleigh", "both")

    assert reading.describe("contact") == "E = 1.96e+11 Pa, rayleigh contact"
    assert "W = 10 N" not in reading.describe("free")
