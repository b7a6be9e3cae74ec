"""Steps of a value keep its gaps, and marks of several drills say whose they are."""

from types import SimpleNamespace

import numpy as np

from rpud_sim.inspection.report.changes import Change
from rpud_sim.inspection.report.changing_value import ChangingValue
from rpud_sim.inspection.report.drill_topics import Fault, FaultLog, Journal
from rpud_sim.inspection.report.run_marks import exact_steps, run_marks
from rpud_sim.inspection.report.running_statistics import Envelope
from rpud_sim.pages.plot import COMMAND, FAULT


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


def test_marks_say_whose_they_are_where_there_are_several_drills():
    change = [Change(-1.0, "before the bag", ""), Change(1.0, "weight on bit 5 N", "")]
    log = FaultLog({(0, 1): Fault(1, "bias", "wrench", 1.0, 2.0, None)})
    journal = SimpleNamespace(changes=change)
    seen = SimpleNamespace(journals={"/a/journal": journal}, faults={"/a/faults": log}, topics={})
    found = [(mark.kind, mark.time, mark.end, mark.text) for mark in run_marks(seen)]
    assert found == [
        (COMMAND, 1.0, None, "weight on bit 5 N"),
        (FAULT, 2.0, None, "bias wrench"),
    ]
    seen.journals["/b/journal"], seen.faults["/b/faults"] = Journal(), FaultLog()
    assert [mark.text for mark in run_marks(seen)] == ["/a: weight on bit 5 N", "/a: bias wrench"]
