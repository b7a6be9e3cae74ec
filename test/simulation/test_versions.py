"""The versions in a journal: the engine, and the sources that the bits of a run depend on."""

import shutil
from pathlib import Path

import pytest

import rpud_sim
from rpud_sim.simulation import versions
from rpud_sim.simulation.versions import (
    ENGINE,
    engine_of,
    other_engine,
    source_digest,
)


def test_a_change_of_a_source_changes_the_digest(tmp_path, monkeypatch):
    package, before = Path(rpud_sim.__file__).parent, source_digest()
    folder = tmp_path / "rpud_sim"
    shutil.copytree(package, folder, ignore=shutil.ignore_patterns("__pycache__", "compiled"))
    monkeypatch.setattr(versions, "__file__", str(folder / "simulation" / "versions.py"))
    assert source_digest() == before
    (folder / "bag" / "reader.py").write_text("")  # it makes no result
    assert source_digest() == before
    digests = {before}
    for source in ("model/segment", "drilling/rotor", "simulation/run", "foundation/time"):
        path = folder / f"{source}.py"
        path.write_text(path.read_text() + "\n")
        digests.add(source_digest())
    assert len(digests) == 5


@pytest.mark.parametrize(
    ("beginning", "engine", "release"),
    [
        ({"engine": 3, "made_by": {"rpud_sim": "0.2.0"}}, 3, "rpud_sim 0.2.0"),
        ({"engine": 9, "made_by": {"rpud_sim": "9.0"}}, 9, "rpud_sim 9.0"),
        # What a stranger wrote is another engine.
        (None, 0, "rpud_sim of an unknown version"),
        ({"engine": [], "made_by": 1}, [], "rpud_sim of an unknown version"),
    ],
)
def test_a_run_of_another_engine_names_the_release_that_reads_it(beginning, engine, release):
    assert engine_of(beginning) == engine
    expected = f"made by {release}, not by engine {ENGINE}: {release} reads it"
    assert other_engine(beginning) == expected


def test_this_engine_reads_its_runs():
    assert other_engine({"engine": ENGINE}) == ""
