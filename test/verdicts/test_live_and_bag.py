"""The same expectation has the same verdict live and over a bag."""

import random
from collections import Counter

import pytest
from random_expectations import TOPICS, RandomFormulas, messages_of

from rpud_sim.verdicts import Expectation, Record, evaluate
from rpud_sim.verdicts.names import TYPES
from rpud_sim.verdicts.verdict import OUTCOMES


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


def test_random_expectations_have_the_same_verdict_live_and_over_the_bag(faulty_bag, live):
    recorded = Record.from_bag(faulty_bag, TOPICS)
    source = RandomFormulas(random.Random(13))
    outcomes = Counter()
    for number in range(300):
        expectation = Expectation(f"number {number}", source.formula())
        verdict = evaluate(expectation, recorded)
        assert evaluate(expectation, live) == verdict, expectation
        outcomes[verdict.outcome] += 1
    assert all(outcomes[outcome] > 15 for outcome in OUTCOMES), outcomes


def test_a_verdict_depends_on_no_topic_but_those_of_its_expectation(faulty_bag, live):
    source = RandomFormulas(random.Random(14))
    for number in range(20):
        expectation = Expectation(f"number {number}", source.formula())
        record = Record.from_bag(faulty_bag, expectation.topics)
        assert evaluate(expectation, record) == evaluate(expectation, live), expectation


@pytest.mark.parametrize("topic", ["waveform", "trajectory"])
def test_blocks_are_samples_live_as_in_the_bag(faulty_bag, topic):
    recorded, live = Record.from_bag(faulty_bag, [topic]), Record()
    for message in messages_of(faulty_bag, [topic]):
        live.add(*message)
    assert len(live.messages(topic)) == len(recorded.messages(topic)) > 1000
    assert (live.messages(topic).stamps == recorded.messages(topic).stamps).all()
    assert topic in TYPES
