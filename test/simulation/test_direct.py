"""A drill on an arm, and one that nearly stalls, beside a direct integration in small steps."""

import numpy as np
import pytest
from direct_drill import arm_forces, resonant_amplitude
from scipy.stats import t

from rpud_sim.drilling.process import Process
from rpud_sim.model.engine import EngineError
from rpud_sim.simulation import Simulation, plant, to_configuration

MILLISECOND = 1_000_000
PHASES = (0.05, 0.3, 0.55, 0.8)
DURATION, SKIPPED = 2.5, 500  # s, and ms of the start
SOFT = {
    "arm_stiffness": 500.0,
    "arm_damping": 5.0,
    "rpud_damping_ratio": 0.05,
    "initial_feed": 0.025,
    "anchoring_force": 1000.0,
}
STIFF = {"initial_feed": 0.006}
TOUCHING = {"initial_feed": 0.0}


def made(values):
    return to_configuration({"feed_model": "arm", **values})


def figures(forces):
    """Mean, standard deviation and greatest force of each phase [N], shape (phases, 3)."""
    table = np.array(forces)[:, SKIPPED:]
    return np.array([table.mean(axis=1), table.std(axis=1), table.max(axis=1)]).T


def engine_figures(values):
    forces = []
    for phase in PHASES:
        simulation = Simulation(made(values), phase)
        ends = range(MILLISECOND, round(DURATION * 1000 + 1) * MILLISECOND, MILLISECOND)
        forces.append([simulation.advance_to(end).process.mount.force for end in ends])
    return figures(forces)


def differ(one, other, share):
    """Which figures differ by more than a share and the 99 % interval of their means."""
    count = len(PHASES)
    error = np.sqrt((one.var(axis=0, ddof=1) + other.var(axis=0, ddof=1)) / count)
    least = t.ppf(0.995, 2 * count - 2) * error + np.array(share) * abs(other.mean(axis=0))
    return abs(one.mean(axis=0) - other.mean(axis=0)) > least


@pytest.mark.parametrize("values", [SOFT, STIFF, TOUCHING], ids=["soft", "stiff", "touching"])
def test_the_force_of_an_arm_is_that_of_a_direct_integration(values):
    direct = figures([arm_forces(made(values), phase, DURATION) for phase in PHASES])
    found = engine_figures(values)
    assert not differ(found, direct, (0.02, 0.1, 0.1)).any(), (found, direct)


def test_half_the_step_gives_the_same_force(monkeypatch):
    whole = engine_figures(SOFT)
    monkeypatch.setattr(Process, "interval", MILLISECOND // 2)
    assert not differ(engine_figures(SOFT), whole, (0.02, 0.1, 0.1)).any()


def test_steps_of_the_arm_give_and_take_little():
    simulation = Simulation(made(SOFT), 0.3)
    block = simulation.advance_to(2000 * MILLISECOND)
    feed = block.feed
    assert abs(feed.coupling) < 0.2
    assert feed.guide_friction > 0.0
    assert feed.load_damper != 0.0


def test_an_arm_whose_steps_create_energy_is_an_error(monkeypatch):
    monkeypatch.setattr(plant, "LEAST_CREATED", -1e3)
    with pytest.raises(EngineError, match=r"the arm is unstable: its steps created .* J in"):
        Simulation(made(SOFT), 0.3).advance_to(1001 * MILLISECOND)


@pytest.mark.parametrize("weight", [15.0, 20.0, 25.0, 30.0])
def test_a_drill_that_nearly_stalls_vibrates_as_a_direct_oscillator(weight):
    configuration = to_configuration(
        {
            "actuator_model": "resonance",
            "weight_on_bit": weight,
            "vibration_amplitude": 35e-6,
            "actuator_restitution": 1.0,
            "contact_model": "printed",
        }
    )
    direct = resonant_amplitude(configuration, 1.0, 0.4, 2e-8)
    simulation = Simulation(configuration)
    simulation.advance_to(400 * MILLISECOND)
    found = []
    for end in range(401 * MILLISECOND, 1001 * MILLISECOND, MILLISECOND):
        simulation.advance_to(end)
        found.append(simulation.actuator.amplitude)
    amplitude = np.sqrt(np.mean(np.square(found)))
    assert abs(amplitude - direct) < 0.05 * direct + 1.5e-6
