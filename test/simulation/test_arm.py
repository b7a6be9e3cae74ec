"""A drill on an arm, with all slow processes at once: the accounts close."""

import functools
import json
import operator

import pytest

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
