"""A drill on an arm: bits, energies, refusals, forces on the rock, and what its messages say."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from silent_drill import SilentDrill
from support import examples, extended, refusal

from rpud_sim.drilling.borehole import BitParameters, cut, radius_of
from rpud_sim.drilling.inputs import NO_PULSES, Pulses
from rpud_sim.drilling.rock import preset_layer
from rpud_sim.simulation import (
    Drive,
    Fault,
    Feed,
    MountMotion,
    WeightOnBit,
    preset,
    to_configuration,
)
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.energy_account import EnergyAccount, FeedAccount
from rpud_sim.simulation.metrics import account_of
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.run import Run

MILLISECOND = 1_000_000
SECOND = 1000 * MILLISECOND
ARM, GIVEN = {"feed_model": "arm"}, {"feed_model": "given"}
RIGID = {**ARM, "arm_stiffness": 0.0, "anchoring_force": 1e3}


def made(**values):
    return SilentDrill(to_configuration(values), 0.3)


def drilled(simulation, *times):
    """Advance to times; return the numbers of all segments and impacts."""
    blocks = [simulation.advance_to(time) for time in times]
    segments = [row for block in blocks for row in block.segments.tolist()]
    impacts = [row for block in blocks for row in block.impacts.tolist()]
    return segments + blocks[-1].open_segment.tolist(), impacts


@given(st.floats(1e-4, 0.04))
@settings(max_examples=examples(10), deadline=None)
def test_a_rigid_arm_at_rest_without_rock_model_gives_the_bits_of_its_weight_on_bit(position):
    fed = made(**RIGID, initial_feed=position)
    fed.apply(Feed("position", position))
    commanded = made(weight_on_bit=2000.0 * position)
    ends = (33 * MILLISECOND, 150 * MILLISECOND)
    assert fed.weight_on_bit == 2000.0 * position
    assert drilled(fed, *ends) == drilled(commanded, *ends)


def test_a_motion_without_contact_gives_the_bits_before_drilling():
    fed = made(**RIGID, initial_feed=-0.05)
    fed.apply(Feed("rate", 1e-3))
    drill = dataclasses.asdict(preset("drilling"))
    free = made(**{**drill, "weight_on_bit": 0.0, "regime": "free"})
    assert drilled(fed, 100 * MILLISECOND) == drilled(free, 100 * MILLISECOND)


ROCK = {"rock_model": "specific_energy"}
THIN = "{layers: [{depth_from: 0.0, rock: regolith}, {depth_from: 0.00002, rock: chalk}]}"
TURNING = {"rotation_model": "friction_drive", "strata": THIN}


@given(
    drill=st.sampled_from([ROCK, TURNING]),
    stiffness=st.sampled_from([0.0, 3e3, 2e4, 1e6]),
    damping=st.sampled_from([1.0, 200.0, 1e4]),
    play=st.sampled_from([0.0, 2e-4]),
    anchoring=st.sampled_from([2.0, 12.0, 100.0]),
    start=st.floats(-1e-3, 8e-3),
    rates=st.lists(st.floats(-5e-3, 5e-3), min_size=2, max_size=3),
    change=st.sampled_from([2000.0, 2600.0, "lost_preload", "load_spring_binding", "choking"]),
)
@settings(max_examples=examples(60), deadline=None)
def test_all_accounts_close(drill, stiffness, damping, play, anchoring, start, rates, change):
    simulation = made(
        **ARM,
        **drill,
        arm_stiffness=stiffness,
        arm_damping=damping,
        arm_play=play,
        anchoring_force=anchoring,
        initial_feed=start,
    )
    energy, feed = EnergyAccount(), FeedAccount()
    for number, rate in enumerate(rates):
        simulation.apply(Feed("rate", rate))
        if number == 1 and isinstance(change, str):
            simulation.inject(Fault(change))
        elif number == 1:
            parameters = simulation.parameters.replace(load_spring_rate=change)
            now = simulation.configuration
            simulation.configure(dataclasses.replace(now, parameters=parameters))
        end = simulation.time + 61_234_567
        for until in (end - 40 * MILLISECOND, end):
            block = simulation.advance_to(until)
            energy, feed = energy + account_of(block), feed + block.feed
    size = max(*map(abs, vars(feed).values()), energy.actuator_work, 1e-3)
    assert abs(energy.residual) < 1e-11 * size
    assert abs(feed.residual(energy.weight_on_bit_work)) < 1e-11 * size
    if rotation := simulation.process.rotation:
        assert abs(rotation.work.residual) < 1e-11 * rotation.work.drive


@pytest.mark.parametrize("weight", [extended(2.0), 10.0, extended(40.0)])
def test_the_bit_cuts_with_the_force_that_the_impacts_give_the_rock(weight):
    drill = {"rotation_model": "friction_drive", "strata": "sandstone", "bit_wear_rate": 0.0}
    simulation = made(**drill, weight_on_bit=weight)
    simulation.advance_to(SECOND)
    blocks = [simulation.advance_to(SECOND + (n + 1) * SECOND // 100) for n in range(1600)]
    force = sum(block.impacts["impulse"].sum() for block in blocks) / 16.0
    torque = sum(block.process.rotation.torque for block in blocks) / 1600.0
    impacts = np.concatenate([block.impacts for block in blocks])
    pulses = Pulses(
        len(impacts) / 16.0, impacts["impulse"].mean(), impacts["contact_duration"].mean()
    )
    bit, layer = BitParameters(), preset_layer("sandstone")

    def torque_under(force, pulses=NO_PULSES):
        done = cut(bit, layer, radius_of(2e-5), force, bit.bit_wear_flat, 1.0, pulses)
        return done.cutting_torque + done.friction_torque

    assert torque == pytest.approx(torque_under(force, pulses), rel=0.02)
    assert torque > (1.03 if weight == 40.0 else 1.3) * torque_under(weight)


@pytest.mark.parametrize(
    ("values", "command", "reason"),
    [
        ({}, Feed("rate", 1e-3), "a feed cannot be commanded with feed_model = none"),
        (
            {"nominal_voltage": 10.0},
            Drive(True, 900.0, 16e3),
            "vibration_amplitude at drive voltage",
        ),
        (ARM, WeightOnBit(3.0), "weight_on_bit cannot be commanded with feed_model = arm"),
        (ARM, Feed("rate", 0.1), "feed rate = 0.1 m/s is outside its range"),
        (ARM, Feed("position", 0.9), "feed position = 0.9 m is outside its range"),
        (
            ARM,
            MountMotion(0.0),
            "the motion of the mount cannot be commanded with feed_model = arm",
        ),
        (GIVEN, Feed("rate", 1e-3), "a feed cannot be commanded with feed_model = given"),
        (GIVEN, WeightOnBit(3.0), "weight_on_bit cannot be commanded with feed_model = given: it"),
        (GIVEN, MountMotion(0.9), "mount position = 0.9 m is outside its range [-0.1, 0.3] m"),
        (GIVEN, MountMotion(0.0, 0.2), "mount velocity = 0.2 m/s is outside its range"),
    ],
)
def test_a_command_that_the_drill_cannot_take_is_refused_and_changes_nothing(
    values, command, reason
):
    simulation = made(**values)
    before = simulation.applied
    assert refusal(simulation.apply, command).startswith(reason)
    simulation.run.take_over()
    assert refusal(simulation.apply, command).startswith(reason)
    simulation.run.watch()
    assert simulation.applied == before


@pytest.mark.parametrize("command", [Feed("rate", 2e-3), Feed("position", 0.02)])
def test_lost_commands_stop_the_feed_and_an_inactive_drill_has_none(command):
    drill = to_configuration(ARM)
    simulation = SilentDrill(drill, 0.3, command_timeout=0.1, command_loss_ramp=0.1)
    simulation.apply(command)
    for time in range(50, 301, 50):
        simulation.advance_to(time * MILLISECOND)
        simulation.run.watch()
    assert simulation.run.commands_lost
    assert simulation.applied.motion == Feed("rate", 0.0)
    assert simulation.process.mount.rate == pytest.approx(0.0, abs=1e-9)
    simulation.apply(command)
    simulation.run.watch()
    assert simulation.applied.motion == command
    simulation.run.activate(False)
    simulation.apply(command)
    assert simulation.applied.motion == Feed("rate", 0.0)


def test_the_status_has_the_feed_in_force():
    run = Run(Plan(Beginning(to_settings(ARM))))
    run.begin(5)
    list(run.advance_to(MILLISECOND))
    run.apply(Feed("position", 2e-3))
    status = run.status().row(0)
    assert math.isnan(status["feed_rate"])
    assert status["feed_position"] == 2e-3
    assert status["feed_applied"] == {"sec": 0, "nanosec": MILLISECOND + 5}
    run.apply(Feed("rate", 0.0))
    status = run.status().row(0)
    assert status["feed_rate"] == 0.0
    assert math.isnan(status["feed_position"])
    status = Run(Plan(Beginning(to_settings({})))).status().row(0)
    assert all(math.isnan(status[f"feed_{name}"]) for name in ("rate", "position"))
