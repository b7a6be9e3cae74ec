"""Samples are the motion itself, at any times and any rate, whatever the blocks."""

import dataclasses
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from support import trajectory_messages
from trajectories import rebuild

from rpud_sim.model.drill import derive
from rpud_sim.simulation import preset
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.sampling import CHANNELS, Rebuilder, Times, sample, to_segments
from rpud_sim.simulation.simulation import Simulation

SECOND = 1_000_000_000
# How far two ways to add the same numbers may differ, by channel.
TOLERANCES = {
    "position": 1e-14,
    "displacement": 1e-14,
    "velocity": 1e-9,
    "reacting_force": 1e-7,
    "contact_force": 1e-3,
}


def run(regime, blocks=4):
    """Give the blocks of a quarter of a second with commands at their boundaries."""
    simulation = Simulation(preset(regime), initial_phase=0.3)
    given_commands = [WeightOnBit(25.0), Drive(True, 70.0, 19000.0), Drive(False, 0.0, 0.0)]
    made = []
    for number in range(blocks):
        made.append(simulation.advance_to((number + 1) * SECOND // 4 // blocks))
        simulation.apply(given_commands[number % 3])
    return made


def whole(blocks):
    segments = [block.segments for block in blocks] + [blocks[-1].open_segment]
    return np.concatenate(segments)


def close(name):
    return next(limit for word, limit in TOLERANCES.items() if name.endswith(word))


@pytest.mark.parametrize("regime", ["free", "drilling"])
@pytest.mark.parametrize("rate", [100, 44_100, 1_000_003])
def test_samples_are_the_motion_of_their_segments(regime, rate):
    blocks = run(regime)
    times = Times.from_grid(0, rate // 4, rate)
    samples = sample(whole(blocks), times)
    expected = rebuild(whole(blocks), times.seconds, times.fraction)
    for name in CHANNELS:
        assert_allclose(
            getattr(samples, name), expected[name], rtol=1e-9, atol=close(name), err_msg=name
        )


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_a_grid_over_many_blocks_is_that_of_the_whole(regime):
    rate = 44_100
    blocks = run(regime, blocks=7)
    pieces, first = [], 0
    for block in blocks:
        end = -(-block.end * rate // SECOND)
        pieces.append(block.sample(Times.from_grid(first, end - first, rate)))
        first = end
    expected = sample(whole(blocks), Times.from_grid(0, first, rate))
    for name in (*CHANNELS, "in_contact"):
        joined = np.concatenate([getattr(piece, name) for piece in pieces])
        assert np.array_equal(joined, getattr(expected, name)), name


@pytest.fixture(scope="module", params=["free", "drilling"])
def dense(request):
    """A quarter of a second of a drill, two million samples a second."""
    blocks = run(request.param)
    samples = sample(whole(blocks), Times.from_grid(0, 500_000, 2_000_000))
    return derive(preset(request.param)), samples


def test_there_is_a_contact_force_in_contact_and_only_there(dense):
    _, samples = dense
    assert samples.in_contact.any()
    assert not samples.in_contact.all()
    assert (samples.contact_force[~samples.in_contact] == 0.0).all()
    assert samples.contact_force.min() > -1e-6
    assert (samples.contact_force[samples.in_contact] > 0.0).mean() > 0.99
    touching = samples.drill_tool_displacement - samples.free_mass_position
    assert abs(touching[samples.in_contact]).max() < 2e-9


def test_the_reacting_force_is_that_of_spring_and_damper(dense):
    drill, samples = dense
    without_weight_on_bit = (
        samples.reacting_force
        + drill.load_spring_rate * samples.nodal_plane_position
        + drill.rpud_damping * samples.nodal_plane_velocity
    )
    quarter = len(without_weight_on_bit) // 4
    assert_allclose(without_weight_on_bit[:quarter], without_weight_on_bit[0], atol=1e-9)
    assert_allclose(without_weight_on_bit[quarter + 1 :], 25.0, atol=1e-9)


def test_no_times_give_no_samples_and_samples_do_not_change():
    [block] = run("free", blocks=1)
    samples = block.sample(Times.from_grid(5, 0, 1000))
    assert {len(values) for values in dataclasses.asdict(samples).values()} == {0}
    for values in dataclasses.asdict(block.sample(Times.from_nanoseconds(0))).values():
        assert len(values) == 1
    for name in ("contact_force", "in_contact"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(samples, name)[:] = 1.0


@given(st.integers(0, 2**40), st.integers(1, 1_000_000))
def test_a_grid_is_exact_to_the_last_bit_however_late(first, rate):
    times = Times.from_grid(first, 3, rate)
    assert times.seconds.dtype == np.int64
    for number in range(3):
        exact = Fraction(first + number, rate)
        seconds = exact.numerator // exact.denominator
        assert times.seconds[number] == seconds
        assert times.fraction[number] == float(exact - seconds)


@given(st.integers(0, 2**62))
def test_nanoseconds_are_exact(time):
    times = Times.from_nanoseconds(time)
    assert int(times.seconds[0]) * SECOND + round(times.fraction[0] * SECOND) == time
    assert 0.0 <= times.fraction[0] < 1.0


def test_a_late_time_is_as_exact_as_an_early_one():
    """A segment a hundred years after time zero has the same motion as one at time zero."""
    segments, times = whole(run("drilling", blocks=1)).copy(), Times.from_grid(0, 1000, 4000)
    expected = sample(segments, times)
    segments["start_seconds"] += (late := 100 * 365 * 24 * 3600)
    found = sample(segments, Times(times.seconds + late, times.fraction))
    for name in CHANNELS:
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name


END = 100_000_000


@pytest.fixture(scope="module", params=["free", "drilling"])
def block(request):
    simulation = Simulation(preset(request.param), 0.1)
    simulation.advance_to(END // 3)
    simulation.apply(WeightOnBit(25.0))
    simulation.advance_to(END // 2)
    return simulation.advance_to(END)


def messages(block):
    return [SimpleNamespace(**fields) for fields in trajectory_messages(block.segments, 0, 0)]


def test_segments_come_back_bit_for_bit(block):
    found = np.concatenate([to_segments(message) for message in messages(block)])
    for name in block.segments.dtype.names:
        assert found[name].tobytes() == block.segments[name].tobytes(), name


def test_arrays_of_unequal_length_are_refused(block):
    message = messages(block)[0]
    message.contact = message.contact[:1]
    with pytest.raises(ValueError, match="contact has 1 values, and duration"):
        to_segments(message)


@settings(max_examples=20)
@given(
    rate=st.sampled_from([1, 999, 16_000, 50_000, 1_234_567]),
    cuts=st.lists(st.integers(0, 10_000), max_size=5),
)
def test_however_it_is_cut_the_samples_are_those_of_the_whole(block, rate, cuts):
    segments = block.segments
    rebuilder = Rebuilder(rate)
    pieces = np.split(segments, sorted(cut % len(segments) for cut in cuts))
    found = [item for piece in pieces for item in rebuilder.add(piece)]
    found += rebuilder.finish()
    last = segments[-1]
    end = last["start_seconds"] + last["start_fraction"] + last["duration"]
    # The block begins within a segment: its own samples begin there.
    first = -(-block.start * rate // SECOND)
    expected = block.sample(Times.from_grid(first, max(0, int(np.ceil(end * rate)) - first), rate))
    start = found[0][0] if found else first
    for number, samples in found:  # without a gap
        assert number == start
        start += len(samples.in_contact)
    for name in CHANNELS if found else ():
        made = np.concatenate([getattr(samples, name) for _, samples in found])
        assert made[first - found[0][0] :].tobytes() == getattr(expected, name).tobytes()
    assert found or not len(expected.in_contact)
