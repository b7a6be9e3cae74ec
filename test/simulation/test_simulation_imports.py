"""Scripts import the simulation from one place; programs that do not simulate do not load it."""

import inspect
import pathlib
import subprocess
import sys

import pytest

from rpud_sim import simulation

FOLDER = pathlib.Path(simulation.__file__).parent


def test_every_public_name_is_there_and_documented():
    assert len(set(simulation.__all__)) == len(simulation.__all__)
    for name in simulation.__all__:
        value = getattr(simulation, name)
        assert not inspect.ismodule(value), name
        if callable(value):
            assert inspect.getdoc(value), name
            assert value.__module__.startswith("rpud_sim."), name


def test_the_example_of_its_documentation_works():
    lines = inspect.getdoc(simulation).splitlines()
    found = {}
    exec("\n".join(line[4:] for line in lines if line.startswith("    ")), found)
    messages = found["found"]
    assert (messages["nodal_plane"], messages["waveform"]) == (100, 20)
    assert messages["contact_force"] > 300


def test_modules_import_from_each_other_and_not_from_the_public_face():
    # In a package that imports all of its modules, only this finds one that imports from it.
    for path in FOLDER.glob("*.py"):
        if path.name != "__init__.py":
            imported = path.read_text()
            assert "from rpud_sim.simulation import" not in imported, path


@pytest.mark.parametrize(
    ("program", "left_out"),
    [
        ("rpud_sim.bag, rpud_sim.cli.bags, rpud_sim.cli.main", {"numba", "rpud_sim.simulation"}),
        (
            "rpud_sim.ros.record.recorder, rpud_sim.ros.replay.replayer",
            {"numba", "rpud_sim.simulation"},
        ),
        ("rpud_sim.ros.client, rpud_sim.testing.drill, rpud_sim.simulation", {"numba", "llvmlite"}),
    ],
)
def test_what_does_not_simulate_loads_neither_simulation_nor_compiler(program, left_out):
    check = f"import {program}, sys; print(sorted({left_out} & {{*sys.modules}}))"
    done = subprocess.run(
        [sys.executable, "-c", check], capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.returncode) == ("[]\n", 0), done.stderr
