"""Sums in compiled code: those of NumPy, to the last bit."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support import examples

from rpud_sim.model.compile import compiled
from rpud_sim.model.tally import pairwise_sum


@compiled
def sum_of(values):
    return pairwise_sum(values)


@settings(max_examples=examples(60), deadline=None)
@given(
    st.integers(1, 5000),
    st.integers(0, 2**32 - 1),
    st.floats(0.0, 300.0),
    st.sampled_from([0.0, 1e300, np.inf, np.nan, -0.0]),
)
@example(1, 0, 1.0, -0.0)
@example(8, 0, 1.0, 0.0)
@example(128, 0, 1.0, 0.0)
@example(129, 0, 1.0, 0.0)
@example(5000, 0, 1.0, 0.0)
def test_a_pairwise_sum_has_the_bits_of_numpy(count, seed, decades, special):
    random = np.random.default_rng(seed)
    values = random.choice([-1.0, 1.0], count) * 10.0 ** random.uniform(-decades, 4.0, count)
    values[random.integers(count)] = special
    records = np.zeros(count, [("before", np.int64), ("value", np.float64)])
    records["value"] = values
    with np.errstate(all="ignore"):
        expected = np.sum(records["value"])
    assert np.float64(sum_of(records["value"])).tobytes() == expected.tobytes() or (
        np.isnan(expected) and np.isnan(sum_of(records["value"]))
    )
