"""Verdicts: margin with unit, the instant, and the time to react."""

import pytest
from random_expectations import record_of
from sample_bags import SECOND

from rpud_sim.verdicts import (
    Cleared,
    Expectation,
    Onset,
    Record,
    after,
    always,
    evaluate,
    eventually,
    signal,
    unless,
    until,
)

FORCE = signal("reacting_force.force")
WEIGHT = signal("status.weight_on_bit")
HALF = SECOND // 2
JAMMED = "free_mass_jammed"


def verdict(formula, record):
    return evaluate(Expectation("it", formula, "REQ-1"), record)


def fault(onset, clear):
    def time(nanoseconds):
        return {"sec": nanoseconds // SECOND, "nanosec": nanoseconds % SECOND}

    names = {"number": 1, "kind": JAMMED, "channel": "", "active": clear is None}
    times = {"onset": time(onset), "clear": time(clear or 0)}
    return {"faults": [{**names, **times}], "forgotten": 0}


@pytest.fixture
def jammed():
    """Return a record of a fault from 1 s to 3 s, and a weight on bit of zero from 1.2 s."""
    record = Record()
    record.add("faults", 0, {"faults": [], "forgotten": 0})
    record.add("faults", SECOND, fault(SECOND, None))
    record.add("faults", 3 * SECOND, fault(SECOND, 3 * SECOND))
    for time, weight in ((0, 10.0), (12 * SECOND // 10, 0.0), (4 * SECOND, 10.0)):
        record.add("status", time, {"weight_on_bit": weight})
    return record


def test_a_margin_has_the_unit_of_the_field_and_the_instant_is_when_it_broke():
    record = record_of(force={0: 10.0, HALF: 50.0, SECOND: 10.0})
    found = verdict(always(FORCE < "0.045 kN"), record)
    assert (found.outcome, found.margin, found.unit, found.at) == ("failed", -5.0, "N", 0.5)
    assert (found.name, found.requirement, found.passed) == ("it", "REQ-1", False)
    found = verdict(always(FORCE < "0.06 kN"), record)
    assert (found.outcome, found.margin, found.unit, found.at) == ("passed", 10.0, "N", 1.0)
    found = verdict(eventually(FORCE > "45 N"), record)
    assert (found.outcome, found.margin, found.at) == ("passed", 5.0, 0.5)
    found = verdict(until(FORCE < "45 N", FORCE > "45 N"), record)
    assert (found.outcome, found.margin, found.at) == ("passed", 5.0, 0.5)


def test_comparisons_in_several_units_have_mixed_margins():
    record = record_of(force={0: 10.0}, velocity={0: 1.0})
    found = verdict((FORCE < "45 N") & (signal("nodal_plane.velocity") < "2 m/s"), record)
    assert (found.margin, found.unit) == (1.0, "mixed units")


def test_the_reaction_time_is_that_from_the_event_to_the_fulfilment(jammed):
    reaction = eventually(unless(WEIGHT.equals("0 N"), Cleared(JAMMED)), within="0.5 s")
    found = verdict(after(Onset(JAMMED), reaction), jammed)
    assert (found.outcome, found.margin) == ("passed", 0.0)
    assert found.reaction_time == pytest.approx(0.2)
    late = eventually(WEIGHT.equals("0 N"), within="0.1 s")
    found = verdict(after(Onset(JAMMED), late), jammed)
    assert (found.outcome, found.margin, found.at) == ("failed", -10.0, 1.1)
    assert found.reaction_time == pytest.approx(0.2)


def test_a_verdict_has_plain_content(jammed):
    found = verdict(always(WEIGHT.equals("10 N")), jammed).to_dict()
    assert found == {
        "name": "it",
        "requirement": "REQ-1",
        "outcome": "failed",
        "passed": False,
        "margin": -10.0,
        "unit": "N",
        "at": 1.2,
        "reaction_time": None,
        "text": "broken at 1.2 s",
    }
