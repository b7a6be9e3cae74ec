"""A drill on an arm: the accounts close, and the rock bears on average what presses the drill."""

import functools
import json
import operator

import pytest

from rpud_sim.drilling.borehole import BitParameters, cut, radius_of
from rpud_sim.drilling.rock import preset_layer
from rpud_sim.model.drill import derive
from rpud_sim.simulation import Fault, Feed, Simulation, preset, to_configuration
from rpud_sim.simulation.percussion import FORCE_WINDOW, PercussionMeter
from rpud_sim.simulation.statistics import account_of

SECOND = 1_000_000_000
PERIOD = SECOND // 50  # of the force control
LAYERS = [
    {"depth_from": 0.0, "rock": "regolith"},
    {"depth_from": 1.5e-3, "rock": "chalk"},
    {"depth_from": 3e-3, "rock": "sandstone"},
]
ARM = {"feed_model": "arm", "rotation_model": "friction_drive", "feed_rate_limit": 0.04}


def simulate(**values):
    return Simulation(to_configuration({**ARM, **values}), 0.3)


def drill(simulation, seconds, target):
    """Hold the weight on bit by the feed; yield a block in each period."""
    summed = 0.0
    for _ in range(round(seconds * SECOND / PERIOD)):
        missing = target - simulation.weight_on_bit
        summed += 3e-3 * missing * PERIOD / SECOND
        simulation.apply(Feed("rate", min(max(3e-3 * missing + summed, -0.01), 0.01)))
        yield simulation.advance_to(simulation.time + PERIOD)


def retract(simulation, seconds):
    simulation.apply(Feed("rate", -0.02))
    yield simulation.advance_to(simulation.time + round(seconds * SECOND))


@pytest.mark.parametrize("play", [0.0, 2e-4])
def test_the_accounts_of_a_run_through_strata_choking_and_an_inclusion_close(play):
    simulation = simulate(strata=json.dumps({"layers": LAYERS}), arm_play=play)
    blocks = [*drill(simulation, 2.0, 15.0)]
    simulation.inject(Fault("choking", magnitude=0.9), SECOND)
    blocks += [*drill(simulation, 0.6, 15.0), *retract(simulation, 0.7)]
    simulation.inject(Fault("hard_inclusion", magnitude=2e8), SECOND // 2)
    blocks += [*drill(simulation, 3.0, 9.0)]
    energy = functools.reduce(operator.add, map(account_of, blocks))
    feed = functools.reduce(operator.add, (block.feed for block in blocks))
    process = simulation.process
    work = process.rotation.work
    assert process.borehole.layer == "sandstone"
    assert abs(energy.residual) < 1e-11 * energy.actuator_work
    assert abs(feed.residual(energy.weight_on_bit_work)) < 1e-11 * energy.actuator_work
    assert abs(work.residual) < 1e-11 * work.drive
    assert min(work.cutting, work.friction, work.flutes, feed.penetration_work) > 0.0


STEP = 1e-3  # s
ROCK = preset("drilling")
DRILL = derive(ROCK)
FREE_MASS_WEIGHT = ROCK.free_mass * ROCK.gravity


def at_rest(meter, weight, seconds=STEP, drill=DRILL, position=0.0):
    """Percussion of the last step of a time in which nothing moves."""
    for _ in range(round(seconds / STEP)):
        percussion = meter.read(STEP, position, weight, drill, 0.0)
    return percussion


def test_at_a_standstill_of_the_drive_it_is_the_weight_on_bit():
    meter = PercussionMeter(20e-6, 0.0, 10.0)
    assert at_rest(meter, 10.0).rock_force == pytest.approx(10.0 + FREE_MASS_WEIGHT)
    heavy = derive(ROCK.replace(gravity_on_drill=True))
    expected = 10.0 + FREE_MASS_WEIGHT + 9.81 * ROCK.rpud_mass
    assert at_rest(meter, 10.0, drill=heavy).rock_force == pytest.approx(expected)


def test_another_weight_arrives_within_the_window():
    meter = PercussionMeter(20e-6, 0.0, 10.0)
    force = at_rest(meter, 20.0, FORCE_WINDOW).rock_force - FREE_MASS_WEIGHT
    assert force == pytest.approx(20.0 - 10.0 / 2.718, rel=0.01)
    force = at_rest(meter, 20.0, 9.0 * FORCE_WINDOW).rock_force - FREE_MASS_WEIGHT
    assert force == pytest.approx(20.0, rel=1e-3)


def test_a_lifted_tool_and_a_drill_that_pulls_press_nothing():
    meter = PercussionMeter(20e-6, 0.0, 10.0)
    assert at_rest(meter, 10.0, drill=derive(preset("free"))).rock_force == 0.0
    assert at_rest(meter, 10.0).rock_force > 9.0  # the tool is back
    assert at_rest(meter, 0.0, 1.0, position=1e-3).rock_force == 0.0


@pytest.mark.parametrize("weight", [2.0, 10.0, 40.0])
def test_the_bit_cuts_with_the_force_that_the_impacts_give_the_rock(weight):
    values = {"rotation_model": "friction_drive", "strata": "sandstone", "weight_on_bit": weight}
    simulation = Simulation(to_configuration({**values, "bit_wear_rate": 0.0}))
    simulation.advance_to(SECOND)
    force, torque = 0.0, 0.0
    for number in range(400):
        block = simulation.advance_to(SECOND + (number + 1) * SECOND // 100)
        force += block.impacts["impulse"].sum() / 4.0
        rotation = block.process.rotation
        torque += rotation.torque / 400.0
    bit, layer = BitParameters(), preset_layer("sandstone")

    def torque_under(force):
        done = cut(bit, layer, radius_of(2e-5), force, bit.bit_wear_flat)
        return done.cutting_torque + done.friction_torque

    assert torque == pytest.approx(torque_under(force), rel=0.02)
    assert torque > (1.03 if weight == 40.0 else 1.3) * torque_under(weight)
