"""The weight on bit follows from feed, arm and hole, as the closed forms say."""

import math

import pytest

from rpud_sim.drilling.inputs import UNDISTURBED, Percussion
from rpud_sim.drilling.mount import Feed, Mount, MountParameters

RATE = 2000.0
DT = 1e-3


class Rig:
    """A mount without percussion: the drill pushes back with the force of its load spring."""

    def __init__(self, has_rock=True, damping=0.0, **values):
        self.damping = damping
        values = {"arm_stiffness": 0.0, **values}
        self.mount = Mount(MountParameters(feed_model="arm", **values), RATE, has_rock)
        self.bottom = 0.0 if has_rock else math.inf

    @property
    def state(self):
        return self.mount.state

    @property
    def load(self):
        return self.state.weight_on_bit, self.state.in_contact

    def go(self, steps, rate=0.0, to=None, reaction=None, faults=UNDISTURBED, reach=-math.inf):
        self.mount.motion = Feed("rate", rate) if to is None else Feed("position", to)
        for _ in range(steps):
            force = self.mount.preload if reaction is None else reaction
            percussion = Percussion(reacting_force=force, load_damping=self.damping, reach=reach)
            self.mount.step(0, DT, self.bottom, percussion, RATE, faults)
        return self.state


def test_a_rigid_arm_compresses_the_load_spring_by_the_whole_feed():
    rig = Rig(initial_feed=0.005)
    assert rig.load == (RATE * 0.005, True)
    state = rig.go(1000, to=0.007)
    assert state.weight_on_bit == state.force == RATE * 0.007


@pytest.mark.parametrize("initial", [0.002, 0.006])
def test_a_compliant_arm_is_at_rest_where_its_spring_and_the_load_spring_share_the_way(initial):
    rig = Rig(arm_stiffness=1e4, initial_feed=initial)
    shared = RATE * 1e4 / (RATE + 1e4) * initial
    found = (rig.state.weight_on_bit, rig.state.force, rig.go(100).weight_on_bit)
    assert found == pytest.approx((shared,) * 3, rel=1e-12)


def test_a_hole_that_gets_deeper_relieves_the_arm_exponentially():
    stiffness, damping, deeper = 8e3, 400.0, 1e-3
    rig = Rig(arm_stiffness=stiffness, arm_damping=damping, initial_feed=0.006)
    before = rig.state.position
    rig.bottom = deeper
    assert rig.go(1).position == pytest.approx(before, rel=1e-12)
    end = (stiffness * 0.006 + RATE * deeper) / (stiffness + RATE)
    decay = math.exp(-(stiffness + RATE) / damping * 200 * DT)
    state = rig.go(200)
    assert state.position == pytest.approx(end + (before - end) * decay, rel=1e-12)
    assert state.weight_on_bit == pytest.approx(RATE * (state.position - deeper), rel=1e-12)


def test_the_tool_touches_the_rock_where_the_standoff_ends_and_leaves_it_behind_the_release():
    rig = Rig(initial_feed=-0.002, contact_release=5e-4)
    assert rig.load == (0.0, False)
    assert not rig.go(1999, 1e-3).in_contact
    rig.go(2, 1e-3)
    assert rig.load == (pytest.approx(RATE * 1e-6, rel=1e-6), True)
    rig.go(400, -1e-3)
    assert rig.load == (0.0, True)
    assert not rig.go(200, -1e-3).in_contact


def test_a_tool_without_rock_or_that_breaks_through_has_no_weight_on_it():
    assert Rig(has_rock=False, initial_feed=0.005).load == (0.0, False)
    rig = Rig(arm_stiffness=2e4, initial_feed=0.005)
    assert rig.go(10).in_contact
    rig.bottom = math.inf
    rig.go(10)
    assert rig.load == (0.0, False)


def test_the_damping_of_the_load_spring_acts_on_the_velocity_relative_to_the_mount():
    rig = Rig(damping=45.0, arm_stiffness=1e4, arm_damping=5.0, initial_feed=0.006)
    end, rate = 0.006 * 1e4 / (1e4 + RATE), (1e4 + RATE) / 50.0
    assert rig.state.position == pytest.approx(end)
    for push in (0.4, 0.0):
        state = rig.go(1, reaction=rig.mount.preload - push)
    pushed = end + 0.4 / (1e4 + RATE) * -math.expm1(-rate * DT)
    after = end + (pushed - end) * math.exp(-rate * DT)
    assert state.position == pytest.approx(after, rel=1e-12)
    way = after - pushed
    lead = 0.5 * RATE * way
    assert rig.mount.preload == pytest.approx(RATE * after + 45.0 * way / DT + lead, rel=1e-9)


def test_bodies_without_contact_keep_their_places_while_the_mount_moves():
    rig = Rig(arm_stiffness=500.0, arm_damping=5.0, initial_feed=-0.01)
    moved = rig.go(1, reaction=5.0).position + 0.01
    assert moved < -5e-4
    assert rig.mount.advance.passed == pytest.approx(moved)
    rig.go(500, reaction=5.0)
    rig.go(1, 5e-3, reaction=5.0)
    assert rig.mount.advance.passed == pytest.approx(-5e-6)  # the arm does not follow yet
    rigid = Rig(initial_feed=-0.01)
    rigid.go(10, 5e-3)
    assert rigid.mount.advance.passed == 0.0
