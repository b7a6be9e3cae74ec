"""Changes of the drill while it runs, in whatever state they find it."""

import math
import re

import numpy as np
import pytest
from drill_configurations import tables
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.lib.recfunctions import repack_fields
from support import examples
from trajectories import (
    check_trajectory,
    evaluate,
    finished,
    rebuild,
)

from rpud_sim.model.contact_models import CONTACT_MODELS
from rpud_sim.model.drill import derive
from rpud_sim.model.engine import Engine, EngineError
from rpud_sim.model.parameters import QUANTITIES, preset

REGIMES = ("free", "drilling")
COMMANDS = (10.0, 35e-6, 16000.0)


def scaled(name, least, greatest):
    """Give values over many orders of magnitude, and the allowed greatest."""
    values = st.floats(math.log(least), math.log(greatest)).map(math.exp)
    return values.map(lambda value: min(value, QUANTITIES[name].maximum))


ratios = st.sampled_from([0.0, 0.1, 0.5, 0.99])
restitutions = st.sampled_from([0.0, 0.3, 0.9, 1.0])
constants = st.fixed_dictionaries(
    {"regime": st.sampled_from(REGIMES)},
    optional={
        "contact_model": st.sampled_from(CONTACT_MODELS),
        "gravity_on_drill": st.booleans(),
        "actuator_restitution": restitutions,
        "drill_tool_restitution": restitutions,
        "rpud_damping_ratio": ratios,
        "drill_tool_damping_ratio": ratios,
        "gravity": st.sampled_from([0.0, 1e-3, 9.81, 100.0]),
        "rpud_mass": scaled("rpud_mass", 0.1, 1e3),
        "load_spring_rate": scaled("load_spring_rate", 100.0, 1e7),
        "free_mass": scaled("free_mass", 1e-4, 1.0),
        "drill_tool_mass": scaled("drill_tool_mass", 1e-4, 10.0),
        "restoring_spring_rate": scaled("restoring_spring_rate", 1.0, 1e7),
        "elastic_modulus": scaled("elastic_modulus", 1e7, 1e12),
    },
)
commands = st.tuples(
    st.sampled_from([0.0, 1.0, 10.0, 100.0, 500.0]),
    st.sampled_from([0.0, 1e-6, 35e-6, 2e-4]),
    st.sampled_from([1000.0, 16000.0, 40000.0]),
)
changes = st.dictionaries(
    st.floats(0.0, 0.3), st.tuples(constants, st.booleans(), commands), min_size=1, max_size=6
)


def run(regime, planned, stops, end=0.35):
    engine = Engine(preset(regime), 0.2)
    for at in sorted({*planned, *stops, end}):
        engine.advance(0, at)
        if at in planned:
            values, jammed, new = planned[at]
            engine.change(0, at, derive(preset(values["regime"]).replace(**values), jammed), new)
    return finished(engine)


@pytest.mark.parametrize("touches", [True, False])
def test_rock_that_touches_the_drill_tool_stops_it_at_once(touches):
    engine = Engine(preset("free"), 0.2)
    engine.advance(0, 0.05)
    passed = 5e-3  # as a mount that has brought the actuator ahead of the tool's place
    free = engine.drain()[0][-1:]
    before = evaluate(free, np.array([0]), np.array([engine.ahead(0, 0.05)]))
    drill = derive(preset("drilling"))
    engine.change(0, 0.05, drill, (8.0, 35e-6, 16000.0), 0.0, passed, touches)
    after = evaluate(engine.drain()[0][-1:], np.array([0]), np.zeros(1))
    assert after["nodal_plane_position"] == pytest.approx(before["nodal_plane_position"] - passed)
    assert engine.seats is not touches
    tool = before["drill_tool_displacement"] - passed
    assert after["drill_tool_displacement"] == (0.0 if touches else pytest.approx(tool))


