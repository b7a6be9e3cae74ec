"""Laws of expectations: negation, duality, margins and files."""

import math

import pytest
import yaml
from hypothesis import example, given, settings
from random_expectations import TOPICS, formulas
from support import examples

from rpud_sim.foundation.time import SECOND
from rpud_sim.verdicts import Expectation, Record, evaluate, read_expectations
from rpud_sim.verdicts.formulas import (
    WHOLE,
    After,
    Count,
    Formula,
    Message,
    Not,
    Number,
    Quantile,
    Signal,
    Until,
    Window,
)
from rpud_sim.verdicts.notation import to_plain
from rpud_sim.verdicts.verdict import FAILED, PASSED, UNDECIDED

OPPOSITE = {PASSED: FAILED, FAILED: PASSED, UNDECIDED: UNDECIDED}
PEAK = Signal("contact_force", "peak_force")


@pytest.fixture(scope="module")
def record(faulty_bag):
    return Record.from_bag(faulty_bag, TOPICS)


def verdict(formula: Formula, record):
    return evaluate(Expectation("any", formula), record)


@given(formulas())
def test_negation_turns_the_verdict_and_the_sign_of_the_margin(record, formula):
    plain, negated = verdict(formula, record), verdict(Not(formula), record)
    assert negated.outcome == OPPOSITE[plain.outcome]
    assert negated.margin == (None if plain.margin is None else -plain.margin)


@given(formulas())
def test_the_verdict_is_the_sign_of_the_margin(record, formula):
    found = verdict(formula, record)
    if found.outcome == UNDECIDED:
        assert found.margin is found.at is None
    elif found.margin is not None:
        assert math.isfinite(found.margin)
        assert found.margin >= 0.0 if found.passed else found.margin <= 0.0
    assert "\n" not in found.text


@given(formulas())
def test_a_file_gives_the_same_expectations_back(tmp_path_factory, formula):
    path = tmp_path_factory.getbasetemp() / "expectations.yaml"
    entry = {"name": "a name: with #signs", "requirement": "REQ-1", "expect": to_plain(formula)}
    path.write_text(yaml.safe_dump({"expectations": [entry]}), encoding="utf-8")
    assert read_expectations(path) == (Expectation(entry["name"], formula, "REQ-1"),)


@settings(max_examples=examples(30))
@given(formulas())
@example(Quantile(0.01, PEAK, "<", Number(1.0, "kN"), Window(0, 0)))  # impacts are missing later
@example(Count(Message("contact_force"), "<=", 1, Window(0, SECOND // 1000)))
@example(Not(Count(Message("contact_force", PEAK > "1 kN"), ">=", 1000, Window(0, SECOND // 2))))
def test_a_verdict_that_is_decided_early_stays(record, faulty_messages, formula):
    """What is decided in a bounded window stays so, however long the recording goes on."""
    if any(isinstance(part, (After, Until)) for part in formula.walk()):
        return
    if any(getattr(part, "window", None) == WHOLE for part in formula.walk()):
        return
    short = Record()
    for message in faulty_messages:
        if message[1] <= 7 * SECOND // 10:
            short.add(*message)
    early = verdict(formula, short)
    if early.outcome != UNDECIDED:
        assert early.outcome == verdict(formula, record).outcome
