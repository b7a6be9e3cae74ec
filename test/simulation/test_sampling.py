"""Samples are the motion itself, at any times and any rate, whatever the blocks."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from silent_drill import SilentDrill
from support import trajectory_messages
from trajectories import rebuild

from rpud_sim.simulation import preset
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.sampling import CHANNELS, Times, sample, to_segments

SECOND = 1_000_000_000
# How far two ways to add the same numbers may differ, by channel.
TOLERANCES = {
    "position": 1e-14,
    "displacement": 1e-14,
    "velocity": 1e-9,
    "reacting_force": 1e-7,
    "contact_force": 1e-3,
}


@pytest.fixture(scope="module", params=["free", "drilling"])
def regime(request):
    return request.param


@pytest.fixture(scope="module")
def blocks(regime):
    """Blocks of a quarter of a second with commands at their boundaries."""
    simulation = SilentDrill(preset(regime), initial_phase=0.3)
    made = []
    for command in (
        WeightOnBit(25.0),
        Drive(True, 70.0, 19000.0),
        Drive(False, 0.0, 0.0),
        WeightOnBit(25.0),
    ):
        made.append(simulation.advance_to(simulation.time + SECOND // 16))
        simulation.apply(command)
    return made


@pytest.fixture(scope="module")
def segments(blocks):
    return np.concatenate([*(block.segments for block in blocks), blocks[-1].open_segment])


@pytest.mark.parametrize("rate", [100, 44_100, 1_000_003])
def test_samples_are_the_motion_of_their_segments(segments, rate):
    times = Times.from_grid(0, rate // 4, rate)
    samples = sample(segments, times)
    expected = rebuild(segments, times.seconds, times.fraction)
    for name in CHANNELS:
        close = next(limit for word, limit in TOLERANCES.items() if name.endswith(word))
        assert_allclose(getattr(samples, name), expected[name], rtol=1e-9, atol=close, err_msg=name)


@given(st.integers(0, 2**40), st.integers(1, 1_000_000), st.integers(0, 2**62))
def test_times_are_exact_to_the_last_bit_however_late(first, rate, nanoseconds):
    times = Times.from_grid(first, 3, rate)
    assert times.seconds.dtype == np.int64
    for number in range(3):
        exact = Fraction(first + number, rate)
        assert times.seconds[number] == exact // 1
        assert times.fraction[number] == float(exact % 1)
    times = Times.from_nanoseconds(nanoseconds)
    assert int(times.seconds[0]) * SECOND + round(times.fraction[0] * SECOND) == nanoseconds
    assert 0.0 <= times.fraction[0] < 1.0


def test_a_late_time_is_as_exact_as_an_early_one(segments):
    """A segment a hundred years after time zero has the same motion as one at time zero."""
    times, late = Times.from_grid(0, 1000, 4000), 100 * 365 * 24 * 3600
    moved = segments.copy()
    moved["start_seconds"] += late
    expected = sample(segments, times)
    found = sample(moved, Times(times.seconds + late, times.fraction))
    for name in CHANNELS:
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name


def test_segments_come_back_bit_for_bit(blocks):
    segments = blocks[1].segments
    messages = [SimpleNamespace(**fields) for fields in trajectory_messages(segments, 0, 0)]
    found = np.concatenate([to_segments(message) for message in messages])
    for name in segments.dtype.names:
        assert found[name].tobytes() == segments[name].tobytes(), name
    messages[0].contact = messages[0].contact[:1]
    with pytest.raises(ValueError, match="contact has 1 values, and duration"):
        to_segments(messages[0])
