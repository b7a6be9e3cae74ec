"""Verdicts: margin with unit, the instant, and the time to react."""

import pytest
from random_expectations import record_of
from sample_bags import SECOND

from rpud_sim.verdicts import (
    Active,
    Cleared,
    Expectation,
    Onset,
    Published,
    Record,
    after,
    always,
    count,
    evaluate,
    eventually,
    quantile,
    signal,
    unless,
    until,
)
from rpud_sim.verdicts.notation import to_text
from rpud_sim.verdicts.verdict import latest_values

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
        record.add("status", time, {"weight_on_bit": weight, "state": "running"})
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
        "text": "status.weight_on_bit was 0 N at 1.2 s; "
        "required: always(status.weight_on_bit == 10 N)",
    }


STATE = signal("status.state")
NO_LATER = "never came in the record from 0 s until 4 s"


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        (always(WEIGHT < "9 N"), "status.weight_on_bit was 10 N at 0 s"),
        (always((WEIGHT > "5 N").implies(STATE.has_text("paused"))),
         "status.weight_on_bit was 10 N at 0 s; status.state was running at 0 s"),
        (always((WEIGHT > "5 N") & STATE.has_text("running")),
         "status.weight_on_bit was 0 N at 1.2 s"),
        (after(Onset(JAMMED), WEIGHT.equals("0 N")),
         "onset(free_mass_jammed) came at 1 s; status.weight_on_bit was 10 N at 1 s"),
        (eventually(WEIGHT.equals("0 N"), within="0.9 s"), "status.weight_on_bit was 10 N at 0.9 s;"
         " status.weight_on_bit == 0 N came 0.3 s too late, at 1.2 s"),
        (eventually(WEIGHT < "0 N"), "status.weight_on_bit was 10 N at 4 s; "
         f"status.weight_on_bit < 0 N {NO_LATER}"),
        (eventually(Cleared(JAMMED), within="2.5 s"),
         "cleared(free_mass_jammed) came 0.5 s too late, at 3 s"),
        (until(STATE.has_text("running"), WEIGHT.equals("0 N"), within="1 s"),
         "status.weight_on_bit was 10 N at 1 s; "
         "status.weight_on_bit == 0 N came 0.2 s too late, at 1.2 s"),
        (until(WEIGHT > "5 N", Cleared(JAMMED)), "status.weight_on_bit was 0 N at 1.2 s"),
        (~eventually(WEIGHT.equals("0 N")), "status.weight_on_bit was 0 N at 1.2 s"),
        (always(~Active(JAMMED)), "fault(free_mass_jammed) held at 1 s"),
        (~eventually(Onset(JAMMED)), "onset(free_mass_jammed) came at 1 s"),
        (count(Published("status"), ">", 5, within="2 s"),
         "message(status) came 2 times from 0 s until 2 s"),
        (quantile(0.5, WEIGHT, "<", "9 N"),
         "quantile 0.5 of status.weight_on_bit was 10 N from 0 s until 4 s"),
        (WEIGHT < "9 N", "status.weight_on_bit was 10 N at 0 s"),
        (always(Onset(JAMMED)), "broken at 0 s"),
    ],
)  # fmt: skip
def test_a_failed_verdict_says_what_was_there_and_how_late_it_came(jammed, formula, text):
    found = verdict(formula, jammed)
    assert (found.outcome, found.text) == ("failed", f"{text}; required: {to_text(formula)}")


def test_a_requirement_that_is_its_own_name_is_said_once(jammed):
    formula = always(WEIGHT < "9 N")
    found = evaluate(Expectation(to_text(formula), formula), jammed)
    assert found.text == "status.weight_on_bit was 10 N at 0 s"


def test_a_value_is_on_its_side_of_the_limit_and_bounds_where_it_is_not_known():
    record = record_of(force={0: 450.0000001, SECOND: 10.0})
    found = verdict(always(FORCE < "450 N"), record)
    assert found.text.startswith("reacting_force.force was 450.0000001 N at 0 s; ")
    record = record_of()
    for force in (10.0, 50.0):  # of one stamp, in no known order
        record.add("reacting_force", SECOND, {"force": force})
    found = verdict(always(FORCE < "5 N"), record)
    assert found.text.startswith("reacting_force.force was 10 to 50 N at 0 s; ")
    record.add_losses("reacting_force", 3)
    found = verdict(count(Published("reacting_force"), "<", 2), record)
    assert found.text.startswith("message(reacting_force) came 2 to 5 times from 0 s until 0 s; ")


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        ((WEIGHT < "9 N") & STATE.has_text("paused"),
         "status.weight_on_bit was 10 N at 4 s; status.state was running at 4 s"),
        (eventually(WEIGHT < "9 N"), "status.weight_on_bit was 10 N at 4 s; "
         "status.weight_on_bit < 9 N never came in the record from 4 s until 4 s"),
        (FORCE > "45 N", "reacting_force.force has no value at 4 s"),
        (Onset(JAMMED), ""),
        (count(Published("status"), ">", 9, within="1 s"),
         "message(status) came at least 1 times from 4 s until 4 s"),
        (quantile(0.5, FORCE, ">", "45 N"), ""),
    ],
)  # fmt: skip
def test_the_latest_values_are_of_the_end_of_a_record(jammed, formula, text):
    assert latest_values(Expectation("it", formula), jammed) == text
    assert latest_values(Expectation("it", formula), Record()) == ""
