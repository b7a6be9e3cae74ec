"""Steps of a value are exact while they are few."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.inspection.report.changing_value import ChangingValue


@given(
    st.lists(st.tuples(st.sampled_from([0.0, 1.0, 5.0]), st.booleans()), min_size=1, max_size=60)
)
def test_the_steps_have_every_value_at_its_time(items):
    values = np.array([value for value, _ in items])
    times = np.arange(len(values)) * 0.5
    found = ChangingValue()
    cuts = [place for place, (_, cut) in enumerate(items) if cut]
    for part in np.split(np.arange(len(values)), cuts):
        found.add(times[part], values[part])
    starts, held = found.steps()
    assert starts[-1] == times[-1]
    np.testing.assert_array_equal(
        held[np.searchsorted(starts[:-1], times, side="right") - 1], values
    )
    assert np.count_nonzero(np.diff(held[:-1]) == 0.0) == 0


def test_too_many_changes_are_given_up():
    found = ChangingValue()
    assert found.steps() is None
    for start in range(0, 2000, 100):
        times = start + np.arange(100.0)
        found.add(times, times)
    assert found.steps() is None
    constant = ChangingValue()
    for start in range(0, 100_000, 1000):
        constant.add(start + np.arange(1000.0), np.full(1000, 7.0))
    times, values = constant.steps()
    assert (list(times), list(values)) == ([0.0, 99_999.0], [7.0, 7.0])
    assert times[-1] == pytest.approx(constant.last)
