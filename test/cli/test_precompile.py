"""After the step of the set-up nothing is left to compile."""

import subprocess
import sys

import pytest

from rpud_sim.cli import precompile
from rpud_sim.cli.main import execute
from rpud_sim.kernels.store import user_folders
from rpud_sim.model.compile import STORE

SPECIFICATIONS = {
    "sweep": "{design: sobol, points: 2, duration: 0.1,"
    " swept: {weight_on_bit: {minimum: 5.0, maximum: 20.0}}}",
    "fit": "{unknowns: {weight_on_bit: [4.0, 20.0]}, points: 16, rounds: 1, repeat: 2, targets:"
    " [{figure: reacting_force_mean, window: 0.1, value: 15.0, tolerance: 5 %}]}",
    "faults": "faults: [{kind: noise, channel: wrench, magnitude: 0.5, onset: 0.02},"
    " {kind: free_mass_jammed, onset: 0.05}]",
}


def kernels():
    """Return the files of all kernels, with the time at which each was written."""
    files = (
        file for folder in (*STORE.folders, *user_folders()) for file in folder.glob("*.kernel")
    )
    return {file: file.stat().st_mtime_ns for file in files}


@pytest.fixture
def specifications(tmp_path):
    for name, content in SPECIFICATIONS.items():
        (tmp_path / f"{name}.yaml").write_text(content)
    return tmp_path


@pytest.mark.extended
def test_nothing_is_left_to_compile(specifications, capsys):
    with pytest.raises(SystemExit) as end:
        precompile.main([])
    assert end.value.code == 0
    before = kernels()
    assert before
    faults = f"scenario={specifications / 'faults.yaml'}"
    simulate = ["simulate", "--duration", "0.1"]
    for words in (
        simulate,
        [*simulate, "--regime", "free"],
        [*simulate, "--set", "actuator_model=resonance", "--set", faults],
        [*simulate, "--set", "rock_model=specific_energy", "--bag", f"{specifications}/bag"],
        ["verify", f"{specifications}/bag"],
        ["report", f"{specifications}/bag", "--out", f"{specifications}/page.html"],
        ["export", f"{specifications}/bag", "--rate", "1e5", "--out", f"{specifications}/exact"],
        ["sweep", f"{specifications}/sweep.yaml", "--out", f"{specifications}/s", "--workers", "1"],
        ["fit", f"{specifications}/fit.yaml", "--out", f"{specifications}/f", "--workers", "1"],
    ):
        code = execute(words)
        assert code == 0, capsys.readouterr().err
    assert kernels() == before


def test_it_says_that_nothing_is_left_and_gathers_all_kernels(tmp_path, capsys):
    words = [sys.executable, "-m", "rpud_sim.cli.precompile"]
    gathered = subprocess.run(
        [*words, "--into", str(tmp_path / "kernels")], capture_output=True, text=True, check=True
    )
    files = list((tmp_path / "kernels").iterdir())
    count = len(files)
    assert count > 10
    assert f"{count} kernels for x86-64-v3 are in {tmp_path / 'kernels'}" in gathered.stdout
    assert all(len(file.read_bytes()) > 1000 for file in files)
