"""Waveforms made of trajectory messages are those that the simulation samples, bit for bit."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import trajectory_messages

from rpud_sim.simulation import preset
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.sampling import CHANNELS, Rebuilder, Times, to_segments
from rpud_sim.simulation.simulation import Simulation

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
    lengths = [len(samples.in_contact) for _, samples in found]
    starts = [number for number, _ in found]
    assert starts[1:] == [start + n for start, n in zip(starts, lengths, strict=True)][:-1]
    last = segments[-1]
    end = last["start_seconds"] + last["start_fraction"] + last["duration"]
    assert (starts[-1] + lengths[-1] - 1) / rate < end if found else end - block.start / 1e9 < 1
    # The block begins within a segment: its own samples begin there.
    first = -(-block.start * rate // 10**9)
    skipped = max(0, first - starts[0]) if found else 0
    count = sum(lengths) - skipped
    expected = block.sample(Times.from_grid(first, max(0, count), rate))
    for name in CHANNELS if count > 0 else ():
        made = np.concatenate([getattr(samples, name) for _, samples in found])
        assert made[skipped:].tobytes() == getattr(expected, name).tobytes()
