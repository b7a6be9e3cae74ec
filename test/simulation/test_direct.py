"""Slow processes beside a direct integration in small steps, and with half their own step."""

import contextlib
import dataclasses
import json
import math

import numpy as np
import pytest
from direct_drill import APART, HARD, STRIKE, arm_figures, resonant_figures
from scipy.stats import t
from silent_drill import SilentDrill, plans_of
from support import extended

from rpud_sim.drilling.process import STIFFEST, Process
from rpud_sim.drilling.rock import RockParameters, preset_layer
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.contact_models import CONTACT_MODELS
from rpud_sim.model.engine import EngineError
from rpud_sim.simulation import plant, to_configuration
from rpud_sim.simulation.commands import DriveChange, WeightOnBit
from rpud_sim.simulation.ensemble import run_members

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
        simulation = SilentDrill(made(values), phase)
        ends = range(MILLISECOND, round(DURATION * 1000 + 1) * MILLISECOND, MILLISECOND)
        forces.append([simulation.advance_to(end).process.mount.force for end in ends])
    return figures(forces)


def differ(one, other, share):
    """Which figures differ by more than a share and the 99 % interval of their means."""
    count = len(PHASES)
    error = np.sqrt((one.var(axis=0, ddof=1) + other.var(axis=0, ddof=1)) / count)
    least = t.ppf(0.995, 2 * count - 2) * error + np.array(share) * abs(other.mean(axis=0))
    return abs(one.mean(axis=0) - other.mean(axis=0)) > least


