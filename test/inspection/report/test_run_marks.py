"""Steps of a value keep its gaps."""

import numpy as np

from rpud_sim.inspection.report.changing_value import ChangingValue
from rpud_sim.inspection.report.run_marks import exact_steps
from rpud_sim.inspection.report.running_statistics import Envelope


def steps(times, values, factor=1.0):
    changing, envelope = ChangingValue(), Envelope(10.0)
    changing.add(times, values)
    envelope.add(times, values)
    return exact_steps(changing, envelope, factor)


def test_no_step_crosses_a_gap():
    times = np.append(np.arange(0.0, 4.0, 0.01), np.arange(6.0, 10.0, 0.01))
    values = np.where(times < 7.0, 1.0, 2.0)
    found, held = steps(times, values, 10.0)
    inside = (found > 4.1) & (found < 5.9)
    assert not inside.any()
    [gap] = np.flatnonzero(np.isnan(held))
    assert 3.9 < found[gap] < 4.1
    assert 5.9 < found[gap + 1] < 6.1
    assert (held[gap - 1], held[gap + 1]) == (10.0, 10.0)
    assert (held[-1], found[-1]) == (20.0, times[-1])
