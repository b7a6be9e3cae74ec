"""Rotation and strata beside the percussion: they take from it, and give it nothing back."""

import dataclasses

import pytest

from rpud_sim.simulation import Simulation, to_configuration
from rpud_sim.simulation.commands import Drive

SECOND = 1_000_000_000
ROTATING = {"rotation_model": "friction_drive", "strata": "sandstone"}


def simulate(**values):
    return Simulation(to_configuration(values))


def test_rotation_and_strata_leave_every_bit_of_the_percussion():
    alone, drilling = simulate(), simulate(**ROTATING)
    one, other = alone.advance_to(SECOND // 2), drilling.advance_to(SECOND // 2)
    assert one.impacts.tobytes() == other.impacts.tobytes()
    assert drilling.depth > 0.0
    assert alone.process.rotation is alone.process.borehole is None


def test_the_drill_tool_rotates_and_the_hole_gets_deeper_than_by_percussion_alone():
    depths = []
    for values in (ROTATING, {"strata": "sandstone"}):
        simulation = simulate(**values)
        simulation.advance_to(SECOND)
        depths.append(simulation.depth)
        assert simulation.penetration_rate == simulation.process.borehole.penetration_rate
    assert depths[0] > depths[1] > 0.0


def test_voltage_and_detuning_slow_the_rotation():
    resonant = {"rotation_model": "friction_drive", "actuator_model": "resonance", "regime": "free"}
    rates = []
    for drive in (
        Drive(True, 100.0, 16000.0),
        Drive(True, 50.0, 16000.0),
        Drive(True, 100.0, 16100.0),
        Drive(False, 100.0, 16000.0),
    ):
        simulation = simulate(**resonant)
        simulation.apply(drive)
        simulation.advance_to(SECOND // 2)
        ratio = simulation.actuator.amplitude / 35e-6
        rates.append(simulation.process.rotation.rate)
        assert rates[-1] == pytest.approx(15.0 * ratio, abs=0.5)
    assert rates[0] > rates[1]
    assert rates[0] > rates[2]
    assert rates[3] < 0.1 * rates[0]


def test_rotation_in_the_rock_of_the_parameters_cuts_it_and_follows_its_change():
    rock = {"rotation_model": "friction_drive", "rock_model": "specific_energy"}
    simulation = simulate(**rock)
    simulation.advance_to(SECOND)
    assert simulation.process.borehole.layer == "rock"
    before = simulation.penetration_rate
    harder = dataclasses.replace(simulation.configuration.rock, rock_specific_energy=3e8)
    simulation.configure(dataclasses.replace(simulation.configuration, rock=harder))
    simulation.advance_to(2 * SECOND)
    assert simulation.penetration_rate < 0.4 * before


def test_without_any_rock_nothing_resists_the_rotation():
    simulation = simulate(rotation_model="friction_drive")
    simulation.advance_to(SECOND // 5)
    assert simulation.process.borehole is None
    assert simulation.process.rotation.rate == pytest.approx(15.0)