@pytest.mark.extended
@pytest.mark.parametrize("values", [SOFT, STIFF, TOUCHING], ids=["soft", "stiff", "touching"])
def test_the_force_of_an_arm_is_that_of_a_direct_integration_and_of_half_the_step(
    monkeypatch, values
):
    direct = figures([arm_figures(made(values), phase, DURATION)[0] for phase in PHASES])
    found = engine_figures(values)
    assert not differ(found, direct, (0.02, 0.1, 0.1)).any(), (found, direct)
    if values is SOFT:
        monkeypatch.setattr(Process, "interval", MILLISECOND // 2)
        assert not differ(engine_figures(SOFT), found, (0.02, 0.1, 0.1)).any()


def test_steps_of_the_arm_give_and_take_little_or_are_an_error(monkeypatch):
    simulation = SilentDrill(made(SOFT), 0.3)
    feed = simulation.advance_to(2000 * MILLISECOND).feed
    assert abs(feed.coupling) < 0.2
    assert feed.guide_friction > 0.0
    assert feed.load_damper != 0.0
    monkeypatch.setattr(plant, "LEAST_CREATED", -1e3)
    with pytest.raises(EngineError, match=r"the arm is unstable: its steps created .* J in"):
        simulation.advance_to(3001 * MILLISECOND)


def drill_on_an_arm(random):
    """Draw a drill on an arm over the whole range of load springs and arms, with play nowhere.

    Stiffer arms the direct integration cannot follow.
    """

    def between(low, high):
        return math.exp(random.uniform(math.log(low), math.log(high)))

    mass = between(0.3, 3.0)
    rate = mass * between(30.0**2, STIFFEST)
    stiffness = between(5.0, 1e7)
    force = min(random.uniform(4.0, 20.0), 0.9 * stiffness)
    return made(
        {
            "rpud_mass": mass,
            "load_spring_rate": rate,
            "arm_stiffness": stiffness,
            "arm_damping": between(1e-3, 1e6),
            "rpud_damping_ratio": random.uniform(0.1, 0.9),
            "initial_feed": force / rate + force / stiffness,
            "feed_maximum": 1.0,
            "anchoring_force": 1000.0,
        }
    )


def means(configuration):
    """Mean reacting force [N] and power of the actuator [W] of each phase, shape (phases, 2)."""
    found = run_members(plans_of(configuration, PHASES), DURATION)
    return np.array(
        [
            (each["reacting_force_mean"], each["energy_account"]["actuator_work"] / DURATION)
            for each in (member.metrics.to_dict() for member in found)
        ]
    )


@pytest.mark.extended
@pytest.mark.parametrize("seed", range(10))
def test_random_arms_are_as_with_half_the_step_and_as_a_direct_integration(monkeypatch, seed):
    configuration = drill_on_an_arm(np.random.default_rng(seed))
    found = means(configuration)
    # Longer steps of the direct one are 4 N off where a drill hops on an arm with little friction.
    direct = [arm_figures(configuration, phase, DURATION, 2e-8)[1:] for phase in PHASES]
    monkeypatch.setattr(Process, "interval", MILLISECOND // 2)
    half = means(configuration)
    assert not differ(found, half, (0.03, 0.05)).any(), (found, half)
    assert not differ(found, np.array(direct), (0.05, 0.05)).any(), (found, direct)


HOPPING = {"load_spring_rate": 1e5, "initial_feed": 6e-4}


@pytest.mark.extended
def test_a_drill_that_hops_on_a_stiff_arm_meets_the_rock_ahead_of_its_tip():
    """Else the rock takes hold of the tool only slowly: in half of the phases 17 or 22 N."""
    direct = np.mean([arm_figures(made(HOPPING), phase, 1.5)[0] for phase in PHASES])
    for member in run_members(plans_of(made(HOPPING), PHASES), 1.5):
        assert member.metrics.values()["reacting_force_mean"] == pytest.approx(direct, rel=0.05)


@pytest.mark.extended
@pytest.mark.parametrize("weight", [15.0, 30.0])
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
    direct = resonant_figures(configuration, 0.0, (0.4, 1.0))[0]
    simulation, found = SilentDrill(configuration), []
    for end in range(400, 1001):
        simulation.advance_to(end * MILLISECOND)
        found.append(simulation.actuator.amplitude)
    amplitude = np.sqrt(np.mean(np.square(found[1:])))
    assert abs(amplitude - direct) < 0.05 * direct + 1.5e-6


@pytest.mark.parametrize("mass", [0.02, extended(0.05)])
@pytest.mark.parametrize("phase", [0.1, extended(0.5), extended(0.9)])
def test_a_drill_before_drilling_vibrates_as_a_direct_oscillator(mass, phase):
    """Its contacts stop the vibration in many phases; half a cycle later it must go on."""
    configuration = to_configuration(
        {"regime": "free", "actuator_model": "resonance", "drill_tool_mass": mass}
    )
    direct = resonant_figures(configuration, phase, (0.5, 1.5), (0.41, 0.43))[0]
    simulation, found = SilentDrill(configuration, phase), []
    for end in range(400, 1501):
        if end == 410:
            simulation.apply(DriveChange(False))
        if end == 430:
            simulation.apply(DriveChange(True))
        simulation.advance_to(end * MILLISECOND)
        found.append(simulation.actuator.amplitude)
    amplitude = np.sqrt(np.mean(np.square(found[100:])))
    assert amplitude == pytest.approx(direct, rel=0.1)


# Of random drills: times without drive and of the figures [s], and the greatest differences of
# amplitude, power and impact rate.
SILENCE, WINDOW = (0.15, 0.17), (0.3, 1.2)
SHARES = (0.03, 0.05, 0.05)
STALLED = 0.2  # of the unloaded amplitude, below which a drill nearly stalls


def resonant_drill(random):
    """Draw a drill with a resonance that may be had."""

    def between(low, high):
        return math.exp(random.uniform(math.log(low), math.log(high)))

    while True:
        values = {
            "actuator_model": "resonance",
            "regime": str(random.choice(["free", "drilling"])),
            "rpud_mass": between(0.3, 3.0),
            "free_mass": between(2e-3, 10e-3),
            "drill_tool_mass": between(2e-3, 50e-3),
            "quality_factor": between(50.0, 2000.0),
            "motional_resistance": between(25.0, 200.0),
            "vibration_amplitude": between(15e-6, 50e-6),
            "load_spring_rate": between(500.0, 1e4),
            "weight_on_bit": random.uniform(2.0, 25.0),
            "actuator_restitution": random.uniform(0.3, 1.0),
            "drill_tool_restitution": random.uniform(0.5, 1.0),
            "rpud_damping_ratio": random.uniform(0.1, 0.9),
            "gravity": float(random.choice([1.62, 9.81])),
        }
        with contextlib.suppress(ParameterError):  # too light a vibration
            return to_configuration(values)


def resonance_figures(configuration, phase):
    """Amplitude [m], power [W] and impact rate [1/s] in the window, and all frequencies [Hz].

    The last are the mean, the least and the greatest.
    """
    simulation = SilentDrill(configuration, phase)
    amplitudes, turned, struck, frequencies = [], [], [], []
    silent, driven, first, last = (round(1000 * time) for time in (*SILENCE, *WINDOW))
    work = 0.0
    for end in range(1, last + 1):
        block = simulation.advance_to(end * MILLISECOND)
        frequencies.append(block.covering["vibration_frequency"])
        if end in (silent, driven):
            simulation.apply(DriveChange(end == driven))
        if end == first:
            work = simulation.actuator.mechanical_work
        if end > first:
            amplitudes.append(simulation.actuator.amplitude)
            hard = block.impacts[block.impacts["impact_velocity"] > STRIKE]
            struck.append(hard["seconds"] + hard["fraction"])
            begins = block.covering["start_seconds"] + block.covering["start_fraction"]
            edges = np.append(np.maximum(begins, (end - 1) / 1000), end / 1000)
            turned.append(np.sum(frequencies[-1] * np.diff(edges)))
    seconds = WINDOW[1] - WINDOW[0]
    amplitude = np.sqrt(np.mean(np.square(amplitudes)))
    power = (simulation.actuator.mechanical_work - work) / seconds
    rate = np.sum(np.diff(np.sort(np.concatenate(struck)), prepend=0.0) > APART) / seconds
    every = np.concatenate(frequencies)
    return (amplitude, power, rate), (np.sum(turned) / seconds, every.min(), every.max())


@pytest.mark.extended
@pytest.mark.parametrize("seed", range(12))
def test_random_resonant_drills_are_as_direct_oscillators(seed):
    """Means over phases of amplitude, power and impact rate, after the drive was off and on."""
    configuration = resonant_drill(np.random.default_rng(seed))
    direct = np.array(
        [resonant_figures(configuration, phase, WINDOW, SILENCE, 5e-8) for phase in PHASES]
    )
    pairs = [resonance_figures(configuration, phase) for phase in PHASES]
    found, frequencies = (
        np.array([pair[0] for pair in pairs]),
        np.array([pair[1] for pair in pairs]),
    )
    assert np.isfinite(found).all()
    # Between two updates it makes up for a quarter of a cycle in half a cycle at most.
    resonance = configuration.actuator.resonance_frequency
    assert frequencies.min() > 0.49 * resonance
    assert frequencies.max() < 1.51 * resonance
    amplitude = direct[:, 0].mean()
    if amplitude < STALLED * configuration.parameters.vibration_amplitude:
        assert abs(found[:, 0].mean() - amplitude) < 1.5e-6
        return
    assert not differ(found, direct, SHARES).any(), (found, direct)
    bandwidth = resonance / configuration.actuator.quality_factor
    assert abs(frequencies[:, 0] - resonance).max() < 0.5 * bandwidth


SECOND = 1000 * MILLISECOND
TURNS = {"rotation_model": "friction_drive"}
BOUNDARIES = (("regolith", 0.0), ("chalk", 4e-4), ("sandstone", 1e-3))
THREE = {"layers": [{"depth_from": depth, "rock": rock} for rock, depth in BOUNDARIES]}
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
        simulation = SilentDrill(to_configuration(values), 0.3)
        yield simulation, simulation.advance_to(round(seconds * SECOND))


@pytest.mark.parametrize(
    ("values", "tolerance"),
    [
        ({**TURNS, "strata": "sandstone", "bit_wear_rate": 1e-4}, 3e-3),
        ({**TURNS, "strata": "chalk"}, 3e-3),
        ({**TURNS, "strata": "regolith"}, 3e-3),
        ({**TURNS, "strata": "sandstone", "rotor_stall_torque": 0.03}, 3e-3),  # it stalls
        ({**TURNS, "strata": json.dumps(THREE)}, 3.5e-2),
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


NEAR_STALL = {
    "actuator_model": "resonance",
    "contact_model": "printed",
    "vibration_amplitude": 35e-6,
    "actuator_restitution": 1.0,
}


def stall_figures(configuration, phase, lifted, window=(0.5, 1.0)):
    """Amplitude [m], power [W] and rate of hard impacts [1/s] in a window.

    A lifted drill begins without weight on bit, so that it vibrates fully before it is pressed.
    """
    simulation = SilentDrill(configuration, phase)
    weight = simulation.parameters.weight_on_bit
    if lifted:
        simulation.apply(WeightOnBit(0.0))
        simulation.advance_to(200 * MILLISECOND)
        simulation.apply(WeightOnBit(weight))
    first, last = (round(1000 * time) for time in window)
    simulation.advance_to(first * MILLISECOND)
    work, amplitudes, struck = simulation.actuator.mechanical_work, [], [np.zeros(1)]
    for end in range(first + 1, last + 1):
        impacts = simulation.advance_to(end * MILLISECOND).impacts
        amplitudes.append(simulation.actuator.amplitude)
        hard = impacts[impacts["impact_velocity"] > HARD]
        struck.append(hard["seconds"] + hard["fraction"])
    seconds = window[1] - window[0]
    amplitude = np.sqrt(np.mean(np.square(amplitudes)))
    power = (simulation.actuator.mechanical_work - work) / seconds
    return amplitude, power, np.sum(np.diff(np.concatenate(struck)) > APART) / seconds


@pytest.mark.parametrize("lifted", [False, True])
def test_a_stalled_drill_is_silent(lifted):
    """Direct: no hard impact and 0.001 W, from rest and from full vibration."""
    configuration = to_configuration({**NEAR_STALL, "weight_on_bit": 35.0})
    begun = float(lifted)
    direct = resonant_figures(configuration, 0.0, (0.5, 0.7), dt=5e-8, begun=begun, strike=HARD)
    amplitude, power, rate = stall_figures(configuration, 0.0, lifted, (0.5, 0.7))
    assert direct[2] == rate == 0.0
    assert abs(direct[1]) < 0.01
    assert abs(power) < 0.01
    assert amplitude < 2e-7


def pressed_drill(random):
    """Draw a drill in the rock that a weight from nothing to stall presses."""
    while True:
        drawn = resonant_drill(random)
        contact = str(random.choice(CONTACT_MODELS))
        parameters = drawn.parameters.replace(
            regime="drilling", contact_model=contact, weight_on_bit=random.uniform(0.0, 60.0)
        )
        with contextlib.suppress(ParameterError):
            return dataclasses.replace(drawn, parameters=parameters)


@pytest.mark.extended
@pytest.mark.parametrize("seed", range(40))
def test_pressed_drills_hammer_or_are_silent_as_direct_oscillators(seed):
    """A drill near stall may do both, by its start: then it does what one of the starts gives."""
    configuration = pressed_drill(np.random.default_rng([44, seed]))
    direct = [
        resonant_figures(configuration, phase, (0.5, 1.0), dt=5e-8, begun=begun, strike=HARD)
        for begun in (0.0, 1.0)
        for phase in PHASES[:2]
    ]
    for lifted in (False, True):
        amplitude, power, rate = stall_figures(configuration, PHASES[1], lifted)
        silent = [figures[2] == 0.0 or abs(figures[1]) < 0.1 for figures in direct]
        if rate == 0.0:
            assert any(silent), direct
            assert abs(power) < 0.1
            continue
        assert not all(silent), (direct, rate, power)
        hammering = np.array([figures for figures in direct if figures[2] > 0.0])
        least, most = hammering.min(axis=0), hammering.max(axis=0)
        assert 0.75 * least[0] - 5e-7 < amplitude < 1.3 * most[0] + 5e-7
        assert 0.75 * least[1] - 0.3 < power < 1.3 * most[1] + 0.3
        assert 0.6 * least[2] < rate < 1.7 * most[2]
