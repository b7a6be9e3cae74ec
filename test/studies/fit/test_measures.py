"""Measures: the figures of `rpud simulate` and of the paper's windows, over any window."""

import math

import numpy as np
import pytest

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.contact import single_contact
from rpud_sim.simulation import Simulation, preset
from rpud_sim.simulation.configuration import Configuration, to_configuration
from rpud_sim.simulation.ensemble import run_ensemble
from rpud_sim.simulation.metrics import METRICS
from rpud_sim.simulation.sampling import Times
from rpud_sim.studies.fit.measures import (
    DRILLING_FIGURES,
    UNITS,
    Measure,
    measure,
)

DRILL = Configuration(preset("drilling"))
ROTATING = to_configuration(
    {
        "regime": "drilling",
        "actuator_model": "resonance",
        "rock_model": "specific_energy",
        "rotation_model": "friction_drive",
    }
)


def test_the_figures_of_a_whole_run_are_those_of_simulate():
    expected = run_ensemble(DRILL, 2.0, [0.25]).members[0].figures
    found = measure(DRILL, 0.25, [Measure(name, 0.0, 2.0) for name in METRICS])
    assert dict(zip(METRICS, found, strict=True)) == pytest.approx(
        {name: expected[name] for name in METRICS}, rel=1e-12
    )


def test_the_figures_of_the_papers_windows_are_those_of_the_trajectory():
    measures = {
        "contact_force_low": Measure("peak_force", 0.0, 0.6, 0.05),
        "contact_force_max": Measure("contact_force_max", 0.0, 0.6),
        "kinetic_energy": Measure("kinetic_energy", 0.0, 0.6),
        "nodal_plane_displacement": Measure("nodal_plane_displacement", 0.0, 0.6),
        "drill_tool_displacement": Measure("drill_tool_displacement", 0.0, 0.6),
    }
    block = Simulation(DRILL.parameters, 0.05).advance_to(round(0.6 * SECOND))
    forces = block.impacts["peak_force"]
    samples = block.sample(Times.from_grid(0, 3000, 5000))
    expected = {
        "contact_force_low": np.quantile(forces, 0.05),
        "contact_force_max": forces.max(),
        "kinetic_energy": block.impacts["energy"].sum(),
        "nodal_plane_displacement": np.abs(samples.nodal_plane_position).max(),
        "drill_tool_displacement": np.abs(samples.drill_tool_displacement).max(),
    }
    found = measure(DRILL, 0.05, list(measures.values()))
    assert dict(zip(measures, found, strict=True)) == pytest.approx(expected, rel=1e-9)


def test_penetration_torque_and_powers_are_those_of_the_run():
    [expected] = run_ensemble(ROTATING, 2.0, [0.1]).members
    account, work = expected.account, expected.rotation
    rate, torque, electrical, mechanical, late = measure(
        ROTATING,
        0.1,
        [
            *(Measure(name, 0.0, 2.0) for name in DRILLING_FIGURES),
            Measure("penetration_rate", 1.0, 2.0),
        ],
    )
    assert rate == pytest.approx(expected.figures["penetration_rate"])
    assert electrical == pytest.approx(account.electrical / 2.0)
    assert mechanical == pytest.approx(account.actuator_work / 2.0)
    simulation = Simulation(ROTATING, 0.1)
    turned = simulation.advance_to(2 * SECOND).process.rotation.angle
    assert torque == pytest.approx(work.resisted / turned, rel=0.05)
    depth = [run_ensemble(ROTATING, end, [0.1]).members[0].figures["depth"] for end in (1.0, 2.0)]
    assert late == pytest.approx(depth[1] - depth[0])


def test_a_single_contact_needs_no_run():
    expected = single_contact(DRILL.parameters, 3.0)
    found = measure(
        DRILL,
        0.0,
        [
            Measure("contact_peak_force", 0.0, 0.0, impact_velocity=3.0),
            Measure("contact_peak_displacement", 0.0, 0.0, impact_velocity=3.0),
        ],
    )
    assert found == [expected.peak_force, expected.peak_displacement]


def test_a_figure_that_a_run_cannot_have_is_missing():
    still = Configuration(preset("drilling").replace(vibration_amplitude=0.0))
    found = measure(still, 0.0, [Measure("peak_force", 0.1, 0.2)])
    assert math.isnan(found[0])


@pytest.mark.parametrize("figure", UNITS)
def test_every_figure_can_be_measured(figure):
    item = Measure(figure, 0.0, 0.1)
    assert math.isfinite(measure(ROTATING, 0.0, [item])[0])
    assert figure in str(item)
