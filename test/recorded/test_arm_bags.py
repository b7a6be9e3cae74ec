"""Bags of drills on an arm: all topics of its models are proved, and forked within a motion."""

import numpy as np
import pytest
from forked_runs import ARM, MILLISECOND, held
from silent_drill import plans_of

import rpud_sim.bag
from rpud_sim.recorded.fork import write_fork
from rpud_sim.recorded.offline_bag import write_offline_bag
from rpud_sim.recorded.verify import verify
from rpud_sim.simulation import Feed, MountMotion
from rpud_sim.simulation.changes import Change, Inject
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.ensemble import run_ensemble
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.run import Run

MODELS = {"rotation", "mount", "borehole"}
VALUES = {"feed_model": "arm", "initial_feed": 5e-4, "rock_model": "specific_energy"}
FEEDS = (
    Change(0, Feed("rate", 3e-3)),
    Change(123_456_789, Feed("position", 2e-3)),
    Change(250 * MILLISECOND, Feed("rate", -2e-3)),
)
MOTIONS = (
    Change(0, MountMotion(5e-4, 3e-3)),
    Change(123_456_789, MountMotion(2e-3)),
    Change(250 * MILLISECOND, MountMotion(2e-3, -2e-3, sampled=240 * MILLISECOND)),
)
PLANS = {
    "arm": Plan(Beginning(to_settings(VALUES), 0.3), FEEDS),
    "given": Plan(Beginning(to_settings({**VALUES, "feed_model": "given"}), 0.3), MOTIONS),
}


@pytest.fixture(scope="module", params=PLANS)
def fed(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "bag"
    write_offline_bag(path, PLANS[request.param], 0.4)
    return path


def test_all_topics_of_an_arm_are_proved(arm):
    with rpud_sim.bag.open(arm) as bag:
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
    found = verify(arm)
    assert found.proved
    proved = {
        name.removeprefix("/rpud/") for name, each in found.topics.items() if each.equal == 50
    }
    assert proved >= MODELS


def test_the_walk_of_the_bit_is_recorded_and_proved(tmp_path):
    walk = Change(100 * MILLISECOND, Inject(Fault("bit_walk"), 200 * MILLISECOND))
    write_offline_bag(tmp_path / "bag", Plan(Beginning(to_settings(ARM), faults=(walk,))), 0.5)
    with rpud_sim.bag.open(tmp_path / "bag") as bag:
        walked = bag.arrays("/rpud/borehole")["side_offset"]
    assert (walked[:9] == 0.0).all()
    assert (np.diff(walked) >= 0.0).all()
    # At its default rate of 0.5 mm/s while the fault lasts, and it stays.
    assert walked[-1] == pytest.approx(0.5e-3 * 0.2, rel=0.02)
    assert verify(tmp_path / "bag").proved


def test_the_figures_are_those_of_the_run_in_the_bag():
    run = Run(PLANS["arm"])
    list(run.advance_to(400 * MILLISECOND))
    configuration = PLANS["arm"].beginning.settings.configuration
    [member] = run_ensemble(plans_of(configuration, [0.3], FEEDS), 0.4).members
    assert member.metrics.to_dict()["depth"] == run.simulation.depth
    assert abs(member.metrics.feed.residual(member.metrics.account.weight_on_bit_work)) < 1e-12


@pytest.mark.parametrize("at", [0.0567, 0.3])
def test_a_fork_goes_on_with_the_same_bits(fed, tmp_path, at):
    write_fork(fed, tmp_path / "fork", at)
    since = round(at * 1000 * MILLISECOND)
    rest = [[each for each in held(path) if each[0] > since] for path in (tmp_path / "fork", fed)]
    assert rest[0] == rest[1]
    assert verify(fed).proved
    assert verify(tmp_path / "fork").proved
