"""The folder of a sweep: kept, completed, and never mixed up with another."""

import json

import pyarrow.parquet as pq
import pytest
from plain_values import parse_specification

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation.metrics import METRICS
from rpud_sim.simulation.plan import initial_phases
from rpud_sim.studies.sweep.sweep import (
    SweepFolder,
    design_points,
    make_chunks,
    make_manifest,
    simulate,
)

CONTENT = {
    "design": "grid",
    "repeat": 3,
    "duration": 5.0,
    "swept": {"weight_on_bit": [5.0, 10.0], "contact_model": ["printed", "rayleigh"]},
}


def sweep(**entries):
    return parse_specification(CONTENT | entries)


@pytest.fixture(scope="module")
def outcomes():
    specification = sweep()
    made = make_chunks(specification, design_points(specification))
    return [(chunk, simulate(chunk)) for chunk in made]


@pytest.fixture
def folder(tmp_path):
    folder = SweepFolder(tmp_path / "a" / "sweep", sweep())
    with folder.held():
        yield folder


def test_chunks_in_any_order_make_the_same_tables(folder, outcomes, tmp_path):
    other = SweepFolder(tmp_path / "other", sweep())
    assert len(outcomes) > 3
    with other.held():
        for kept, order in ((folder, outcomes), (other, outcomes[::-1])):
            assert not kept.complete
            for chunk, outcome in order:
                kept.add(chunk, outcome)
            kept.complete_tables()
            assert kept.complete
    for name in ("simulations.parquet", "points.parquet", "manifest.json"):
        assert (folder.path / name).read_bytes() == (other.path / name).read_bytes()
    assert {path.name for path in folder.path.iterdir()} == {
        "simulations.parquet",
        "points.parquet",
        "manifest.json",
    }


@pytest.mark.parametrize("together", [1, 2, 3])
def test_the_tables_are_what_any_reader_of_parquet_sees(folder, outcomes, monkeypatch, together):
    monkeypatch.setattr("rpud_sim.studies.sweep.sweep._TOGETHER", together)  # chunks written
    for chunk, outcome in outcomes:
        folder.add(chunk, outcome)
    folder.complete_tables()
    rows = pq.read_table(folder.path / "simulations.parquet").to_pylist()
    assert [(row["point"], row["member"]) for row in rows] == [
        (point, member) for point in range(4) for member in range(3)
    ]
    assert [row["contact_model"] for row in rows[::3]] == ["printed", "rayleigh"] * 2
    assert [row["weight_on_bit"] for row in rows[::3]] == [5.0, 5.0, 10.0, 10.0]
    assert set(METRICS) < rows[0].keys()
    for first in range(0, 12, 3):
        phases = initial_phases(3, rows[first]["seed"])
        assert [row["phase"] for row in rows[first : first + 3]] == [*phases]
    points = pq.read_table(folder.path / "points.parquet").to_pylist()
    assert [row["point"] for row in points] == [0, 1, 2, 3]
    assert folder.failures() == 0


def test_finished_chunks_are_kept_and_torn_ones_are_not(folder, outcomes):
    for chunk, outcome in outcomes[:3]:
        folder.add(chunk, outcome)
    assert [folder.has(chunk) for chunk, _ in outcomes[:4]] == [True, True, True, False]
    torn = sorted((folder.path / "chunks").iterdir())[1]
    torn.write_bytes(torn.read_bytes()[:-20])
    assert [folder.has(chunk) for chunk, _ in outcomes[:3]] == [True, False, True]


def test_the_manifest_is_the_same_on_every_host_and_for_every_way_to_write_a_sweep():
    assert make_manifest(sweep()) == make_manifest(sweep(seed=0, fixed={}))
    assert {"numba", "scipy", "pyarrow", "sources"} < make_manifest(sweep())["versions"].keys()
    assert make_manifest(sweep())["sha256"] != make_manifest(sweep(seed=1))["sha256"]


def test_a_folder_in_use_is_refused(folder):
    with (
        pytest.raises(ParameterError, match="another rpud sweep is at work there"),
        SweepFolder(folder.path, sweep()).held(),
    ):
        pass


MANIFEST = json.dumps(make_manifest(sweep()))


@pytest.mark.parametrize(
    ("name", "text", "entries", "complaint"),
    [
        ("thesis.tex", "x", {}, "is not empty and holds no sweep"),
        ("manifest.json", "{", {}, "is no manifest of a sweep"),
        (
            *("manifest.json", MANIFEST, {"seed": 1}),
            r"another sweep: specification\.seed is 0 there and 1 here; choose another --out$",
        ),
        (
            *("manifest.json", MANIFEST, {"fixed": {"gravity": 1.62}}),
            r"specification\.fixed\.gravity is null there and 1\.62 here",
        ),
    ],
)
def test_a_folder_with_anything_else_is_left_alone(tmp_path, name, text, entries, complaint):
    (tmp_path / name).write_text(text)
    with (
        pytest.raises(ParameterError, match=complaint) as caught,
        SweepFolder(tmp_path, sweep(**entries)).held(),
    ):
        pass
    assert "\n" not in str(caught.value)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, text)]
