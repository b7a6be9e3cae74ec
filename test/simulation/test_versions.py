"""The versions in a journal change with every source that the bits of a run depend on."""

import shutil
from pathlib import Path

import pytest

import rpud_sim
from rpud_sim.simulation.versions import (
    PHYSICS,
    engine_and_processor,
    mended_since,
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
    versions = engine_and_processor()
    assert {"rpud_sim", "sources", "numpy", "numba", "processor", "c_library"} <= {*versions}
    assert all(isinstance(version, str) and version for version in versions.values())
    assert versions["sources"] == source_digest()
    assert version_of("no_such_package") == "unknown"


def test_runs_that_have_lost_a_law_cannot_be_computed_again():
    resonant = {"actuator_model": "resonance"}
    assert "mended after version 0.1.0" in mended_since({"parameters": resonant})
    assert "between versions 0.1.0 and 0.2.0" in mended_since({"physics": 2, "parameters": {}})
    assert mended_since({"parameters": {}}) == ""
    assert mended_since({"physics": PHYSICS, "parameters": resonant}) == ""
