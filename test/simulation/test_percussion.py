"""The rock bears, on average, what presses the drill: by momentum, in every transient."""

import pytest

from rpud_sim.drilling.borehole import BitParameters, cut, radius_of
from rpud_sim.drilling.rock import preset_layer
from rpud_sim.model.drill import derive
from rpud_sim.simulation import Simulation, preset, to_configuration
from rpud_sim.simulation.percussion import FORCE_WINDOW, PercussionMeter

SECOND = 1_000_000_000
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
