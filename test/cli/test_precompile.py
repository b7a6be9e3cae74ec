"""After the step of the set-up nothing is left to compile."""

import subprocess
import sys

import pytest

from rpud_sim.cli import precompile
from rpud_sim.cli.main import execute
from rpud_sim.kernels.store import user_folders
from rpud_sim.model.compile import STORE

FAULTS = (
    "faults: [{kind: noise, channel: wrench, magnitude: 0.5, onset: 0.02},"
    " {kind: free_mass_jammed, onset: 0.05}]"
)


def kernels():
    """Return the files of all kernels, with the time at which each was written."""
    files = (
        file for folder in (*STORE.folders, *user_folders()) for file in folder.glob("*.kernel")
    )
    return {file: file.stat().st_mtime_ns for file in files}


@pytest.mark.extended
def test_nothing_is_left_to_compile(tmp_path, capsys):
    (tmp_path / "faults.yaml").write_text(FAULTS)
    with pytest.raises(SystemExit) as end:
        precompile.main([])
    assert end.value.code == 0
    before = kernels()
    assert before
    faults = f"scenario={tmp_path / 'faults.yaml'}"
    simulate = ["simulate", "--duration", "0.1"]
    for words in (
        simulate,
        [*simulate, "--regime", "free"],
        [*simulate, "--set", "actuator_model=resonance", "--set", faults],
        [*simulate, "--set", "rock_model=specific_energy", "--bag", f"{tmp_path}/bag"],
        ["verify", f"{tmp_path}/bag"],
        ["report", f"{tmp_path}/bag", "--out", f"{tmp_path}/page.html"],
        ["export", f"{tmp_path}/bag", "--rate", "1e5", "--out", f"{tmp_path}/exact"],
        ["sweep", "--set", "weight_on_bit=5,20", "--duration", "0.1"],
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
