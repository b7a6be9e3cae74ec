"""Each slow process gives the same with half its step: what is left falls with the step."""

import json
import math

import numpy as np
import pytest

from rpud_sim.drilling.inputs import UNDISTURBED, Disturbances, Percussion
from rpud_sim.drilling.mount import Feed, Mount, MountParameters
from rpud_sim.drilling.process import Process
from rpud_sim.drilling.rock import RockParameters, preset_layer
from rpud_sim.model.resonator import ResonatorEnergy
from rpud_sim.simulation import Simulation, actuator, to_configuration
from rpud_sim.simulation.commands import Drive

MILLISECOND = 1_000_000
SECOND = 1000 * MILLISECOND
TURNS = {"rotation_model": "friction_drive"}
THREE = {
    "layers": [
        {"depth_from": 0.0, "rock": "regolith"},
        {"depth_from": 4e-4, "rock": "chalk"},
        {"depth_from": 1e-3, "rock": "sandstone"},
    ]
}
WEARING = {**TURNS, "strata": "sandstone", "bit_wear_rate": 1e-4}
RESONANT = {"actuator_model": "resonance", "weight_on_bit": 10.0, "actuator_restitution": 1.0}


def assert_converges(found, tolerance):
    """Check values at steps that are halved twice: the same, and the closer the finer."""
    coarse, default, fine = map(np.asarray, found)
    assert fine == pytest.approx(default, rel=tolerance, abs=0.0)
    # First order: half the step leaves half the error. Where impacts fall among steps is chance.
    allowed = np.maximum(0.75 * np.abs(default - coarse), 0.6 * tolerance * np.abs(fine))
    assert (np.abs(fine - default) <= allowed).all()


def at_steps(monkeypatch, steps, values, seconds=1.0):
    """Give the simulation that drilled with each length of a step [ms]."""
    for step in steps:
        monkeypatch.setattr(Process, "interval", round(step * MILLISECOND))
        simulation = Simulation(to_configuration(values), 0.3)
        yield simulation, simulation.advance_to(round(seconds * SECOND))


@pytest.mark.parametrize(
    ("values", "tolerance"),
    [
        (WEARING, 2e-3),
        ({**TURNS, "strata": "chalk"}, 3e-3),
        ({**TURNS, "strata": "regolith"}, 3e-3),
        ({**TURNS, "strata": "sandstone", "rotor_stall_torque": 0.02}, 3e-3),  # it stalls
        ({**TURNS, "strata": json.dumps(THREE)}, 2e-2),
        ({**TURNS, "rock_model": "specific_energy"}, 3e-3),
    ],
)
def test_rotor_borehole_cuttings_and_wear(monkeypatch, values, tolerance):
    found = []
    for simulation, _ in at_steps(monkeypatch, (2.0, 1.0, 0.5), values):
        rotation, hole = simulation.process.rotation, simulation.process.borehole
        work = rotation.work
        energies = (work.drawn, work.drive, work.cutting, work.friction)
        rates = (hole.penetration_rate, hole.specific_energy)
        wear = (hole.bit_wear, hole.packed_cuttings)
        found.append((rotation.angle, *energies, hole.depth, *rates, *wear))
    assert_converges(found, tolerance)


@pytest.mark.parametrize(
    ("values", "rock", "depth"),
    [
        ({**RESONANT, "vibration_amplitude": 35e-6}, "sandstone", 1e-6),
        ({"weight_on_bit": 30.0}, "limestone", 1e-4),
        ({}, "sandstone", 2e-5),
    ],
)
@pytest.mark.parametrize("steps", [(4.0, 1.0, 0.25), (0.02,)])
def test_percussion_gives_the_depth_of_its_single_impacts_at_any_step(
    monkeypatch, values, rock, depth, steps
):
    # Flutes so wide that cuttings hold nothing up.
    values = {**values, "strata": rock, "flute_area": 1.0}
    layer, parameters = preset_layer(rock), RockParameters()
    for simulation, block in at_steps(monkeypatch, steps, values, 1.0 if len(steps) > 1 else 0.1):
        breaking = block.impacts["energy_transferred"] - layer.threshold_energy
        energy = parameters.rock_energy_transfer * breaking[breaking > 0.0].sum()
        expected = energy / (layer.specific_energy * parameters.hole_area)
        assert simulation.depth == pytest.approx(expected, rel=1e-9, abs=0.0)
        if len(steps) > 1:
            assert simulation.depth > depth
        else:  # the longest contacts go on through several steps
            assert np.max(block.impacts["contact_duration"]) > 2e-5


def test_the_drive_of_the_feed_is_where_it_is_at_any_step():
    moved = []
    for steps in (1, 2):  # in a millisecond
        mount = Mount(MountParameters("arm"), 2000.0, has_rock=False)
        for start, motion in enumerate(
            [Feed("rate", 3e-3), Feed("position", -1e-3), Feed("rate", -5e-3)]
        ):
            mount.motion = motion
            for step in range(700 * steps):
                stalled = Disturbances(feed_stalled=True) if step < 50 * steps else UNDISTURBED
                mount.step(1e-3 / steps, math.inf, Percussion(), 2000.0, stalled)
            moved.append((steps, start, mount.state.feed))
    at_one, at_two = moved[:3], moved[3:]
    for one, other in zip(at_one, at_two, strict=True):
        assert one[2] == pytest.approx(other[2], rel=1e-12)
    assert at_one[0][2] == pytest.approx(0.65 * 3e-3)


def test_the_temperature(monkeypatch):
    """It heats with a power that varies within the thermal time constant."""
    found = []
    for step in (20, 10, 5):
        monkeypatch.setattr(actuator, "HEATING_INTERVAL", step * MILLISECOND)
        parameters = actuator.ActuatorParameters("resonance", heating=True, heat_capacity=0.2)
        heated = actuator.Actuator(parameters, 20e-6, Drive(True, 100.0, 16000.0))
        while (time := heated.next_step) <= SECOND:
            now = time / SECOND
            heat = 50.0 * now + 4.0 * (1.0 - math.cos(9.0 * now))
            heated.step(time, ResonatorEnergy(0j, 0.0, heat, 0.0, 0.0, 0.0))
        found.append(
            [heated.read(0.0, ResonatorEnergy(0j, 0.0, 0.0, 0.0, 0.0, 0.0)).temperature - 293.15]
        )
    assert_converges(found, 5e-3)
