"""Designs and chunks: points as each kind promises, and every simulation once, as alone."""

import dataclasses
import itertools
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plain_values import parse_specification

from rpud_sim.foundation.yaml_files import open_yaml
from rpud_sim.simulation import preset
from rpud_sim.simulation.ensemble import run_ensemble
from rpud_sim.simulation.metrics import METRICS
from rpud_sim.simulation.plan import initial_phases
from rpud_sim.studies.sweep.specification_file import read_specification
from rpud_sim.studies.sweep.sweep import (
    chunk_count,
    design_points,
    make_chunks,
    point_table,
    run_sweep,
    simulate,
)
from rpud_sim.studies.sweep.sweep_report import sweep_page


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


def chunks_of(specification):
    return list(make_chunks(specification, design_points(specification)))


@given(points=st.integers(1, 300), repeat=st.integers(1, 20), duration=st.floats(1e-3, 1e4))
def test_chunks_hold_every_point_once(points, repeat, duration):
    specification = sweep(points, repeat, duration)
    weights = np.arange(points, dtype=float)
    chunks = list(make_chunks(specification, {"weight_on_bit": weights}))
    held = np.concatenate([chunk.points["weight_on_bit"] for chunk in chunks])
    assert held.tolist() == weights.tolist()
    assert [chunk.first for chunk in chunks] == [c.points["weight_on_bit"][0] for c in chunks]
    assert sum(chunk.count for chunk in chunks) == points * repeat
    assert len(chunks) == chunk_count(specification)


def test_a_point_is_the_ensemble_of_its_seed():
    specification = sweep(seed=7)
    (chunk,) = chunks_of(specification)
    table = simulate(chunk).table
    for point, weight in enumerate(chunk.points["weight_on_bit"].tolist()):
        phases = initial_phases(2, specification.point_seed(point, {}))
        parameters = preset("drilling").replace(weight_on_bit=weight)
        expected = run_ensemble(parameters, 0.02, phases).members
        rows = table.slice(2 * point, 2).to_pylist()
        assert [row["phase"] for row in rows] == list(phases)
        for row, member in zip(rows, expected, strict=True):
            assert [row[name] for name in METRICS] == pytest.approx(
                [member.figures[name] for name in METRICS], rel=0, nan_ok=True
            )
    assert table["failure"].to_pylist() == [None] * 6


def test_a_point_outside_the_ranges_is_a_failure_of_its_own_alone():
    specification = sweep(points=2, repeat=2)
    (chunk,) = chunks_of(specification)
    chunk = dataclasses.replace(chunk, points={"weight_on_bit": np.array([-1.0, 10.0])})
    simulated = simulate(chunk).table
    reason = "weight_on_bit = -1 N is outside its range [0, 1000] N"
    assert simulated["failure"].to_pylist() == [reason, reason, None, None]
    assert [simulated[name][1].as_py() for name in METRICS] == [None] * len(METRICS)
    table = point_table(specification, simulated)
    assert table["members"].to_pylist() == [0, 2]
    assert table["contact_force_mean"].is_null().to_pylist() == [True, False]
    columns = {name: table[name].to_numpy() for name in table.column_names}
    assert "2 simulations have no figures" in sweep_page(specification, columns, 2)


SWEPT = {
    "weight_on_bit": {"minimum": 0.0, "maximum": 32.0},
    "free_mass": {"minimum": 1e-3, "maximum": 1e-2, "scale": "log"},
    "contact_model": ["printed", "rayleigh"],
}


def points(design, number, seed=0):
    return design_points(
        parse_specification(
            {"design": design, "points": number, "seed": seed, "duration": 1, "swept": SWEPT}
        )
    )


@given(exponent=st.integers(1, 8), seed=st.integers(0, 2**32), latin=st.booleans())
def test_every_stratum_of_every_parameter_has_one_point(exponent, seed, latin):
    number = 2**exponent
    found = points("latin_hypercube" if latin else "sobol", number, seed)
    shares = {
        "weight_on_bit": found["weight_on_bit"] / 32.0,
        "free_mass": np.log10(found["free_mass"] / 1e-3),
    }
    for name, share in shares.items():
        strata = np.floor(share * number + 1e-9).astype(int)
        assert sorted(strata) == list(range(number)), name
    assert Counter(found["contact_model"].tolist()) == {
        "printed": number // 2,
        "rayleigh": number // 2,
    }


CONFIG = Path(__file__).parents[3] / "config"


@pytest.mark.extended
@pytest.mark.parametrize(
    ("name", "simulations"),
    [
        ("sweep", 256),
        ("sweep_faults", 4 * (1 + 18) * 2),
        ("sweep_faults_on_an_arm", 5 * (1 + 13)),
        ("sweep_sensitivity", 256 * (14 + 3)),
    ],
)
def test_an_example_has_its_size_and_runs_at_small_size(name, simulations, tmp_path):
    path = CONFIG / f"{name}.yaml"
    assert read_specification(path).simulations == simulations
    content = open_yaml(path).value
    small = {"points": 2, "duration": 0.4}
    if "faults" in content:
        small |= {
            "onset": {"minimum": 0.1, "maximum": 0.2},
            "lasting": {"minimum": 0.1, "maximum": 0.1},
            "faults": content["faults"][:3],
            "cases": dict(itertools.islice(content["cases"].items(), 2)),
        }
    result = run_sweep(parse_specification(content | small), tmp_path / "out", 1)
    assert (result.simulations > 0, result.failures) == (True, 0)
