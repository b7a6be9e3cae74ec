"""The engine in the whole parameter space: exact, associative, never stuck."""

import math
from itertools import pairwise

import numpy as np
import pytest
from closed_forms import DRILL_TOOL, FREE_MASS, TIP, motion, nodal_plane
from drill_configurations import tables
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from invariants import check_trajectory
from support import examples

from rpud_sim.model.drill import derive
from rpud_sim.model.engine import Engine, EngineError
from rpud_sim.model.parameters import CONTACT_MODELS, preset
from rpud_sim.model.segment import (
    EVENT_ACTUATOR_IMPACT,
    EVENT_DRILL_TOOL_IMPACT,
    motion_at,
)

REGIMES = ("free", "drilling")


def run(parameters, seconds, phase=0.2, drive=True):
    engine = Engine(parameters, phase, drive)
    engine.advance(*divmod(seconds, 1.0))
    return engine.drain()


def total(segments):
    return (segments["start_seconds"] + segments["start_fraction"])[-1] + segments["duration"][-1]


restitutions = st.sampled_from([1.0, 0.9, 0.5, 0.1, 0.0])
extremes = st.fixed_dictionaries(
    {
        "regime": st.sampled_from(REGIMES),
        "contact_model": st.sampled_from(CONTACT_MODELS),
        "gravity_on_drill": st.booleans(),
        "actuator_restitution": restitutions,
        "drill_tool_restitution": restitutions,
        "gravity": st.sampled_from([0.0, 1e-3, 1.62, 9.81]),
        "weight_on_bit": st.sampled_from([0.0, 1.0, 10.0, 100.0, 500.0]),
        "free_mass": st.floats(1e-3, 0.1),
        "rpud_damping_ratio": st.sampled_from([0.0, 0.5, 0.99]),
        "drill_tool_damping_ratio": st.sampled_from([0.0, 0.5, 0.9]),
        "vibration_amplitude": st.sampled_from([0.0, 1e-6, 17.5e-6, 35e-6, 2e-4]),
        "vibration_frequency": st.sampled_from([1000.0, 16000.0, 40000.0]),
        "load_spring_rate": st.sampled_from([100.0, 2000.0, 5e4]),
    }
)


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.too_slow])
@given(changes=extremes, phase=st.floats(0.0, 1.0))
def test_extreme_drills_neither_stall_nor_overlap(changes, phase):
    regime = changes["regime"]
    parameters = preset(regime).replace(**changes)
    drill = derive(parameters)
    engine = Engine(parameters, phase)
    engine.advance(0, 0.2)
    engine.change(0, 0.2, drill, (20.0, 1e-5, 20000.0))
    engine.advance(0, 0.3)
    engine.change(0, 0.3, drill, (5.0, 0.0, 16000.0))
    engine.advance(0, 0.6)
    segments, impacts = engine.drain()
    check_trajectory(segments)
    assert np.isfinite(segments["duration"]).all()
    for name in impacts.dtype.names:
        assert np.isfinite(impacts[name]).all()
    assert (impacts["sequence"] == np.arange(len(impacts))).all()


def test_a_motion_that_is_no_longer_a_number_ends_the_run_in_one_line():
    engine = Engine(preset("drilling"))
    engine.advance(0, 0.01)
    engine._open_segment["nodal_plane_offset"] = math.inf
    with pytest.raises(EngineError, match=r"^the motion cannot be computed .* at 0.0.* s, with "):
        engine.advance(0, 0.02)


@settings(max_examples=25)
@given(
    regime=st.sampled_from(REGIMES),
    phase=st.floats(0.0, 1.0),
    stops=st.lists(st.floats(0.0, 0.3), min_size=1, max_size=12),
    commands=st.dictionaries(
        st.floats(0.0, 0.3),
        st.tuples(st.floats(0.0, 100.0), st.floats(0.0, 5e-5), st.floats(1e3, 3e4)),
        max_size=3,
    ),
)
def test_it_does_not_matter_where_a_caller_stops(regime, phase, stops, commands):
    def trajectory(times):
        engine = Engine(preset(regime), phase)
        for at in sorted({*times, *commands, 0.3}):
            engine.advance(0, at)
            if at in commands:
                engine.change(0, at, derive(preset(regime)), commands[at])
        return tuple(part.tobytes() for part in engine.drain())

    assert trajectory(stops) == trajectory([])


