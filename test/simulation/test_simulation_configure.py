"""Another configuration during a run acts from its exact instant on."""

import dataclasses
import math

import pytest
from drill_configurations import FULL, SANDSTONE
from hypothesis import given, settings
from hypothesis import strategies as st
from support import examples

from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
END = 80 * MILLISECOND


def state_at(block, time):
    samples = block.sample(Times.from_nanoseconds(time))
    return {name: values[0] for name, values in dataclasses.asdict(samples).items()}


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


def test_without_a_rock_there_is_no_depth():
    simulation = Simulation(Parameters())
    simulation.advance_to(SECOND)
    assert math.isnan(simulation.depth)
    assert math.isnan(simulation.penetration_rate)


@settings(max_examples=examples(30))
@given(
    st.sampled_from(["free", "drilling"]),
    st.integers(0, END),
    st.fixed_dictionaries(
        {},
        optional={
            "regime": st.sampled_from(["free", "drilling"]),
            "load_spring_rate": st.floats(500.0, 5e3),
            "rpud_damping_ratio": st.floats(0.0, 0.9),
            "gravity": st.floats(0.0, 20.0),
            "actuator_restitution": st.floats(0.3, 1.0),
        },
    ),
)
def test_positions_and_the_plane_s_velocity_go_on_into_another_configuration(regime, time, changes):
    simulation = Simulation(preset(regime))
    before = state_at(simulation.advance_to(time), time)
    simulation.configure(Configuration(simulation.parameters.replace(**changes)))
    after = state_at(simulation.advance_to(time), time)
    for name in ("nodal_plane_position", "actuator_position", "free_mass_position"):
        assert after[name] == pytest.approx(before[name], abs=1e-8), name
    if not before["in_contact"]:
        name = "nodal_plane_velocity"
        assert after[name] == pytest.approx(before[name], abs=1e-9)
    later = simulation.advance_to(time + 50 * MILLISECOND).covering[-1]
    wanted = simulation.parameters
    assert later["load_spring_rate"] == wanted.load_spring_rate
    assert later["gravity"] == wanted.gravity
    assert simulation.parameters.replace(**changes) == wanted


def test_the_same_configuration_again_leaves_every_bit():
    simulation, undisturbed = Simulation(FULL), Simulation(FULL)
    simulation.advance_to(33_333_333)
    simulation.configure(FULL)
    simulation.advance_to(SECOND)
    undisturbed.advance_to(SECOND)
    assert simulation.depth == undisturbed.depth
    assert (
        simulation.advance_to(2 * SECOND).covering == undisturbed.advance_to(2 * SECOND).covering
    ).all()


def test_commands_and_faults_outlast_another_configuration():
    simulation = Simulation(Parameters())
    simulation.apply(WeightOnBit(20.0))
    simulation.inject(Fault("lost_preload"))
    simulation.configure(Configuration(Parameters(gravity=1.62)))
    last = simulation.advance_to(SECOND).segments[-1]
    assert (last["weight_on_bit"], last["gravity"]) == (10.0, 1.62)
    assert simulation.applied.weight_on_bit == WeightOnBit(20.0)
