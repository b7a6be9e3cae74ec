"""Motion and force of a mount that another simulator moves, beside exact solutions."""

import math
import warnings
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from support import examples, extended

import rpud_sim

RATE = 2000.0  # of the load spring [N/m]
DAMPING = math.sqrt(2000.0)  # of the load spring [N s/m]


def made(start, **values):
    given_values = {"feed_rate_limit": 1.0, "drive_enabled": False, **values}
    return rpud_sim.Drill(feed_model="given", initial_feed=start, **given_values)


def test_the_force_of_a_step_belongs_to_the_motion_of_that_step():
    drill, place = made(0.004), 0.004
    for number in range(8):
        velocity = 0.1 if 2 <= number < 5 else 0.0
        drill.move(place, velocity)
        drill.step(0.001)
        expected = RATE * (place + 0.0005 * velocity) + DAMPING * velocity
        assert drill.reacting_force == pytest.approx(expected, abs=0.01)
        place += velocity * 0.001


def exact(system, start, middle, times):
    """Places of a linear system x'' = system (x - middle, x') that begins at rest."""
    found = [expm(system * time) @ np.array([start - middle, 0.0]) for time in times]
    return np.array([place + middle for place, _ in found])


def test_an_arm_converges_to_the_exact_coupled_system():
    """An arm of 4 kg on 10 kN/m, which both are exact but for what they exchange."""
    mass, stiffness, damping, rest, start = 4.0, 1e4, 80.0, 8e-3, 5e-3
    both = np.array([[0.0, 1.0], [-(stiffness + RATE) / mass, -(damping + DAMPING) / mass]])
    alone = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
    errors = []
    for step in (8e-3, 4e-3, 2e-3, 1e-3, 5e-4):
        drill, state, places = made(start), np.array([start, 0.0]), [start]
        own = expm(alone * step)
        for _ in range(round(0.2 / step)):
            drill.move(*state.tolist())
            drill.step(step)
            middle = np.array([rest - drill.reacting_force / stiffness, 0.0])
            state = own @ (state - middle) + middle
            places.append(state[0])
        middle = stiffness * rest / (stiffness + RATE)
        expected = exact(both, start, middle, step * np.arange(len(places)))
        errors.append(np.abs(places - expected).max())
    assert errors[-1] < 0.2e-6  # the drill tool gives way by that
    for coarse, fine in pairwise(errors):
        assert fine < 0.5 * coarse, errors


@settings(max_examples=examples(8), deadline=None)
@given(
    start=st.sampled_from([5e-3, 1e-3, -1e-3]),
    speed=st.sampled_from([0.5, 0.1, -0.1, -0.5]),
    step=st.sampled_from([1e-3, 2.5e-4]),
    release=st.sampled_from([1e-4, 2e-3]),
    driven=st.booleans(),
    switches=st.booleans(),
)
def test_the_mean_force_of_each_step_is_the_mean_of_the_waveform(
    start, speed, step, release, driven, switches
):
    """Also where the tool enters or leaves the rock, and where the drive changes."""
    drill = made(start, contact_release=release, drive_enabled=driven, seed=1)
    drill.move(start)
    drill.step(0.05)
    begun, forces = drill.time, []
    for number in range(40):
        drill.move(start + speed * number * step, speed)
        if switches and number == 20:
            drill.drive(not driven)
        drill.step(step)
        forces.append(drill.reacting_force)
    rate = 4_000_000
    wave = drill.run.waveform(rate, begun, drill.time - begun)["reacting_force"]
    size = round(step * rate)
    means = np.asarray(wave)[: len(forces) * size].reshape(-1, size).mean(1)
    # What the waveform's own sum lacks: half a sample at each jump of the damping force.
    assert np.abs(np.array(forces) - means).max() < 0.03


def light_arm(mass, step, implicit):
    """Greatest speed at the end of a second of a mount of a mass [kg] on a spring of 20 kN/m."""
    drill, stiffness = made(4e-3), 2e4
    damping = math.sqrt(stiffness * mass)
    place, velocity, ahead, speeds = 4e-3, 0.0, 0.0, []
    for _ in range(round(1.0 / step)):
        drill.move(place, velocity)
        drill.step(step)
        drill_rate, drill_damping = drill.mount_impedance
        assert drill_rate == RATE
        followed = (drill_damping + drill_rate * step) * implicit
        pull = stiffness * (place + step * velocity - 4.5e-3) + damping * velocity
        inertia = mass + (damping + stiffness * step + followed) * step
        acceleration = -(pull + drill.reacting_force - ahead) / inertia
        ahead = followed * step * acceleration
        velocity += step * acceleration
        place += step * velocity
        speeds.append(abs(velocity))
    return max(speeds[len(speeds) // 2 :])


LIGHT = [extended(0.01, 2.5e-4), extended(0.02, 5e-4), (0.05, 2e-3), (0.05, 4e-3), (0.01, 4e-3)]


@pytest.mark.parametrize(("mass", "step"), LIGHT)
def test_a_light_mount_decays_where_its_simulator_takes_the_impedance(mass, step):
    assert light_arm(mass, step, implicit=True) < 1e-6


@pytest.mark.parametrize(("mass", "step"), LIGHT)
def test_a_light_mount_that_takes_the_force_alone_is_warned_of(mass, step):
    with pytest.raises(UserWarning, match=r"the mount swings: .* shorter step, or mount_impedance"):
        light_arm(mass, step, implicit=False)


def test_a_mount_without_samples_is_held_and_the_drive_goes_on():
    drill = made(4e-3, drive_enabled=True)
    drill.move(4e-3, 0.01)
    with pytest.warns(UserWarning, match=r"no command for 0\.5 s: .* a moving mount is held"):
        drill.step(21.0)
    status = drill.status
    assert status.mount_position == pytest.approx(9e-3, abs=2e-4)
    assert (status.mount_velocity, status.commands_lost, status.drive_enabled) == (0.0, True, True)
    drill.move(4e-3, -0.01)
    assert not drill.status.commands_lost
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for number in range(100):  # at rest no sample has to come
            drill.move(4e-3 - 1e-5 * number, 0.0)
            drill.step(0.1)
        drill.step(2.0)


def test_a_motion_does_not_press_with_more_than_a_weight_on_bit_can_be():
    drill = made(4e-3, load_spring_rate=2e4)
    with pytest.raises(
        rpud_sim.ParameterError, match=r"mount position = 0\.09 m presses with 1800"
    ):
        drill.move(0.09)
    drill.move(0.049)
    drill.step(0.1)
