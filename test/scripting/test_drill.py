"""A drill that a script steps: the words of the pytest fixture, and the same bits."""

import copy
import pickle

import numpy as np
import pytest

import rpud_sim
from rpud_sim import testing
from rpud_sim.recorded import growing_run
from rpud_sim.ros.client import DrillClient

WORDS = (
    *("press", "drive", "feed", "move", "engage", "inject", "clear"),
    *("step", "reset", "set_parameters"),
)


@pytest.mark.parametrize("other", [DrillClient, testing.LockstepDrill])
def test_its_words_are_those_of_the_client_and_of_a_test(other):
    assert [name for name in WORDS if not hasattr(other, name)] == []
    assert [name for name in WORDS if not hasattr(rpud_sim.Drill, name)] == []


def test_commands_act_at_once_and_are_in_the_run():
    drill = rpud_sim.Drill(weight_on_bit=8)
    drill.step(0.1)
    drill.press(20)
    number = drill.inject("free_mass_jammed", duration=0.05)
    assert drill.status.weight_on_bit == 20.0
    assert drill.step(0.1) == 0.2
    assert drill.status.active_faults == 0
    drill.drive(False)
    drill.set_parameters(gravity=1.62)
    drill.engage(False)
    drill.step(0.013)
    assert (drill.status.regime, drill.status.drive_enabled) == ("free", False)
    kinds = [type(change.action).__name__ for change in drill.run.plan.changes]
    assert kinds[1:4] == ["WeightOnBit", "Inject", "Drive"]
    assert number == 1
    assert drill.run.times("reacting_force")[-1] == pytest.approx(0.21)


def test_its_run_has_the_bits_of_its_steps(tmp_path):
    drill = rpud_sim.Drill(weight_on_bit=8, seed=4)
    forces = []
    for number in range(60):
        if number % 20 == 10:
            drill.press(8 + number)
        drill.step(0.005)
        forces.append(drill.now()["reacting_force"])
    assert drill.run["reacting_force"]["force"].tolist() == forces[1::2]
    drill.run.save(tmp_path / "bag")
    assert rpud_sim.verify(tmp_path / "bag").proved
    with rpud_sim.open(tmp_path / "bag") as bag:
        assert bag.runs[0]["reacting_force"]["force"].tolist() == forces[1::2]
        assert bag.runs[0]["journal"]["kind"].tolist().count("origin") == 1


def test_its_run_is_computed_on_from_where_it_was_and_equals_a_whole_one(monkeypatch):
    drill, runs = rpud_sim.Drill(weight_on_bit=8, seed=4), []
    computed = growing_run.Run
    monkeypatch.setattr(growing_run, "Run", lambda *given: runs.append(given) or computed(*given))
    for number in range(30):
        drill.press(8 + number % 3)
        if number == 20:
            drill.inject("noise", "wrench", duration=0.05)
        early = drill.run
        drill.step(0.013)
        for topic in ("reacting_force", "faults", "wrench"):
            drill.run[topic]
    assert len(runs) == 4  # that which continues, and the beginning of each topic
    whole = pickle.loads(pickle.dumps(drill.run))  # which is computed anew
    assert early.duration == pytest.approx(0.377)
    for topic in whole.topics:
        for name, column in whole[topic].items():
            assert str(drill.run[topic][name].tolist()) == str(column.tolist())
    for topic in ("reacting_force", "contact_force", "wrench"):
        rows = len(early[topic]["header.stamp"])
        assert rows < len(whole[topic]["header.stamp"])
        for name, column in early[topic].items():
            assert str(column.tolist()) == str(whole[topic][name][:rows].tolist())


def test_a_reset_begins_again_with_the_same_or_another_seed():
    drill = rpud_sim.Drill(seed=4)
    drill.step(0.1)
    first = drill.run["contact_force"]["peak_force"]
    drill.press(30)
    drill.reset()
    assert (drill.time, drill.status.weight_on_bit) == (0.0, 8.0)
    drill.step(0.1)
    assert np.array_equal(drill.run["contact_force"]["peak_force"], first)
    drill.reset(seed=5)
    drill.step(0.1)
    assert not np.array_equal(drill.run["contact_force"]["peak_force"], first)


def test_lost_commands_make_it_safe():
    drill = rpud_sim.Drill(command_timeout=0.05, command_loss_ramp=0.05)
    with pytest.warns(UserWarning, match=r"no command for 0\.05 s: the drill is put into the safe"):
        drill.step(0.2)
    assert drill.status.commands_lost
    assert drill.status.weight_on_bit == 0.0
    drill.press(9)
    drill.step(0.02)
    assert drill.status.weight_on_bit == 9.0


