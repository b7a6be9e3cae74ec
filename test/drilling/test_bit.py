"""The bit cuts as Detournay and Defourny (1992) say."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support import examples

from rpud_sim.drilling.borehole import BitParameters, cut, radius_of
from rpud_sim.drilling.inputs import Pulses
from rpud_sim.drilling.rock import Layer, preset_layer

BIT = BitParameters()
ROCK = preset_layer("sandstone")
RADIUS = radius_of(2e-5)
LAYERS = st.builds(
    Layer,
    specific_energy=st.floats(1e6, 1e9),
    strength=st.floats(1e6, 1e9),
    friction=st.floats(0.0, 1.0),
)
WEIGHTS = st.floats(0.1, 200.0)
FLATS = st.floats(0.0, 1e-5)


@given(LAYERS, WEIGHTS, FLATS, st.floats(1.0, 10.0))
def test_specific_energy_and_drilling_strength_lie_on_the_friction_line(
    layer, weight, flat, hardness
):
    assert math.pi * RADIUS**2 == pytest.approx(2e-5)
    done = cut(BIT, layer, RADIUS, weight, flat, hardness)
    torque = done.cutting_torque + done.friction_torque
    energy = 2.0 * torque / (RADIUS**2 * done.depth)  # E
    strength = weight / (RADIUS * done.depth)  # S
    slope = layer.friction * BIT.bit_shape_factor
    intrinsic = layer.specific_energy * hardness
    expected = (1.0 - slope * BIT.bit_thrust_ratio) * intrinsic + slope * strength
    assert energy == pytest.approx(expected, rel=1e-9)


def test_the_cut_is_linear_in_the_weight_up_to_the_contact_depth_and_beyond():
    flat, full_depth = BIT.bit_wear_flat, BIT.bit_contact_depth
    bearing = ROCK.strength * flat
    edge = BIT.bit_thrust_ratio * ROCK.specific_energy * RADIUS
    full = edge * full_depth + bearing
    for weight in (full, 30.0, 60.0):
        done = cut(BIT, ROCK, RADIUS, weight, flat)
        assert done.depth == pytest.approx((weight - bearing) / edge, rel=1e-12)
        assert done.cutting_torque == pytest.approx(0.5 * RADIUS * edge * done.depth / 0.6)
        assert done.friction_torque == pytest.approx(0.5 * ROCK.friction * RADIUS * bearing)
    half = cut(BIT, ROCK, RADIUS, 0.5 * full, flat)
    assert half.depth == pytest.approx(0.5 * full_depth)
    assert half.friction_torque == pytest.approx(0.25 * ROCK.friction * RADIUS * bearing)


@settings(max_examples=examples(50), deadline=None)
@given(
    st.sampled_from(["regolith", "chalk", "sandstone", "basalt"]),
    st.floats(1e-3, 0.2),
    st.floats(5e-6, 2e-4),
    st.floats(1.0, 2000.0),
    st.floats(0.0, 50.0),
)
def test_under_pulses_the_law_holds_at_each_instant(rock, impulse, duration, rate, steady):
    """The mean depth of cut is that of a quadrature over half sines beside a steady force."""
    assume(rate * duration < 0.5)
    layer, pulses = preset_layer(rock), Pulses(rate, impulse, duration)
    flat = BIT.bit_wear_flat
    times = (np.arange(4000) + 0.5) / 4000
    forces = 0.5 * np.pi * impulse / duration * np.sin(np.pi * times)

    def depth(force):
        return cut(BIT, layer, RADIUS, force, flat).depth

    struck = np.mean([depth(force) for force in forces]) * duration * rate
    found = cut(BIT, layer, RADIUS, steady + rate * impulse, flat, 1.0, pulses)
    assert found.depth == pytest.approx(struck + depth(steady), rel=1e-4)