@settings(max_examples=examples(150), suppress_health_check=[HealthCheck.too_slow])
@given(
    regime=st.sampled_from(REGIMES),
    planned=changes,
    stops=st.lists(st.floats(0.0, 0.3), min_size=1, max_size=10),
)
def test_changes_keep_the_order_of_bodies_and_continuity_wherever_a_caller_stops(
    regime, planned, stops
):
    try:
        segments, impacts = run(regime, planned, [])
    except EngineError as error:  # a heavy drill that lies on an elastic free mass
        reason = str(error)
        assert "events exceed their budget" in reason
        with pytest.raises(EngineError, match=f"^{re.escape(reason)}$"):
            run(regime, planned, stops)
        return
    for part, again in zip((segments, impacts), run(regime, planned, stops), strict=True):
        assert repack_fields(part).tobytes() == repack_fields(again).tobytes()  # bits, no gaps
    assert np.isfinite(segments["duration"]).all()
    check_trajectory(segments)
    for name in impacts.dtype.names:
        assert np.isfinite(impacts[name]).all()
    assert (impacts["sequence"] == np.arange(len(impacts))).all()
    # A drill that is nearly at rest strikes again at the same instant: such a contact has no force.
    assert (impacts["contact_duration"] >= 0.0).all()
    assert (impacts["peak_force"] >= 0.0).all()
    assert (impacts["peak_force"][impacts["contact_duration"] > 0.0] > 0.0).all()


FREE, DRILLING = tables("free").replace(weight_on_bit=10.0), tables("drilling")


def instant(regime, wanted):
    """Give a time in the middle of a segment that the condition wants, in the second half."""
    engine = Engine(tables(regime), 0.2)
    engine.advance(0, 0.5)
    engine.drain()
    engine.advance(1, 0.0)
    segment = next(each for each in finished(engine)[0][1:] if wanted(each))
    return segment["start_fraction"] + 0.5 * segment["duration"]


def test_an_impact_in_progress_is_reported_over_a_change_of_constants():
    at = instant("drilling", lambda segment: segment["contact"] == 2)
    engine = Engine(DRILLING, 0.2)
    changed = derive(DRILLING.replace(elastic_modulus=0.5e11, free_mass=7e-3))
    engine.change(0, at, changed, COMMANDS)
    engine.advance(1, 0.0)
    segments, impacts = finished(engine)
    impact = impacts[np.flatnonzero(impacts["fraction"] < at)[-1]]
    end = impact["fraction"] + impact["contact_duration"]
    assert impact["fraction"] < at < end
    times = np.linspace(impact["fraction"], end, 200_001)
    found = rebuild(segments, np.zeros(len(times)), times)["contact_force"]
    assert impact["peak_force"] == pytest.approx(found.max(), rel=1e-3)
    # Less the blow itself, which is instantaneous: eq. (21).
    tool = derive(DRILLING).tool_mass
    pushed = impact["impulse"] - impact["impact_velocity"] * 5e-3 * tool / (5e-3 + tool)
    assert pushed == pytest.approx(found.mean() * impact["contact_duration"], rel=1e-3)


@pytest.mark.parametrize("regime", REGIMES)
@pytest.mark.parametrize("drive", [35e-6, 0.0])
def test_a_jammed_mass_strikes_the_tool_no_more(regime, drive):
    parameters = preset(regime).replace(weight_on_bit=10.0)
    engine = Engine(parameters, 0.2)
    engine.advance(0, 0.5)
    engine.drain()
    found = []
    engine.change(0, 0.5, derive(parameters, jammed=True), (10.0, drive, 16000.0))
    for seconds, fraction in ((0, 0.6), (2, 0.0), (3, 0.0)):
        engine.advance(seconds, fraction)
        found.append(finished(engine))
        check_trajectory(found[-1][0])
    # The one in progress, and the one that wedges it.
    struck = [len(impacts) for _, impacts in found]
    assert struck[0] <= 2
    assert struck[1:] == [0, 0]
    segments = found[-1][0]
    assert (segments["contact"] & 2 == 2).all()
    if drive:
        assert np.count_nonzero(segments["event"] & 1) > 10
    else:
        assert len(segments) < 110  # it has come to rest
    engine.change(3, 0.0, derive(parameters), COMMANDS)
    engine.advance(4, 0.0)
    segments, impacts = finished(engine)
    check_trajectory(segments)
    assert len(impacts) > 50
