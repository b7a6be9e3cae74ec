"""The search for readings: its design, and that it finds what is there."""

import numpy as np
import pytest

from rpud_sim.studies.reproduction import search as module
from rpud_sim.studies.reproduction.choices import IMPLIED, TOOLS
from rpud_sim.studies.reproduction.jobs import silent
from rpud_sim.studies.reproduction.search import (
    AMPLITUDES,
    RESTITUTIONS,
    WEIGHTS,
    design,
    search,
    simulate,
)
from rpud_sim.studies.reproduction.windows import Members


def test_a_design_fills_the_ranges_and_is_the_same_for_a_seed():
    points = np.array(design(64, 3))

    for column, (low, high, _) in zip(points.T, (AMPLITUDES, WEIGHTS, RESTITUTIONS), strict=True):
        assert low <= column.min() < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < column.max() <= high
    assert design(64, 3) == design(64, 3)
    assert design(64, 3) != design(64, 4)


def test_a_refined_design_stays_around_its_centre_and_in_the_ranges():
    points = np.array(design(16, 0, (39e-6, 0.1, 0.99), 0.1))

    for column, (low, high, _), at in zip(
        points.T, (AMPLITUDES, WEIGHTS, RESTITUTIONS), (39e-6, 0.1, 0.99), strict=True
    ):
        assert np.all(np.abs(column - at) <= 0.0501 * (high - low))
        assert low <= column.min()
        assert column.max() <= high


def fake_windows(parameters, phases, long):
    """The paper's numbers at 20 µm, 8 N, e_1 = 0.8, and further off the further away."""
    away = (
        abs(parameters.vibration_amplitude - 20e-6) / 30e-6
        + abs(parameters.actuator_restitution - 0.8) / 0.6
    )
    if parameters.regime == "drilling":
        away += abs(parameters.weight_on_bit - 8.0) / 16.0
    paper = {
        "drill_tool_impact_rate": 470.0 if parameters.regime == "drilling" else 433.3,
        "actuator_impact_rate": 470.0,
        "contact_force_max": 2600.0,
        "contact_force_low": 400.0,
        "contact_force_high": 2200.0,
        "reacting_force_mean": 14.0 if parameters.regime == "drilling" else 5.8,
    }
    columns = {name: np.full(len(phases), value * np.exp(away)) for name, value in paper.items()}
    # Not further off: another meaning of the energy must not make up for what the others miss.
    return Members(columns | {"kinetic_energy": np.full(len(phases), 12.4)}, 0)


def test_a_search_finds_the_best_choices(monkeypatch):
    monkeypatch.setattr(module, "run_windows", fake_windows)
    result = search(16, 16, 2, 0, silent)
    found = {reading.name: reading for reading in result.readings}

    assert len(found) == 2 * len(TOOLS)
    for name in (f"found, {IMPLIED}", f"found with one A and e_1, {IMPLIED}"):
        rock = found[name].rock
        assert rock.tool == IMPLIED
        assert (rock.energy, rock.count) == ("arriving", "one")
        assert rock.vibration_amplitude == pytest.approx(20e-6, abs=4e-6)
        assert rock.actuator_restitution == pytest.approx(0.8, abs=0.12)
        assert rock.weight_on_bit == pytest.approx(8.0, abs=3.0)
    assert all(
        reading.consistent for name, reading in found.items() if name.startswith("found with one")
    )
    assert all(reading.searched for reading in found.values())


def test_a_refinement_is_no_worse_than_the_design_alone(monkeypatch):
    monkeypatch.setattr(module, "run_windows", fake_windows)
    result = search(8, 16, 2, 0, silent)
    _, misfits = result.ridges[IMPLIED]
    rock = next(item.rock for item in result.readings if item.name == f"found, {IMPLIED}")
    away = fake_windows(rock.parameters(), [0.0], 2.0).values["contact_force_max"][0] / 2600.0

    assert np.log(away) * np.sqrt(5 / 8) <= misfits.min() * 1.0001
    assert result.compared > 8 * len(TOOLS)


def test_drills_run_once_with_phases_of_their_own(monkeypatch):
    seen = []

    def note(parameters, phases, long):
        seen.append(tuple(phases))
        return fake_windows(parameters, phases, long)

    monkeypatch.setattr(module, "run_windows", note)
    drill, other = (module.Rock(weight_on_bit=weight).parameters() for weight in (1.0, 2.0))
    windows = simulate([drill, other, drill], 3, 0, "", silent)

    assert set(windows) == {drill, other}
    assert len(set(seen)) == len(seen) == 2
