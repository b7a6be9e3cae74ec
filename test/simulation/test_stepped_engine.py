"""The engine for short advances gives the bits of the other one, at less cost."""

import copy
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpud_sim.model.drill import STATE, derive
from rpud_sim.model.engine import Engine, EngineError
from rpud_sim.model.parameters import Parameters
from rpud_sim.model.resonator import Resonance
from rpud_sim.model.segment import IMPACT, SEGMENT
from rpud_sim.simulation.stepped_engine import SteppedEngine, machine_code, reader_of

FREE, ROCK = Parameters(regime="free"), Parameters(regime="drilling")
RESONANCE = Resonance(0.01, 100.0, 3.5e-7, 100.0, 16000.0, 16010.0)


def values_of(records):
    """All fields of records; the bytes between two fields mean nothing."""
    return [records[name].tolist() for name in records.dtype.names]


def steps(engines, pitches, weights, drill=None, resonant=False):
    """Advance engines alike, with a change after each step; yield the ends of the steps."""
    time = 0.0
    for pitch, weight in zip(pitches, weights, strict=True):
        for engine in engines:
            engine.advance(0, time + pitch)
            commands = (weight, 80.0, 16000.0) if resonant else (weight, 35e-6, 16000.0)
            engine.change(
                0, time + pitch, drill or derive(ROCK), commands, 16010.0 if resonant else 0.0
            )
        time += pitch
        yield time


@given(
    st.lists(st.sampled_from([0.0, 1e-5, 1e-3, 7e-3]), min_size=8, max_size=8),
    st.lists(st.floats(0.0, 40.0), min_size=8, max_size=8),
    st.sampled_from([FREE, ROCK]),
    st.sampled_from([None, RESONANCE]),
)
@settings(deadline=None, max_examples=25)
def test_changes_after_each_step_give_the_bits_of_the_engine(pitches, weights, start, resonance):
    engines = [kind(start, 0.3, True, resonance) for kind in (Engine, SteppedEngine)]
    for time in steps(engines, pitches, weights, resonant=resonance is not None):
        one, other = ([values_of(part) for part in engine.drain_covering()] for engine in engines)
        assert one == other
        assert engines[0].amplitude == engines[1].amplitude
        assert engines[0].account(0, time) == engines[1].account(0, time)
    assert engines[0].impact_count == engines[1].impact_count


def test_a_long_block_has_all_of_its_records():
    engines = [Engine(ROCK), SteppedEngine(ROCK)]
    counts = []
    for end in (6, 7):  # after a long block it goes on with less room
        for engine in engines:
            engine.advance(end, 0.5)
        one, other = ([values_of(part) for part in engine.drain_covering()] for engine in engines)
        assert one == other
        counts.append(len(one[0][0]))
    assert counts[0] > 4096 > counts[1]


def test_impacts_are_seen_before_they_are_drained():
    engine = SteppedEngine(ROCK)
    seen = 0
    found = []
    for k in range(1, 40):
        engine.advance(0, k * 1e-3)
        found += values_of(engine.impacts_from(seen))[0]
        seen += len(engine.impacts_from(seen))
    _, impacts = engine.drain_covering()
    assert found == impacts["sequence"].tolist()
    assert len(engine.impacts_from(0)) == 0


def test_a_copy_goes_on_by_itself():
    engine = SteppedEngine(ROCK)
    engine.advance(0, 0.01)
    other = copy.deepcopy(engine)
    for each in (engine, other):
        each.advance(0, 0.05)
    one, two = ([values_of(part) for part in each.drain_covering()] for each in (engine, other))
    assert one == two


def test_it_is_advanced_step_by_step_alone():
    engine = SteppedEngine(ROCK)
    assert engine.advance_through(np.array([0]), np.array([0.1])) is None


def test_a_motion_that_is_not_finite_is_refused():
    engine = SteppedEngine(ROCK)
    engine.advance(0, 0.01)
    engine.change(0, 0.01, derive(ROCK), (math.inf, 35e-6, 16000.0))
    with pytest.raises(EngineError):
        engine.advance(0, 0.02)


def test_a_kernel_that_is_not_compiled_is_its_own_code():
    assert machine_code(math.sin, 1.0) is math.sin


def test_fields_are_read_from_the_first_record():
    generator = np.random.default_rng(3)
    for dtype in (STATE, SEGMENT, IMPACT):
        records = np.zeros(2, dtype)
        wide = [name for name in dtype.names if dtype[name].str[1:] in ("f8", "i8")]
        for name in wide:
            records[name] = generator.integers(-1000, 1000, 2)
        assert reader_of(dtype, *wide)(records) == tuple(records[name][0] for name in wide)
        assert reader_of(dtype, wide[-1])(records) == (records[wide[-1]][0],)
