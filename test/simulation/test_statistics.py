"""Figures of a run are those of its trajectory, however it was cut into blocks."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import examples

from rpud_sim.model.segment import IMPACT, join_records
from rpud_sim.simulation import preset
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.sampling import Times, sample
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import FIGURES, Statistics

SECOND = 1_000_000_000
END = SECOND // 2


def figures(blocks):
    statistics = Statistics()
    for block in blocks:
        statistics.add(block)
    return statistics.figures()


@settings(max_examples=examples(40))
@given(
    st.sampled_from(["free", "drilling"]),
    st.lists(st.integers(0, END), max_size=30),
    st.dictionaries(st.integers(0, END), st.floats(0.0, 50.0).map(WeightOnBit), max_size=3),
)
def test_one_block_or_many_give_the_same(regime, stops, commands):
    def run(times):
        simulation = Simulation(preset(regime))
        for time in sorted({*times, *commands, END}):
            yield simulation.advance_to(time)
            if time in commands:
                simulation.apply(commands[time])

    few, many = figures(run([])), figures(run(stops))
    assert many.pop("events") == few.pop("events")
    for name, value in few.items():
        # Integrals over parts of a segment are rounded, and so is their difference to its whole.
        tolerance = 1e-9 if name == "energy_absorbed_rate" else 1e-12
        assert many[name] == pytest.approx(value, rel=tolerance), name


@pytest.fixture(scope="module", params=["free", "drilling"])
def block(request):
    return Simulation(preset(request.param)).advance_to(END)


def test_figures_are_those_of_events_and_impacts(block):
    found, impacts = figures([block]), block.impacts
    event = np.append(block.segments["event"], block.open_segment["event"])
    assert found["duration"] == 0.5
    assert found["events"] == np.count_nonzero(event & 7)
    assert found["actuator_impact_rate"] == np.count_nonzero(event & 1) / 0.5
    # An impact counts when its contact has ended.
    assert np.count_nonzero(event & 2) - len(impacts) in (0, 1)
    assert found["drill_tool_impact_rate"] == len(impacts) / 0.5
    assert found["squeezed_impact_rate"] == impacts["squeezed"].sum() / 0.5
    assert found["contact_force_max"] == impacts["peak_force"].max()
    for name, column in (
        ("impact_velocity_mean", "impact_velocity"),
        ("contact_force_mean", "peak_force"),
        ("contact_duration_mean", "contact_duration"),
    ):
        assert found[name] == pytest.approx(impacts[column].mean())
    for name, column in (
        ("kinetic_energy_rate", "energy"),
        ("energy_transferred_rate", "energy_transferred"),
    ):
        assert found[name] == pytest.approx(impacts[column].sum() / 0.5)


def with_impacts(block, forces):
    impacts = np.zeros(len(forces), IMPACT)
    impacts["peak_force"] = forces
    return dataclasses.replace(block, impacts=join_records([impacts], IMPACT))


@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=300))
def test_a_quantile_is_that_of_all_forces_however_they_are_counted(quiet_block, forces):
    whole, parts = Statistics(), [Statistics(), Statistics()]
    whole.add(with_impacts(quiet_block, forces))
    parts[0].add(with_impacts(quiet_block, forces[::2]))
    parts[1].add(with_impacts(quiet_block, forces[1::2]))
    found = whole.figures()["contact_force_p99"]
    exact = np.quantile(forces, 0.99, method="inverted_cdf")
    assert found == pytest.approx(exact, rel=1.2e-3, abs=1e-6)
    parts[0].merge(parts[1])
    assert parts[0].figures()["contact_force_p99"] == found


@pytest.fixture(scope="module")
def quiet_block():
    return Simulation(preset("drilling")).advance_to(SECOND // 1000)


def test_the_mean_reacting_force_of_a_part_is_that_of_the_part():
    simulation = Simulation(preset("drilling"))
    simulation.advance_to(END)
    simulation.apply(WeightOnBit(40.0))
    part = simulation.advance_to(END + SECOND // 100)
    segments = np.concatenate([part.segments, part.open_segment])
    count = 20_000_000
    times = Times.from_grid(count // 2, count // 100 + 1, count)
    force = sample(segments, times).reacting_force
    mean = (force.sum() - (force[0] + force[-1]) / 2) / (len(force) - 1)
    assert figures([part])["reacting_force_mean"] == pytest.approx(mean, rel=1e-5)


def test_nothing_to_average_is_none_and_not_zero():
    nothing = Statistics().figures()
    assert nothing == {"duration": 0.0, **dict.fromkeys(FIGURES), "events": 0}
    quiet = Simulation(Configuration(preset("drilling"), drive_enabled=False))
    quiet.advance_to(5 * SECOND)
    found = figures([quiet.advance_to(6 * SECOND)])
    assert found["events"] == found["drill_tool_impact_rate"] == found["kinetic_energy_rate"] == 0
    assert found["contact_force_mean"] is found["contact_force_max"] is None
    # Preload less the spring's deflection, which is that of the drill tool under load: tiny.
    assert found["reacting_force_mean"] == pytest.approx(8.0, rel=1e-3)


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_the_reacting_force_is_the_impulse_of_the_collisions(regime):
    """What the tool receives in a long run, less the weight of the free mass, the RPUD gives."""
    parameters = preset(regime)
    block = Simulation(parameters).advance_to(60 * SECOND)
    statistics = Statistics()
    statistics.add(block)

    received = float(block.impacts["impulse"].sum()) / 60.0
    expected = received - parameters.free_mass * parameters.gravity
    assert statistics.figures()["reacting_force_mean"] == pytest.approx(expected, rel=0.01)
