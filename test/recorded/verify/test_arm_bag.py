"""A bag of a drill on an arm: it has the topics of the models that are on, and all are proved."""

import numpy as np
import pytest
from inspection.verify.proof_bags import ARM as VALUES
from rpud_sim.recorded.verify.verification import verify
from rpud_sim.simulation.plans import Scenario, ScheduledFault

import rpud_sim.bag
from rpud_sim.recorded.offline_bag import write_offline_bag
from rpud_sim.simulation.configuration import Settings, to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.run import Beginning
from rpud_sim.simulation.topics import TOPICS, offered_topics

MODELS = {"rotation", "mount", "borehole"}


def test_all_topics_of_an_arm_are_proved(arm):
    with rpud_sim.bag.open(arm) as bag:
        status = bag.arrays("/rpud/status")
        mount = bag.arrays("/rpud/mount")
        rotation = bag.arrays("/rpud/rotation")
        wrench = bag.arrays("/rpud/wrench")
        joints = bag.arrays("/rpud/joint_states")
        assert bag.arrays("/rpud/borehole")["layer"].tolist() == ["sandstone"] * 50
    assert (mount["weight_on_bit"] > 0.0).all()
    assert (wrench["wrench.torque.z"] == -rotation["drive_torque"]).all()
    assert rotation["angle"][-1] > 1.0
    last_two = np.stack(joints["position"])[:, -2:]
    np.testing.assert_array_equal(last_two, np.stack([rotation["angle"], mount["feed"]], axis=1))
    powers = status["mount_power"] + status["weight_on_bit_power"]
    np.testing.assert_allclose(status["feed_power"], powers, atol=1e-9)
    found = verify(arm)
    assert found.proved
    proved = {
        name.removeprefix("/rpud/") for name, each in found.topics.items() if each.equal == 50
    }
    assert proved >= MODELS


def test_the_walk_of_the_bit_is_recorded_and_proved(tmp_path):
    scenario = Scenario(0, (ScheduledFault(100_000_000, 300_000_000, Fault("bit_walk")),))
    settings = to_settings(VALUES)
    write_offline_bag(tmp_path / "bag", Beginning(settings, scenario=scenario), 0.5)
    with rpud_sim.bag.open(tmp_path / "bag") as bag:
        found = bag.arrays("/rpud/borehole")
        walked = found["side_offset"]
    assert (walked[:9] == 0.0).all()
    assert (np.diff(walked) >= 0.0).all()
    # At its default rate of 0.5 mm/s while the fault lasts, and it stays.
    assert walked[-1] == pytest.approx(0.5e-3 * 0.2, rel=0.02)
    assert verify(tmp_path / "bag").proved


def test_a_tool_that_rotates_in_one_rock_has_a_borehole_too(tmp_path):
    values = {"rotation_model": "friction_drive", "rock_model": "specific_energy"}
    write_offline_bag(tmp_path / "bag", Beginning(to_settings(values)), 0.5)
    with rpud_sim.bag.open(tmp_path / "bag") as bag:
        assert (bag.arrays("/rpud/borehole")["depth"][-1]) > 0.0
    assert verify(tmp_path / "bag").proved
    assert {"rotation", "borehole"} <= set(offered_topics(to_settings(values).values()))
    models_off = offered_topics(Settings().values())
    assert set(TOPICS) - set(models_off) == MODELS
