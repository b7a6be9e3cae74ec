"""The versions in a journal: the engine, and the sources that the bits of a run depend on."""

import shutil
from pathlib import Path

import pytest

import rpud_sim
from rpud_sim.simulation.versions import (
    ENGINE,
    engine_of,
    engine_versions,
    other_engine,
    source_digest,
    version_of,
)

PACKAGE = Path(rpud_sim.__file__).parent


@pytest.fixture
def copy(tmp_path, monkeypatch):
    folder = tmp_path / "rpud_sim"
    shutil.copytree(PACKAGE, folder, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(rpud_sim, "__file__", str(folder / "__init__.py"))
    return folder


@pytest.mark.parametrize(
    "source",
    [
        "model/segment.py",
        "drilling/rotor.py",
        "simulation/actuator.py",
        "foundation/quantities.py",
    ],
)
def test_a_change_of_a_source_changes_the_digest(copy, source):
    before = source_digest()
    path = copy / source
    path.write_text(path.read_text() + "\n")
    assert source_digest() != before


def test_a_change_of_a_reader_of_bags_does_not(copy):
    before = source_digest()
    (copy / "bag" / "reader.py").write_text("")
    assert source_digest() == before


def test_the_versions_are_texts():
    versions = engine_versions()
    assert {"rpud_sim", "sources", "python", "numpy", "numba", "machine"} <= {*versions}
    assert all(isinstance(version, str) and version for version in versions.values())
    assert versions["sources"] == source_digest()
    assert version_of("no_such_package") == "unknown"


@pytest.mark.parametrize(
    ("beginning", "reason"),
    [
        ({"engine": ENGINE}, ""),
        (
            {"physics": 3, "made_by": {"rpud_sim": "0.2.0"}},
            f"made by engine 3 of rpud_sim 0.2.0; this is engine {ENGINE}: "
            "rpud_sim 0.2.0 proves it",
        ),
        (
            {"made_by": {"rpud_sim": "0.1.0"}},
            f"made by engine 1 of rpud_sim 0.1.0; this is engine {ENGINE}: "
            "rpud_sim 0.1.0 proves it",
        ),
        (
            {"engine": ENGINE + 1, "made_by": {"rpud_sim": "9.0"}},
            f"made by engine {ENGINE + 1} of rpud_sim 9.0; this is engine {ENGINE}: "
            "rpud_sim 9.0 proves it",
        ),
        (
            {"physics": 2},
            f"made by engine 2, of no release; this is engine {ENGINE}: no release proves it",
        ),
    ],
)
def test_a_run_of_another_engine_names_the_release_that_proves_it(beginning, reason):
    assert other_engine(beginning) == reason


@pytest.mark.parametrize("stranger", [None, [], {"engine": None}, {"engine": [], "made_by": 1}])
def test_what_a_stranger_wrote_is_another_engine(stranger):
    assert engine_of(stranger) != ENGINE
    assert "proves it" in other_engine(stranger)
