"""Another configuration during a run acts from its exact instant on."""

import dataclasses

import pytest
from drill_configurations import FULL, SANDSTONE

from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.simulation import Simulation

SECOND = 1_000_000_000


def test_another_specific_energy_counts_from_its_instant_on():
    plain, harder = Simulation(FULL), Simulation(FULL)
    for simulation in (plain, harder):
        simulation.advance_to(SECOND)
    before = plain.depth
    for energy in (1e9, 150e6):  # the second counts from the sandstone's as well
        rock = dataclasses.replace(SANDSTONE, rock_specific_energy=energy)
        harder.configure(dataclasses.replace(FULL, rock=rock))
    assert harder.configuration.rock.rock_specific_energy == 150e6
    plain.advance_to(3 * SECOND)
    harder.advance_to(3 * SECOND)
    assert harder.depth - before == pytest.approx((plain.depth - before) / 2.0, rel=1e-9)


def test_there_is_progress_in_the_rock_alone():
    simulation = Simulation(Configuration(preset("free"), rock=SANDSTONE))
    assert len(simulation.advance_to(SECOND).impacts) > 50
    assert simulation.depth == simulation.penetration_rate == 0.0
    engaged = simulation.parameters.replace(regime="drilling")
    simulation.configure(Configuration(engaged, rock=SANDSTONE))
    simulation.advance_to(2 * SECOND)
    reached = simulation.depth
    assert reached > 0.0
    simulation.configure(Configuration(engaged.replace(regime="free"), rock=SANDSTONE))
    simulation.advance_to(4 * SECOND)
    assert simulation.depth == reached
    assert simulation.penetration_rate == 0.0


def test_the_same_configuration_again_leaves_every_bit():
    simulation, undisturbed = Simulation(FULL), Simulation(FULL)
    simulation.advance_to(33_333_333)
    simulation.configure(FULL)
    undisturbed.advance_to(33_333_333)
    one, other = simulation.advance_to(SECOND // 2), undisturbed.advance_to(SECOND // 2)
    assert (one.covering == other.covering).all()
    assert simulation.depth == undisturbed.depth > 0.0


def test_commands_and_faults_outlast_another_configuration():
    simulation = Simulation(Parameters())
    simulation.apply(WeightOnBit(20.0))
    simulation.inject(Fault("lost_preload"))
    simulation.configure(Configuration(Parameters(gravity=1.62)))
    last = simulation.advance_to(SECOND).segments[-1]
    assert (last["weight_on_bit"], last["gravity"]) == (10.0, 1.62)
    assert simulation.applied.weight_on_bit == WeightOnBit(20.0)
