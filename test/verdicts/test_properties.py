"""Laws of expectations: negation, margins, files; and the same verdict live and over a bag."""

import math
import random

import pytest
import yaml
from hypothesis import example, given, settings
from random_expectations import TOPICS, formulas
from support import examples

from rpud_sim.foundation.time import SECOND
from rpud_sim.verdicts import Expectation, Record, evaluate, read_expectations
from rpud_sim.verdicts import formulas as f
from rpud_sim.verdicts.notation import to_plain
from rpud_sim.verdicts.verdict import FAILED, PASSED, UNDECIDED

OPPOSITE = {PASSED: FAILED, FAILED: PASSED, UNDECIDED: UNDECIDED}
PEAK = f.Signal("contact_force", "peak_force")


@pytest.fixture(scope="module")
def record(faulty_bag):
    return Record.from_bag(faulty_bag, TOPICS)


def verdict(formula: f.Formula, record):
    return evaluate(Expectation("any", formula), record)


@given(formulas())
def test_a_verdict_is_the_sign_of_its_margin_and_negation_turns_both(record, formula):
    found, negated = verdict(formula, record), verdict(f.Not(formula), record)
    assert negated.outcome == OPPOSITE[found.outcome]
    assert negated.margin == (None if found.margin is None else -found.margin)
    if found.outcome == UNDECIDED:
        assert found.margin is found.at is None
    elif found.margin is not None:
        assert math.isfinite(found.margin)
        assert found.margin >= 0.0 if found.passed else found.margin <= 0.0
    assert not set("\n{}[]").intersection(found.text)


@given(formulas())
def test_a_file_gives_the_same_expectations_back(tmp_path_factory, formula):
    path = tmp_path_factory.getbasetemp() / "expectations.yaml"
    entry = {"name": "a name: with #signs", "requirement": "REQ-1", "expect": to_plain(formula)}
    path.write_text(yaml.safe_dump({"expectations": [entry]}), encoding="utf-8")
    assert read_expectations(path) == (Expectation(entry["name"], formula, "REQ-1"),)


@settings(max_examples=examples(30))
@given(formulas())
@example(
    f.Quantile(0.01, PEAK, "<", f.Number(1.0, "kN"), f.Window(0, 0))
)  # impacts are missing later
@example(f.Count(f.Published("contact_force"), "<=", 1, f.Window(0, SECOND // 1000)))
@example(
    f.Not(
        f.Count(f.Published("contact_force", PEAK > "1 kN"), ">=", 1000, f.Window(0, SECOND // 2))
    )
)
def test_a_verdict_that_is_decided_early_stays(record, faulty_messages, formula):
    """What is decided in a bounded window stays so, however long the recording goes on."""
    if any(isinstance(part, (f.After, f.Until)) for part in formula.walk()):
        return
    if any(getattr(part, "window", None) == f.WHOLE for part in formula.walk()):
        return
    short = Record()
    for message in faulty_messages:
        if message[1] <= 7 * SECOND // 10:
            short.add(*message)
    early = verdict(formula, short)
    if early.outcome != UNDECIDED:
        assert early.outcome == verdict(formula, record).outcome


@pytest.fixture(scope="module")
def live(faulty_messages):
    """Record messages in any order, and some of them twice; of ``status`` in theirs."""
    record = Record()
    source = random.Random(1)
    numbers = [*range(len(faulty_messages))]
    numbers += source.sample(numbers, 200)
    source.shuffle(numbers)
    reports = iter(sorted(n for n in numbers if faulty_messages[n][0] == "status"))
    for number in numbers:
        is_report = faulty_messages[number][0] == "status"
        record.add(*faulty_messages[next(reports) if is_report else number])
    return record


@settings(max_examples=examples(100))
@given(formulas())
def test_a_verdict_is_the_same_live_and_over_the_bag_with_no_topic_but_its_own(
    faulty_bag, record, live, formula
):
    expectation = Expectation("any", formula)
    own = Record.from_bag(faulty_bag, expectation.topics)
    verdict = evaluate(expectation, record)
    assert evaluate(expectation, live) == evaluate(expectation, own) == verdict
