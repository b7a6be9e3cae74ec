"""The engine in the whole parameter space: exact, associative, never stuck."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from trajectories import DRILL_TOOL, FREE_MASS, TIP, finished, motion

from rpud_sim.model.contact import single_contact
from rpud_sim.model.contact_models import CONTACT_MODELS
from rpud_sim.model.drill import derive
from rpud_sim.model.engine import Engine, EngineError
from rpud_sim.model.parameters import preset
from rpud_sim.model.segment import SEGMENT

REGIMES = ("free", "drilling")


def run(parameters, seconds, phase=0.2, drive=True):
    engine = Engine(parameters, phase, drive)
    engine.advance(*divmod(seconds, 1.0))
    return finished(engine)


@given(phase=st.floats(-3.0, 3.0), regime=st.sampled_from(REGIMES))
def test_every_gap_is_closed_at_the_start(phase, regime):
    segments, _ = run(preset(regime), 0.02, phase)
    for body in (TIP, FREE_MASS, DRILL_TOOL):
        assert abs(motion(segments[0], body, 0.0)) < 1e-15


@pytest.mark.parametrize("regime", REGIMES)
@pytest.mark.parametrize("weight", [0.0, 10.0])
def test_without_drive_everything_comes_to_rest(regime, weight):
    parameters = preset(regime).replace(weight_on_bit=weight, gravity=9.81)
    drill = derive(parameters)
    engine = Engine(parameters, 0.2)
    engine.change(1, 0.0, drill, (weight, 0.0, 16000.0))
    engine.advance(8, 0.0)
    engine.drain()
    engine.advance(9, 0.0)
    segments, impacts = finished(engine)
    last = segments[-1]
    assert len(segments) < 200
    # Nothing damps a mass that rests on rock: what is left is a trembling of nanometres.
    assert len(impacts) < 100
    assert (impacts["impact_velocity"] < 1e-4).all()
    assert (last["vibration_amplitude"], last["contact"] & 2) == (0.0, 2)
    assert max(abs(motion(last, body, 0.0, 1)) for body in (TIP, FREE_MASS)) < 1e-3
    stiffness = drill.tool_spring_rate + (drill.load_spring_rate if weight else 0.0)
    sag = (weight + drill.free_mass * drill.gravity) / stiffness
    assert motion(last, DRILL_TOOL, 0.0) == pytest.approx(sag, abs=2e-8)


def test_blocks_are_parts_of_one_and_stay_as_they_are():
    whole, parts = Engine(preset("drilling"), 0.3), Engine(preset("drilling"), 0.3)
    whole.advance(6, 0.0)
    blocks = []
    for end in (0.25, 1.0, 3.0, 4.0, 5.0, 6.0):
        parts.advance(*divmod(end, 1.0))
        block, _ = finished(parts)
        assert not block.flags.writeable
        blocks.append((block, block.copy()))
    assert all((block == content).all() for block, content in blocks)
    assert (np.concatenate([content for _, content in blocks]) == finished(whole)[0]).all()


@pytest.mark.parametrize("model", CONTACT_MODELS)
def test_an_undisturbed_impact_of_the_engine_is_a_single_contact(model):
    """Eqs. (21) and (36)-(39) against what the engine does with the same blow."""
    parameters = preset("drilling").replace(contact_model=model, gravity=0.0)
    engine = Engine(parameters, 0.2)
    engine.advance(5, 0.0)
    impacts = finished(engine)[1][1:]  # the first one is the start, the actuator upon the free mass
    velocities = impacts["impact_velocity"]
    contacts = [single_contact(parameters, float(velocity)) for velocity in velocities]
    durations = np.array([contact.duration for contact in contacts])
    alone = np.abs(impacts["contact_duration"] / durations - 1.0) < 1e-6
    assert np.count_nonzero(alone) > 0.5 * len(impacts)
    energies = 0.5 * 5e-3 * velocities**2
    assert impacts["energy"][alone] == pytest.approx(energies[alone])
    forces = np.array([contact.peak_force for contact in contacts])
    assert impacts["peak_force"][alone] == pytest.approx(forces[alone], rel=1e-6)
    # What the mass brought, and what the tool's elasticity gave it back.
    together = 5e-3 / (5e-3 + contacts[0].tool.mass)
    impulses = 5e-3 * (1.0 + together) * velocities
    assert impacts["impulse"][alone] == pytest.approx(impulses[alone], rel=1e-3)


CROWDED = preset("free").replace(free_mass=1e-7, weight_on_bit=60.0)


def failure(parameters, stops):
    """Return why a drill cannot go on that is advanced from stop to stop [us]."""
    engine = Engine(parameters)
    try:
        for stop in stops:
            engine.advance(*divmod(stop * 1e-6, 1.0))
            engine.drain()
    except EngineError as error:
        return str(error)
    pytest.fail("it goes on")


def test_too_many_events_end_with_one_line_that_names_the_mass_wherever_a_caller_stops():
    text = failure(CROWDED, range(0, 3_000_000, 5000))
    assert re.fullmatch(
        r"events exceed their budget of 500000 in a simulated second at [01]\.\d+ s, "
        r"with free_mass = 1e-07 kg \(default: 0\.005\)",
        text,
    )
    assert text == failure(CROWDED, range(0, 3_000_000, 1777))


def test_the_bytes_between_the_fields_of_a_segment_are_zero():
    engine = Engine(preset("drilling"))
    for second in range(1, 6):
        engine.advance(second, 0.0)
        segments, _ = engine.drain()
        data = segments.view(np.uint8).reshape(len(segments), SEGMENT.itemsize)
        begin = SEGMENT.fields["event"][1] + 1
        assert not data[:, begin : SEGMENT.fields["vibration_phase"][1]].any()
