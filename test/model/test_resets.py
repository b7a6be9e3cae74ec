"""Each way from one contact to another, in closed form."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support import examples

from rpud_sim.model.closed_form import turn_at
from rpud_sim.model.drill import STATE, derive
from rpud_sim.model.parameters import preset
from rpud_sim.model.resets import (
    close_gaps,
    exchange_momentum,
    join_held_bodies,
    lasting_contact,
)
from rpud_sim.model.search import force_from_tip, force_on_drill_tool
from rpud_sim.model.segment import SEGMENT, begin_segment, load_of, oscillators_of
from rpud_sim.model.tolerances import LOWEST_BOUNCE, TOUCHING, WEAKEST_PULL

ACTUATOR, TOOL, BOTH = 1, 2, 3
STILL = {"vibration_amplitude": 0.0, "weight_on_bit": 0.0}


def state_of(**values):
    state = np.rec.array(np.zeros(1, STATE))[0]
    state.frequency = 16000.0
    for name, value in values.items():
        setattr(state, name, value)
    return state


def settled(parameters, opened=0, **values):
    """Resolve one instant; returns the contact that lasts, the collisions and the state."""
    drill, state = derive(parameters), state_of(**values)
    turn = turn_at(state.phase)
    closed = close_gaps(state, 0, turn)
    collisions = exchange_momentum(drill, state, closed, turn)
    contact = lasting_contact(drill, state, closed, opened, collisions.drill_tool_struck, turn)
    return contact, collisions, state


QUIET = {**STILL, "gravity": 9.81}
WEIGHTLESS = {**STILL, "gravity": 0.0}
LEAVING = -((2.0 * 9.81 * LOWEST_BOUNCE) ** 0.5)  # velocity of the lowest bounce [m/s]


@pytest.mark.parametrize(
    ("regime", "changes", "values", "contact"),
    [
        ("free", {}, {"u_np": -1e-3, "u_dt": 1e-3}, 0),  # far from both
        ("free", QUIET, {"u_np": -1e-3, "v_fm": 0.9**0.5 * LEAVING}, TOOL),
        ("free", QUIET, {"u_np": -1e-3, "v_fm": 1.1**0.5 * LEAVING}, 0),
        # The weight on bit presses all three together.
        ("free", {}, {"weight_on_bit": 10.0}, BOTH),
        ("drilling", {}, {"weight_on_bit": 10.0}, BOTH),
        # The load spring draws the actuator off a resting mass.
        ("free", {"gravity": 9.81}, {"u_np": 1e-5, "u_fm": 1e-5, "u_dt": 1e-5}, TOOL),
        # The restoring spring draws the tool toward the rock, away from the mass.
        ("free", WEIGHTLESS, {"u_np": -1.0, "u_fm": -1e-3, "u_dt": -1e-3}, 0),
        ("free", WEIGHTLESS, {}, BOTH),
    ],
)
def test_bodies_stay_in_the_contacts_that_forces_press(regime, changes, values, contact):
    assert settled(preset(regime).replace(**changes), **values)[0] == contact


def test_a_bouncing_mass_leaves_the_tool():
    parameters = preset("free").replace(drill_tool_restitution=0.5, **STILL)
    contact, collisions, state = settled(parameters, u_np=-1e-3, v_fm=0.2)
    assert contact == 0
    assert collisions.drill_tool_struck
    assert state.v_dt - state.v_fm == pytest.approx(0.5 * 0.2)
    assert collisions.impact_velocity == 0.2
    assert collisions.energy == pytest.approx(0.5 * 5e-3 * 0.2**2)
    assert collisions.impulse == pytest.approx(parameters.drill_tool_mass * state.v_dt)


def test_the_actuator_strikes_a_mass_that_is_still_on_the_tool():
    contact, collisions, state = settled(preset("drilling"), v_np=0.5)
    assert collisions.actuator_struck
    assert collisions.drill_tool_struck
    assert contact & TOOL
    assert state.v_np < 0.5
    drill = derive(preset("drilling"))
    v_hv = 2 * np.pi * 16000.0 * state.amplitude
    carried = (drill.free_mass + drill.tool_mass) * state.v_fm
    assert drill.rpud_mass * (state.v_np + v_hv) + carried == pytest.approx(0.5)


def test_overlaps_are_pushed_apart_without_moving_the_nodal_plane():
    state = state_of(u_np=1e-3, u_fm=1e-3 - TOUCHING, u_dt=1e-3 - 2 * TOUCHING)
    assert close_gaps(state, 0, turn_at(0.0)) == BOTH
    assert (state.u_np, state.u_fm, state.u_dt) == (1e-3, 1e-3, 1e-3)


def test_bodies_that_met_are_closed_whatever_the_digits():
    state = state_of(u_np=-2 * TOUCHING, u_dt=1e-3)
    assert close_gaps(state, 0, turn_at(0.0)) == 0
    assert close_gaps(state, ACTUATOR, turn_at(0.0)) == ACTUATOR


@settings(max_examples=examples(300), deadline=None)
@given(
    st.floats(1e5, 1e10),
    st.floats(0.0, 50.0),
    st.floats(0.0, 2e-9),
    st.floats(-TOUCHING, LOWEST_BOUNCE),
    st.floats(0.0, 1.0),
)
@example(1e9, 0.1, 5e-10, 9.5e-10, 0.0)
def test_no_contact_that_is_kept_pulls(spring_rate, weight, strain, gap, share):
    """Not with a stiff tool either, which moves to the tip when all three are held together."""
    parameters = preset("drilling").replace(
        **QUIET | {"weight_on_bit": weight},
        contact_model="given",
        effective_tool_spring_rate=spring_rate,
    )
    tip = strain - gap
    values = {"u_np": tip, "u_fm": tip + share * max(gap, 0.0), "u_dt": strain}
    drill, state = derive(parameters), state_of(weight_on_bit=weight, **values)
    segment = np.rec.array(np.zeros(1, SEGMENT))[0]
    turn = turn_at(0.0)
    closed = close_gaps(state, 0, turn)
    state.contact = lasting_contact(drill, state, closed, 0, False, turn)
    join_held_bodies(state, turn)
    begin_segment(drill, oscillators_of(drill), state, segment, turn)
    if state.contact == BOTH:
        assert force_on_drill_tool(segment, 0.0)[0] >= -WEAKEST_PULL - 1e-9 * weight
        assert force_from_tip(load_of(segment, True), segment, 0.0).value >= (
            -WEAKEST_PULL - 1e-9 * weight
        )
