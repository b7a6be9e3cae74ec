"""A short run of the fuzzer, which finds what harms; `make fuzz` makes long ones."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.drill.session import Session
from tools.fuzz import drill

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.extended
def test_hostile_inputs_and_bags_are_rejected_in_one_line_and_harm_nothing():
    words = ("-m", "tools.fuzz", "--inputs", "4000", "--bags", "300")
    done = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True)
    assert (done.stdout.count("harms: 0"), done.returncode) == (2, 0), done.stderr
    rows = re.findall(r"^(\S+) +(\d+) +(\d+) ", done.stdout, re.MULTILINE)
    counts = {way: (int(inputs), int(refused)) for way, inputs, refused in rows}
    assert len(counts) > 25
    for way in ("simulation/step", "set_parameters", "verify", "recover", "fork"):
        inputs, refused = counts[way]
        assert 0 < refused < inputs, way


@pytest.mark.extended
def test_memory_that_inputs_leave_is_a_harm(monkeypatch):
    kept, send = [], drill.Drill.send

    def leaving(*args):
        kept.append(b"." * 2**20)
        return send(*args)

    monkeypatch.setattr(drill.Drill, "send", leaving)
    harms = [each.harms for each in drill.run(range(60), 0)]
    assert not any(harms[:-1])
    assert re.match(r"memory has grown by [23]\d\.\d MB", *harms[-1])


@pytest.mark.extended
def test_an_input_that_cannot_be_taken_back_is_a_harm(monkeypatch):
    def reset(*_):
        raise ParameterError("no drill resets")

    monkeypatch.setattr(Session, "reset", reset)
    harms = [harm for each in drill.run(range(60), 0) for harm in each.harms]
    assert "cannot be taken back: no drill resets" in harms
