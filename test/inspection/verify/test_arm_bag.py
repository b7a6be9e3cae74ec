"""A bag of a drill on an arm: it has the topics of the models that are on, and all are proved."""

import numpy as np
import pytest

import rpud_sim.bag
from rpud_sim.inspection.offline_bag import write_offline_bag
from rpud_sim.inspection.verify.verification import verify
from rpud_sim.simulation.configuration import Settings, to_settings
from rpud_sim.simulation.run import Beginning
from rpud_sim.simulation.topics import TOPICS, offered_topics

MODELS = {"rotation": "rotation_model", "mount": "feed_model", "borehole": "strata"}
VALUES = {
    "feed_model": "arm",
    "rotation_model": "friction_drive",
    "strata": "sandstone",
    "initial_feed": 0.005,
}


def arrays(tmp_path, **values):
    write_offline_bag(tmp_path / "bag", Beginning(to_settings(values)), 0.5)
    return rpud_sim.bag.open(tmp_path / "bag")


def test_all_topics_of_an_arm_are_proved(tmp_path):
    with arrays(tmp_path, **VALUES) as bag:
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
    found = verify(tmp_path / "bag")
    assert found.proved
    proved = {
        name.removeprefix("/rpud/") for name, each in found.topics.items() if each.equal == 50
    }
    assert proved >= set(MODELS)


@pytest.mark.parametrize("topic", MODELS)
def test_a_topic_is_there_while_its_model_is_on_and_has_no_place_without(topic):
    off = Settings().values()
    assert set(TOPICS) - set(offered_topics(off)) == set(MODELS)
    on = {**off, MODELS[topic]: VALUES[MODELS[topic]]}
    assert set(offered_topics(on)) - set(offered_topics(off)) == {topic}