def test_the_force_on_a_mount_that_moves_has_the_momentum_of_all_samples():
    drill = rpud_sim.Drill(feed_model="given", feed_rate_limit=1.0, initial_feed=2e-3)
    forces, place, random = [], 2e-3, np.random.default_rng(1)
    for _ in range(10):
        rate = random.uniform(-0.05, 0.05)
        for _ in range(20):
            place += 1e-3 * rate
            drill.move(place, rate)
            drill.step(1e-3)
            forces.append(drill.reacting_force)
    samples = drill.run.waveform(2_000_000)["reacting_force"].reshape(200, 2000)
    assert forces == pytest.approx(samples.mean(axis=1), abs=0.01)


def test_a_drive_that_is_switched_on_again_has_its_last_commanded_voltage():
    drill = rpud_sim.Drill(command_timeout=0.05, command_loss_ramp=0.05)
    drill.drive(voltage=120)
    drill.drive(False)
    drill.drive()
    assert drill.status.drive_voltage == 120.0
    with pytest.warns(UserWarning, match="no command"):
        drill.step(0.2)
    assert (drill.status.commands_lost, drill.status.drive_enabled) == (True, False)
    assert drill.status.drive_voltage == 120.0
    drill.drive()
    assert (drill.status.drive_enabled, drill.status.drive_voltage) == (True, 120.0)


def test_numbers_of_numpy_are_numbers():
    drill = rpud_sim.Drill(weight_on_bit=np.int64(9), seed=np.int32(3), gravity=np.float32(1.5))
    drill.press(np.int64(20))
    drill.step(np.float32(0.25))
    drill.set_parameters(gravity=np.int64(3))
    assert (drill.time, drill.status.weight_on_bit) == (0.25, 20.0)
    with pytest.raises(
        rpud_sim.ParameterError, match=r"= 2000 N is outside its range \[0, 1000\] N"
    ):
        drill.press(np.int64(2000))


@pytest.mark.parametrize(
    ("act", "text"),
    [
        (lambda drill: drill.press(-1), "weight_on_bit = -1 N is outside its range"),
        (lambda drill: drill.press("hard"), "weight_on_bit = 'hard' is not a number"),
        (lambda drill: drill.feed(rate=0.001), "feed"),
        (lambda drill: drill.feed(), "a rate or a position"),
        (lambda drill: drill.step(0), "step = 0 s is outside"),
        (lambda drill: drill.inject("jam"), "kind = 'jam' is unknown"),
        (
            lambda drill: drill.inject("lost_preload", duration=1e-12),
            "duration = 1e-12 s is outside",
        ),
        (lambda drill: drill.press(True), "weight_on_bit = True is not a number"),
        (lambda drill: drill.press(10**400), "weight_on_bit = .* N is outside"),
        (lambda drill: drill.drive("off"), "drive enabled = 'off' is not true or false"),
        (lambda drill: drill.drive(100), "drive enabled = 100 is not true or false"),
        (lambda drill: drill.engage("no"), "engage = 'no' is not true or false"),
        (lambda drill: drill.clear(3), "no fault 3 is active"),
        (lambda drill: drill.set_parameters(free_mass=1.0), "cannot change during a run"),
    ],
)
def test_what_cannot_be_done_changes_nothing(act, text):
    drill = rpud_sim.Drill()
    drill.step(0.05)
    before = drill.run.plan
    with pytest.raises(rpud_sim.ParameterError, match=text):
        act(drill)
    assert drill.run.plan == before


def test_a_copy_shares_nothing_and_a_pickle_is_refused_in_words():
    drill = rpud_sim.Drill()
    drill.step(0.05)
    twins = [copy.copy(drill), copy.deepcopy(drill)]
    for each in (drill, *twins):
        each.step(0.05)
    assert drill.now() == twins[0].now() == twins[1].now()
    twins[0].press(30)
    assert drill.status.weight_on_bit == 8.0
    with pytest.raises(TypeError, match=r"cannot be pickled: copy\.deepcopy copies it"):
        pickle.dumps(drill)
    assert pickle.loads(pickle.dumps(drill.run)).plan == drill.run.plan


def test_nothing_that_a_drill_gives_can_be_changed_without_effect():
    drill = rpud_sim.Drill()
    drill.step(0.05)
    with pytest.raises(AttributeError, match="weight_on_bit"):
        drill.weight_on_bit = 30
    with pytest.raises(ValueError, match="read-only"):
        drill.run["reacting_force"]["force"] *= 1e-3
