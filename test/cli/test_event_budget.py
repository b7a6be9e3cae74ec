"""A drill beyond its event budget: one line, an exit code, and a whole bag until there."""

import json
import re

import pytest
from support import rpud

MICROGRAM = ("--regime", "free", "--set", "free_mass=1e-11")
LINE = (
    r"(events exceed their budget of 500000 in a simulated second|more than 10000 events at one "
    r"instant) at 0\.\d+ s, "
    r"with free_mass = 1e-11 kg \(default: 0\.005\)\n"
)


@pytest.mark.parametrize("several", [(), ("--repeat", "2")])
def test_simulate_ends_with_one_line(several):
    result = rpud("simulate", *MICROGRAM, "--duration", "10", *several)
    assert result.returncode == 1
    assert re.fullmatch(f"rpud simulate: {LINE}", result.stderr.splitlines(keepends=True)[-1])


@pytest.mark.extended
def test_a_sweep_goes_on_and_notes_the_reason(tmp_path):
    (tmp_path / "sweep.yaml").write_text(
        "{design: grid, duration: 1, fixed: {regime: free}, swept: {free_mass: [1e-11, 5e-3]}}"
    )
    result = rpud("sweep", tmp_path / "sweep.yaml", "--out", tmp_path / "out", "--json")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["failures"] == 1
