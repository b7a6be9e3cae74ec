"""Runs of one drill are seldom called different, and changes of a tenth are found."""

import numpy as np
import pytest

from bench.compare_study import alarms
from rpud_sim.simulation import preset

DRILLING = preset("drilling")
PAIRS = 100


def test_false_alarms_are_as_rare_as_it_says():
    # With 5 % and 100 pairs, more than 13 alarms have a probability of 0.05 %.
    found = alarms(DRILLING, DRILLING, 2, PAIRS)
    assert np.count_nonzero(found) <= 13


@pytest.mark.parametrize("name", ["weight_on_bit", "vibration_amplitude"])
def test_a_change_of_a_tenth_is_found(name):
    other = DRILLING.replace(**{name: 1.1 * getattr(DRILLING, name)})
    assert np.count_nonzero(alarms(DRILLING, other, 20, 3)) == 3
