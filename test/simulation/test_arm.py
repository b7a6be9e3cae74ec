"""A drill on an arm, with all slow processes at once: accounts close, and it cuts as Teale says."""

import functools
import json
import math
import operator

import pytest

from rpud_sim.drilling.strata import find_strata
from rpud_sim.simulation import Fault, Feed, Simulation, to_configuration
from rpud_sim.simulation.energy_account import EnergyAccount

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
    energy = functools.reduce(operator.add, map(EnergyAccount.of, blocks))
    feed = functools.reduce(operator.add, (block.feed for block in blocks))
    process = simulation.process
    work = process.rotation.work
    assert process.borehole.layer == "sandstone"
    assert abs(energy.residual) < 1e-11 * energy.actuator_work
    assert abs(feed.residual(energy.weight_on_bit_work)) < 1e-11 * energy.actuator_work
    assert abs(work.residual) < 1e-11 * work.drive
    assert min(work.cutting, work.friction, work.flutes, feed.penetration_work) > 0.0


@pytest.mark.parametrize("rock", ["limestone", "basalt"])
def test_torque_and_progress_of_a_run_give_the_least_specific_energy_of_teale(rock):
    least = find_strata(rock).layers[0].specific_energy
    # A sharp bit in clear flutes, and percussion that breaks nothing: all of the hole is cut.
    sharp = {"bit_wear_flat": 0.0, "flute_area": 1.0, "rock_energy_transfer": 0.0}
    found = []
    for bit in (sharp, {**sharp, "bit_wear_flat": 4e-7}):
        simulation = simulate(strata=rock, bit_wear_rate=0.0, **bit)
        blocks = [*drill(simulation, 2.0, 20.0)]
        first, last = blocks[-25].process, blocks[-1].process
        turned = last.rotation.angle - first.rotation.angle
        volume = 2.0e-5 * (last.borehole.depth - first.borehole.depth)
        torque = math.fsum(block.process.rotation.torque for block in blocks[-24:]) / 24
        found.append(torque * turned / volume)  # 2 pi N T / (A u)
    # The weight on bit does the work W / A besides, which is less than 3 % of it.
    assert found[0] == pytest.approx(least, rel=1e-2)
    assert found[1] > 1.05 * least


def test_the_feed_holds_the_weight_on_bit_while_the_hole_gets_deeper():
    simulation = simulate(strata="chalk", rotor_no_load_rate=30.0)
    blocks = [*drill(simulation, 6.0, 20.0)]
    weights = [block.process.mount.weight_on_bit for block in blocks]
    assert simulation.process.borehole.penetration_rate > 1e-3
    assert sum(weights[-50:]) / 50 == pytest.approx(20.0, abs=1.5)
