"""A drill beside MuJoCo: the loop closes, and what the exchange of a step costs is bounded."""

import importlib
import os
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "examples" / "mujoco_arm"


@pytest.fixture(scope="module")
def press():
    """The example, with the optional packages of ``make test-all``."""
    folder = os.environ.get("RPUD_OPTIONAL", "")
    if not folder:
        pytest.skip("RPUD_OPTIONAL names no folder of optional.lock, as `make test-all` does")
    sys.path[:0] = [folder, str(FOLDER)]
    try:
        yield importlib.import_module("press")
    finally:
        del sys.path[:2]


@pytest.fixture(scope="module")
def flight(press):
    return press.fly()


@pytest.mark.extended
def test_the_arm_drills_through_two_layers_and_lets_go_of_a_jam(flight):
    depth, time, force = flight["depth"], flight["time"], flight["reacting_force"]
    assert depth[-1] > 0.005
    rates = np.diff(np.interp([0.5, 2.0, 5.0, 14.0], time, depth)) / (1.5, 3.0, 9.0)
    assert rates[0] > 2.0 * rates[2]  # chalk, and then limestone
    drilling = force[(time > 5.0) & (time < 15.0)]
    assert drilling.mean() == pytest.approx(20.0, abs=1.0)  # the arm's weight on the bit
    assert flight["place"][-1] < flight["depth"][-1] - 0.005
    assert force[time > 17.0].mean() < 5.0


@pytest.mark.extended
def test_the_force_on_the_mount_is_what_the_joints_bear(press, flight):
    """Without the rock the joints carry the arm's weight; with it less, by the reacting force."""
    time = flight["time"]
    free = flight["shoulder"][time > 17.0].mean()
    drilling = flight["shoulder"][(time > 5.0) & (time < 15.0)].mean()
    lever = 0.8975  # of the mount about the shoulder [m]
    assert drilling - free == pytest.approx(
        lever * (20.0 - flight["reacting_force"][time > 17.0].mean()), rel=0.1
    )


@pytest.mark.extended
def test_another_step_changes_no_mean_by_more_than_a_twentieth(press):
    means = []
    for step in (0.001, 0.002):
        flown = press.fly(duration=8.0, jam=9.0, step=step)
        drilling = flown["time"] > 3.0
        rate = np.polyfit(flown["time"][drilling], flown["depth"][drilling], 1)[0]
        means.append((flown["reacting_force"][drilling].mean(), rate))
    assert means[1] == pytest.approx(means[0], rel=0.05)