@pytest.mark.parametrize("regime", REGIMES)
def test_many_small_steps_are_one_large_one(regime):
    once = run(preset(regime), 1.2)
    engine = Engine(preset(regime), 0.2)
    for step in range(1, 1201):
        engine.advance(*divmod(step * 0.001, 1.0))
    engine.advance(*divmod(1.2, 1.0))
    for one, many in zip(once, engine.drain(), strict=True):
        assert one.tobytes() == many.tobytes()


@given(phase=st.floats(-3.0, 3.0), regime=st.sampled_from(REGIMES))
def test_every_gap_is_closed_at_the_start(phase, regime):
    segments, _ = run(preset(regime), 0.02, phase)
    for body in (TIP, FREE_MASS, DRILL_TOOL):
        assert abs(motion(segments[0], body, 0.0)) < 1e-15


@pytest.mark.parametrize("regime", REGIMES)
@pytest.mark.parametrize("restitution", [1.0, 0.7])
def test_collisions_keep_momentum_and_restitution_and_lose_energy(regime, restitution):
    parameters = preset(regime).replace(
        actuator_restitution=restitution, drill_tool_restitution=restitution
    )
    drill = derive(parameters)
    segments, _ = run(parameters, 1.0)
    tool, struck = (restitution, (0, 0)) if regime == "free" else (0.0, (0, 2))
    seen = {EVENT_ACTUATOR_IMPACT: 0, EVENT_DRILL_TOOL_IMPACT: 0}
    for before, after in pairwise(segments):
        _, _, _, tip, _, mass, _, rock = motion_at(before, before["duration"])
        _, _, _, tip_after, _, mass_after, _, rock_after = motion_at(after, 0.0)
        event = int(after["event"])
        if event == EVENT_ACTUATOR_IMPACT and before["contact"] == after["contact"] == 0:
            m_1, m_2 = drill.rpud_mass, drill.free_mass
            v_1, v_2, w_1, w_2 = tip, mass, tip_after, mass_after
        elif event == EVENT_DRILL_TOOL_IMPACT and (before["contact"], after["contact"]) == struck:
            m_1, m_2 = drill.free_mass, drill.tool_mass
            v_1, v_2, w_1, w_2 = mass, rock, mass_after, rock_after
        else:
            continue
        e = drill.actuator_restitution if event == EVENT_ACTUATOR_IMPACT else tool
        seen[event] += 1
        assert m_1 * w_1 + m_2 * w_2 == pytest.approx(m_1 * v_1 + m_2 * v_2, abs=1e-12)
        assert w_2 - w_1 == pytest.approx(e * (v_1 - v_2), abs=1e-8)
        lost = m_1 * v_1**2 + m_2 * v_2**2 - m_1 * w_1**2 - m_2 * w_2**2
        assert lost > -1e-8 if e == 1 else lost > 0
    assert min(seen.values()) > 100


