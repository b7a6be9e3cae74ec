"""Runs the cells of the notebook from end to end, on a bag that is simulated for it."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parent / "analyse_a_bag.py"


@pytest.mark.extended
def test_it_tells_what_the_bag_holds(tmp_path):
    def run(*command):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    metrics = run("rpud", "simulate", "--duration", "1", "--bag", "bag")
    told = run(sys.executable, EXAMPLE, "bag")

    def number(pattern, text):
        return float(re.search(pattern, text)[1])

    rate = number(r"drill_tool_impact_rate +(\S+) 1/s", metrics)
    assert abs(number(r"(\d+) impacts/s", told) / rate - 1.0) < 0.02
    force = number(r"contact_force_mean +(\S+) N", metrics)
    assert abs(number(r"mean (\d+) N", told) / force - 1.0) < 0.001
    reacting = number(r"reacting_force_mean +(\S+) N", metrics)
    assert abs(number(r"reacting force: (\S+) N", told) / reacting - 1.0) < 0.02
    assert "peak force is in N, energy in J" in told
    assert "50000 samples" in told
    assert (tmp_path / "analysis.png").read_bytes().startswith(b"\x89PNG")
