"""Chunks: every simulation once, and each the one that `rpud simulate` would run."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.simulation import preset
from rpud_sim.simulation.ensemble import run_ensemble
from rpud_sim.simulation.simulation import initial_phases
from rpud_sim.simulation.statistics import FIGURES
from rpud_sim.studies.sweep.chunks import (
    SweepChunk,
    chunk_count,
    chunk_size,
    design_points,
    make_chunks,
    simulate,
)
from rpud_sim.studies.sweep.specification_file import parse_specification
from rpud_sim.studies.sweep.sweep import point_table, simulation_table
from rpud_sim.studies.sweep.sweep_page import error_name, sweep_page


def sweep(points=3, repeat=2, duration=0.02, **entries):
    return parse_specification(
        {
            "design": "latin_hypercube",
            "points": points,
            "repeat": repeat,
            "duration": duration,
            "swept": {"weight_on_bit": {"minimum": 5.0, "maximum": 15.0}},
        }
        | entries
    )


def chunks_of(specification, **options):
    return list(make_chunks(specification, design_points(specification), **options))


def pieces(specification, size):
    """Cut the sweep into chunks of another size than it would have."""
    (whole,) = chunks_of(specification)
    for number, first in enumerate(range(0, whole.count, size)):
        count = min(size, whole.count - first)
        begin, end = first // specification.repeat, -(-(first + count) // specification.repeat)
        points = {name: values[begin:end] for name, values in whole.points.items()}
        yield SweepChunk(number, first, count, specification, points, whole.versions)


@given(points=st.integers(1, 300), repeat=st.integers(1, 20), duration=st.floats(1e-3, 1e4))
def test_chunks_hold_every_simulation_once_with_its_point(points, repeat, duration):
    specification = sweep(points, repeat, duration)
    size = chunk_size(specification)
    weights = np.arange(points, dtype=float)
    found = []
    for chunk in make_chunks(specification, {"weight_on_bit": weights}):
        assert 1 <= chunk.count <= size <= 3072
        assert chunk.first == chunk.number * size
        held = chunk.points["weight_on_bit"]
        assert held[0] == chunk.first // repeat
        assert held[-1] == (chunk.first + chunk.count - 1) // repeat
        found.append(chunk.count)
    assert sum(found) == points * repeat
    assert len(found) == chunk_count(specification)


def test_a_point_is_the_ensemble_of_its_seed():
    specification = sweep(seed=7)
    (chunk,) = chunks_of(specification)
    outcome = simulate(chunk)
    for point, weight in enumerate(chunk.points["weight_on_bit"].tolist()):
        phases = initial_phases(2, specification.point_seed(point, {}))
        parameters = preset("drilling").replace(weight_on_bit=weight)
        expected = run_ensemble(parameters, 0.02, phases).members
        rows = slice(2 * point, 2 * point + 2)
        assert outcome.phases[rows].tolist() == list(phases)
        for row, member in zip(outcome.figures[rows].tolist(), expected, strict=True):
            assert row == pytest.approx([member[name] for name in FIGURES], rel=0, nan_ok=True)
    assert outcome.failures == (None,) * 6


@pytest.mark.parametrize("size", [1, 3, 4, 5])
def test_the_cut_into_chunks_changes_no_row_and_no_point(size):
    specification = sweep(points=4, repeat=3)
    (whole,) = chunks_of(specification)
    expected = simulation_table(whole, simulate(whole))
    tables = [simulation_table(chunk, simulate(chunk)) for chunk in pieces(specification, size)]
    assert [row for table in tables for row in table.to_pylist()] == expected.to_pylist()


def test_a_simulation_without_impacts_has_nulls_and_no_failure():
    specification = sweep(1, 2, 1e-6, fixed={"vibration_amplitude": 0.0, "gravity": 0.0})
    (chunk,) = chunks_of(specification)
    table = simulation_table(chunk, simulate(chunk))
    rows = table.to_pylist()
    assert [row["contact_force_mean"] for row in rows] == [None, None]
    assert [row["failure"] for row in rows] == [None, None]
    assert [type(row["events"]) for row in rows] == [int, int]
    (point,) = point_table(specification, table).to_pylist()
    assert point["contact_force_mean"] is None
    assert point[error_name("contact_force_mean")] is None


def test_a_point_outside_the_ranges_is_a_failure_of_its_own_alone():
    specification = sweep(points=2, repeat=2)
    (chunk,) = chunks_of(specification)
    weights = np.array([-1.0, 10.0])
    outcome = simulate(dataclasses.replace(chunk, points={"weight_on_bit": weights}))
    reason = "weight_on_bit = -1 N is outside its range [0, 1000] N"
    assert outcome.failures == (reason, reason, None, None)
    assert np.isnan(outcome.figures[:2]).all()
    assert np.isfinite(outcome.figures[2:, 0]).all()


def test_sweeps_of_two_seeds_share_no_simulation():
    specifications = [sweep(points=64, repeat=2, seed=seed) for seed in (0, 1)]
    seeds = [{each.point_seed(n, {}) for n in range(64)} for each in specifications]
    assert [len(each) for each in seeds] == [64, 64]
    assert not seeds[0] & seeds[1]
    weights = [set(design_points(each)["weight_on_bit"].tolist()) for each in specifications]
    assert not weights[0] & weights[1]


def test_points_at_which_every_simulation_fails_have_no_figures():
    specification = sweep(points=2, repeat=2)
    (chunk,) = chunks_of(specification)
    outside = dataclasses.replace(chunk, points={"weight_on_bit": np.array([-1.0, -2.0])})
    table = point_table(specification, simulation_table(outside, simulate(outside)))
    assert table["members"].to_pylist() == [0, 0]
    assert table["contact_force_mean"].to_pylist() == [None, None]
    columns = {name: table[name].to_numpy() for name in table.column_names}
    assert "4 simulations have no figures" in sweep_page(specification, columns, 4)
