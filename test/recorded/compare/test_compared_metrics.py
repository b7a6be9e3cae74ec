"""Intervals of metrics hold: equal drills seldom differ, and a change of a tenth is found."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import examples

from rpud_sim.foundation.time import SECOND
from rpud_sim.recorded.compare.metrics import (
    DIFFERS,
    NONE_FOUND,
    SAME,
    TOO_FEW,
    UNDECIDED,
    RecordedValues,
    differences,
)
from rpud_sim.recorded.runs import RecordedRun
from rpud_sim.simulation import Parameters, Times, preset
from rpud_sim.simulation.simulation import Simulation

DRILLING = preset("drilling")
RATE = 100
COLUMNS = ("peak_force", "impact_velocity", "energy", "contact_duration")


def simulated_values(parameters: Parameters, phase: float, duration: int) -> RecordedValues:
    """Return the values of a run of whole seconds, as a bag of it would give them."""
    simulation = Simulation(parameters, phase)
    impacts, forces, positions = [], [], []
    for second in range(duration):
        block = simulation.advance_to((second + 1) * SECOND)
        impacts.append(block.impacts.copy())
        samples = block.sample(Times.from_grid(second * RATE, RATE, RATE))
        forces.append(samples.reacting_force.copy())
        positions.append(samples.nodal_plane_position.copy())
    found = np.concatenate(impacts)
    times = np.arange(duration * RATE) / RATE
    return RecordedValues(
        RecordedRun("", "/journal"),
        {
            "contact_force": {
                "time": found["seconds"] + found["fraction"],
                "sequence": found["sequence"].astype(float),
                **{name: found[name] for name in COLUMNS},
            },
            "reacting_force": {"time": times, "force": np.concatenate(forces)},
            "nodal_plane": {"time": times, "position": np.concatenate(positions)},
        },
    )


def pairs_that_differ(first, second, duration, pairs):
    phases = np.random.default_rng(5).random((pairs, 2)).tolist()
    return sum(
        any(
            each.result == DIFFERS
            for each in differences(
                [simulated_values(first, a, duration), simulated_values(second, b, duration)],
                *(0.5, float(duration)),
            )
        )
        for a, b in phases
    )


@pytest.mark.extended
def test_false_alarms_are_as_rare_as_it_says():
    # With 5 % and 100 pairs, more than 13 alarms have a probability of 0.05 %.
    assert pairs_that_differ(DRILLING, DRILLING, 2, 100) <= 13


@pytest.mark.parametrize("name", ["weight_on_bit", "vibration_amplitude"])
def test_a_change_of_a_tenth_is_found(name):
    other = DRILLING.replace(**{name: 1.1 * getattr(DRILLING, name)})
    assert pairs_that_differ(DRILLING, other, 20, 3) == 3


def sampled(values):
    """Return a run of ten seconds with a reacting force alone."""
    times = np.linspace(0.0, 10.0, len(values), endpoint=False)
    return RecordedValues(
        RecordedRun("", "/journal"), {"reacting_force": {"time": times, "force": np.array(values)}}
    )


def values(count, mean=100.0, seed=0):
    return np.random.default_rng(seed).normal(mean, 10.0, count)


def compared(first, second, tolerance=0.0):
    runs = [sampled(first), sampled(second)]
    return differences(runs, 0.0, 10.0, tolerance=tolerance)


def test_intervals_cover_the_true_difference():
    pairs = [compared(values(320, seed=n), values(320, 105.0, seed=1000 + n)) for n in range(200)]
    held = np.mean([all(each.low <= 5.0 <= each.high for each in pair) for pair in pairs])
    assert 0.91 <= held <= 0.99


@pytest.mark.parametrize(
    ("count", "mean", "tolerance", "result"),
    [
        (500, 100.0, 0.0, NONE_FOUND),
        (500, 110.0, 0.0, DIFFERS),
        (500, 102.0, 0.05, SAME),
        (500, 105.0, 0.05, UNDECIDED),
        (500, 110.0, 0.05, DIFFERS),
        (500, 90.0, 0.05, DIFFERS),
        (48, 100.0, 0.001, UNDECIDED),
        (39, 100.0, 0.0, TOO_FEW),
    ],
)
def test_results(count, mean, tolerance, result):
    found = compared(values(count), values(max(count, 48), mean, seed=1), tolerance)[0]
    assert found.result == result
    assert math.isnan(found.low) == (result == TOO_FEW)


def test_a_metric_that_may_be_zero_has_no_ratio_and_is_compared_without_tolerance():
    found = compared(values(500, 0.0), values(500, 0.0, seed=1), 0.01)[0]
    assert math.isnan(found.relative_low)
    assert found.result == NONE_FOUND
    assert compared(values(500, 0.0), values(500, 5.0, seed=1), 0.01)[0].result == DIFFERS


@pytest.mark.parametrize("seed", range(20))
def test_a_result_agrees_with_both_of_its_intervals(seed):
    other = 100.0 + 2.0 * np.random.default_rng(seed).normal()
    for found in compared(values(500), values(500, other, seed=seed)):
        if found.result != TOO_FEW:
            outside = not found.low <= 0.0 <= found.high
            assert outside == (found.result == DIFFERS)
            if not math.isnan(found.relative_low):
                assert outside == (not found.relative_low <= 0.0 <= found.relative_high)


@settings(max_examples=examples(50))
@given(
    *[st.lists(st.floats(-1e12, 1e12), min_size=1, max_size=80)] * 2,
    st.sampled_from([0.0, 0.05]),
)
def test_any_values_give_a_result(first, second, tolerance):
    for found in compared(first, second, tolerance):
        assert found.result in (DIFFERS, SAME, NONE_FOUND, UNDECIDED, TOO_FEW)
        assert math.isnan(found.low) == math.isnan(found.high) == (found.result == TOO_FEW)