@pytest.mark.parametrize("regime", REGIMES)
def test_mean_reacting_force_is_the_mean_impulse_of_the_collisions(regime):
    parameters = preset(regime).replace(weight_on_bit=0.0)
    drill = derive(parameters)
    segments, _ = run(parameters, 20.0)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    pushed = impulse = 0.0
    for before, after in pairwise(segments):
        half = 0.5 * before["duration"]
        times = half * (nodes + 1.0)
        u, v = nodal_plane(before, times), nodal_plane(before, times, 1)
        pushed += half * weights @ (-drill.load_spring_rate * u - drill.rpud_damping * v)
        if before["contact"] & 1:
            force = motion(before, FREE_MASS, times, 2) - drill.gravity
            impulse += drill.free_mass * half * weights @ force
            if before["contact"] & 2:
                tool = (motion(before, DRILL_TOOL, times, order) for order in range(3))
                k, c, m = drill.tool_spring_rate, drill.tool_damping, drill.tool_mass
                impulse += half * weights @ sum(f * x for f, x in zip((k, c, m), tool, strict=True))
        if after["event"] & EVENT_ACTUATOR_IMPACT:
            if after["event"] & EVENT_DRILL_TOOL_IMPACT or before["contact"] & 2:
                jolt = nodal_plane(before, before["duration"], 1) - nodal_plane(after, 0.0, 1)
                impulse += drill.rpud_mass * jolt
            else:
                gained = motion(after, FREE_MASS, 0.0, 1)
                gained -= motion(before, FREE_MASS, before["duration"], 1)
                impulse += drill.free_mass * gained
    seconds = total(segments)
    # What is left is the momentum of the RPUD at the end, less than m_ud times 1 m/s.
    kept = drill.rpud_mass * nodal_plane(segments[-1], 0.0, 1)
    assert pushed / seconds == pytest.approx((impulse + kept) / seconds, rel=1e-3)
    assert pushed / seconds == pytest.approx(impulse / seconds, abs=1.0 / seconds)
    assert pushed / seconds > 0.5


@pytest.mark.parametrize("regime", REGIMES)
@pytest.mark.parametrize("weight", [0.0, 10.0])
def test_without_drive_everything_comes_to_rest(regime, weight):
    parameters = preset(regime).replace(weight_on_bit=weight, gravity=9.81)
    engine = Engine(parameters, 0.2)
    engine.advance(1, 0.0)
    engine.change(1, 0.0, derive(parameters), (weight, 0.0, 16000.0))
    engine.advance(8, 0.0)
    engine.drain()
    engine.advance(9, 0.0)
    segments, impacts = engine.drain()
    last = segments[-1]
    assert len(segments) < 200
    # Nothing damps a mass that rests on rock: what is left is a trembling of nanometres.
    assert len(impacts) < 100
    assert (impacts["impact_velocity"] < 1e-4).all()
    assert last["vibration_amplitude"] == 0.0
    assert last["contact"] & 2
    assert abs(motion(last, TIP, 0.0, 1)) < 1e-3
    assert abs(motion(last, FREE_MASS, 0.0, 1)) < 1e-3
    drill = derive(parameters)
    stiffness = drill.tool_spring_rate + (drill.load_spring_rate if weight else 0.0)
    sag = (weight + drill.free_mass * drill.gravity) / stiffness
    assert motion(last, DRILL_TOOL, 0.0) == pytest.approx(sag, abs=2e-8)


def test_a_bouncing_mass_settles_in_few_impacts():
    parameters = preset("free").replace(
        drill_tool_restitution=0.5, vibration_amplitude=0.0, weight_on_bit=0.0
    )
    engine = Engine(parameters, 0.0)
    engine.advance(0, 0.1)
    engine.change(0, 0.1, derive(parameters), (0.0, 35e-6, 16000.0))
    engine.advance(0, 0.2)
    engine.change(0, 0.2, derive(parameters), (0.0, 0.0, 16000.0))
    engine.advance(2, 0.0)
    before = engine.impact_count
    engine.advance(5, 0.0)
    assert engine.impact_count == before
    assert before < 1000


def test_without_gravity_nothing_brings_the_mass_back_to_the_tool():
    parameters = preset("free").replace(gravity=0.0, vibration_amplitude=0.0)
    segments, impacts = run(parameters, 3.0)
    assert len(impacts) == 0
    assert len(segments) < 400


