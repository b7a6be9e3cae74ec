"""The picture of the README shows what is in a bag."""

import subprocess
import sys

import numpy as np
import pytest
from matplotlib.image import imread
from sample_bags import write_offline_bag

import rpud_sim.bag
from rpud_sim.bag import BagError
from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import preset
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation
from toolchain.pictures.first_light import draw, read_run

START, DURATION = 0.3, 0.2


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("picture") / "bag"
    write_offline_bag(path, preset("drilling"), 0.6)
    return path


@pytest.fixture
def run(bag):
    with rpud_sim.bag.open(bag) as reader:
        return read_run(reader, START, DURATION)


def test_the_part_asked_for_is_read(run):
    block = Simulation(preset("drilling")).advance_to(SECOND)
    samples = block.sample(Times.from_grid(15_000, 10_000, 50_000))
    assert run.times == pytest.approx(np.arange(10_000) / 50_000, abs=1e-12)
    for name, values in run.waveform.items():
        assert np.array_equal(values, getattr(samples, name)), name
    times = block.impacts["seconds"] + block.impacts["fraction"] - START
    shown = (times >= 0.0) & (times < DURATION)
    assert run.impact_times == pytest.approx(times[shown], abs=1e-8)
    assert np.array_equal(run.peak_forces, block.impacts["peak_force"][shown])


def test_it_has_three_panels_with_units(run):
    panels = draw(run).axes
    assert len(panels) == 3
    assert all("[" in axes.get_xlabel() and "[" in axes.get_ylabel() for axes in panels)


def test_a_part_that_is_not_there_is_refused(bag):
    with (
        rpud_sim.bag.open(bag) as reader,
        pytest.raises(BagError, match=r"holds no waveform from 0.5 s to 0.7 s"),
    ):
        read_run(reader, 0.5, 0.2)


def test_the_command_draws(bag, tmp_path):
    out = tmp_path / "new" / "out.png"
    command = [sys.executable, "-m", "toolchain.pictures.first_light"]
    subprocess.run([*command, bag, out, "--start", "0.3", "--duration", "0.2"], check=True)
    assert imread(out).shape[:2] == (825, 990)
    result = subprocess.run([*command, tmp_path, out], capture_output=True, text=True)
    assert result.returncode == 1
    assert result.stderr.startswith(f"picture: {tmp_path} holds neither")