@pytest.mark.parametrize("regime", REGIMES)
def test_amplitude_changes_only_where_the_vibration_is_zero(regime):
    engine = Engine(preset(regime), 0.1)
    engine.change(0, 0.1, derive(preset(regime)), (10.0, 60e-6, 16000.0))
    engine.advance(0, 0.2)
    segments, _ = engine.drain()
    amplitudes = segments["vibration_amplitude"]
    (change,) = np.flatnonzero(np.diff(amplitudes))
    before, after = segments[change], segments[change + 1]
    assert after["vibration_phase"] in (0.0, 0.5)
    assert 0.1 <= after["start_fraction"] <= 0.1 + 0.5 / 16000
    tip = motion(before, TIP, before["duration"])
    assert motion(after, TIP, 0.0) == pytest.approx(tip, abs=1e-15)


def test_frequency_changes_keep_the_phase_and_the_tip():
    engine = Engine(preset("drilling"), 0.1)
    engine.change(0, 0.1, derive(preset("drilling")), (10.0, 35e-6, 23000.0))
    engine.advance(0, 0.2)
    segments, _ = engine.drain()
    (change,) = np.flatnonzero(np.diff(segments["vibration_frequency"]))
    before, after = segments[change], segments[change + 1]
    phase = before["vibration_phase"] + 16000.0 * before["duration"]
    assert math.cos(2 * math.pi * (phase - after["vibration_phase"])) > 1 - 1e-12
    tip = motion(before, TIP, before["duration"])
    assert motion(after, TIP, 0.0) == pytest.approx(tip, abs=1e-15)


def test_a_new_weight_on_bit_acts_at_once_and_jolts_nothing():
    engine = Engine(preset("drilling"), 0.1)
    engine.change(0, 0.1, derive(preset("drilling")), (40.0, 35e-6, 16000.0))
    engine.advance(0, 0.2)
    segments, _ = engine.drain()
    check_trajectory(segments)
    (change,) = np.flatnonzero(np.diff(segments["weight_on_bit"]))
    assert segments["start_fraction"][change + 1] == 0.1


def test_gravity_on_the_drill_is_borne_by_both_springs():
    free = tables("free").replace(weight_on_bit=10.0, gravity_on_drill=True)
    segments, _ = run(free, 6.0, drive=False)
    sag = (10.0 + 9.81 * (free.rpud_mass + free.free_mass)) / (2 * 2000.0)
    assert nodal_plane(segments[-1], 0.0) == pytest.approx(sag, rel=1e-3)


def test_an_impact_is_squeezed_if_the_tip_pressed_meanwhile():
    engine = Engine(tables("drilling").replace(weight_on_bit=50.0), 0.2)
    engine.advance(5, 0.0)
    segments, impacts = engine.drain()
    starts = segments["start_seconds"] + segments["start_fraction"]
    begun = impacts["seconds"] + impacts["fraction"]
    ended = begun + impacts["contact_duration"]
    pressed = starts[(segments["contact"] == 3) & (segments["duration"] > 1e-9)] + 5e-10
    inside = [np.any((pressed > a) & (pressed < b)) for a, b in zip(begun, ended, strict=True)]
    assert 0 < impacts["squeezed"].sum() < len(impacts)
    assert impacts["squeezed"][inside].all()
    # The greatest forces of all are those of squeezed impacts, for the tip does not yield.
    assert impacts["squeezed"][np.argmax(impacts["peak_force"])]


@pytest.mark.parametrize("pieces", [1, 3])
def test_a_long_block_is_the_same_in_one_piece_and_joined_and_stays_as_it_is(pieces):
    drained = []
    for count in (1, pieces):
        engine = Engine(preset("drilling"), 0.3)
        engine.advance(1, 0.0)
        engine.drain()
        for piece in range(1, count + 1):
            engine.advance(1 + piece // count, piece / count % 1.0)
        covering, _ = engine.drain_covering()
        before = covering.copy()
        engine.advance(3, 0.0)
        assert (covering == before).all()
        assert not covering.flags.writeable
        drained.append(np.concatenate([before, engine.drain_covering()[0]]))
    assert (drained[0] == drained[1]).all()
