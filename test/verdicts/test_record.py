"""Records: runs, losses, repetitions, silence, other clocks and other bags."""

import math

import numpy as np
import pytest
from altered_bags import copied, merged
from random_expectations import record_of
from sample_bags import SECOND, serialized

from rpud_sim import bag as bags
from rpud_sim.bag import Losses, Topic
from rpud_sim.bag.metadata import LOSSES_RECORD, losses_to_record
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.recorded import RecordingError
from rpud_sim.verdicts import (
    Becomes,
    Expectation,
    Published,
    Record,
    after,
    always,
    count,
    evaluate,
    eventually,
    quantile,
    signal,
)
from rpud_sim.verdicts.messages import TopicBatch, TopicMessages

FORCE = signal("reacting_force.force")
WEIGHT = signal("status.weight_on_bit")
PEAK = signal("contact_force.peak_force")


def outcome(formula, record):
    return evaluate(Expectation("it", formula), record).outcome


def entry(sequence, kind, time, stamp=None):
    content = {"sequence": sequence, "kind": kind, "content": f'{{"time": {time}}}'}
    return "journal", time if stamp is None else stamp, content


def impact(sequence, force):
    return {"sequence": sequence, "peak_force": force}


def test_messages_of_a_foreign_type_are_one_line():
    time = np.array([1])
    numbered = TopicBatch(time, time, {"log_time": time, "sequence": np.array([2**63], np.uint64)})
    with pytest.raises(ParameterError, match="no field 'kind'"):
        numbered.values("kind")
    with pytest.raises(ParameterError, match="journal: sequence: a number is too large"):
        TopicMessages("journal", [numbered])


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        (always(WEIGHT < "45 N"), "status has no message"),
        (always(FORCE < "45 N"), "reacting_force.force has no value at 1e-09 s"),
        (eventually(FORCE > "45 N", within="2 s"), "reacting_force.force has no value at 1e-09 s, "
         "or the record ends at 1 s, before it is decided"),
        (count(Published("reacting_force"), "<=", 9, within="2 s"),
         "the record ends at 1 s, before it is decided"),
        (after(FORCE > "45 N", FORCE < "90 N"), "the event of after never came: "
         "reacting_force.force > 45 N"),
        (after(Becomes(FORCE > "45 N"), FORCE < "90 N"), "the event of after never came: "
         "becomes(reacting_force.force > 45 N)"),
    ],
)  # fmt: skip
def test_an_undecided_verdict_says_why(formula, text):
    record = record_of(force={0: 10.0, 1: math.nan, 2: 10.0, SECOND: 10.0})
    for each in (formula, ~formula):
        found = evaluate(Expectation("it", each), record)
        assert (found.outcome, found.text) == ("undecided", text)


def test_a_periodic_topic_that_falls_silent_is_unknown_after_a_second():
    weight = {0: 10.0, 10 * SECOND: 10.0}
    short = record_of(force={0: 10.0, 9 * SECOND: 10.0}, weight=weight)
    assert outcome(always(FORCE < "45 N"), short) == "undecided"
    assert outcome(always(WEIGHT < "45 N"), short) == "passed"


def test_a_jump_in_the_numbers_of_impacts_matters_where_it_is():
    record = Record()
    for number, time in enumerate((0, 1, 2, 3, 4)):
        record.add("contact_force", time * SECOND, impact(number + (number > 2), 5000.0))
    expected = {
        always(PEAK < "6 kN"): "undecided",
        always(PEAK < "6 kN", within="1.9 s"): "passed",
        always(PEAK < "4 kN"): "failed",
        count(Published("contact_force"), "==", 5): "undecided",
        count(Published("contact_force"), ">=", 5): "passed",
        count(Published("contact_force"), "<=", 6): "passed",
        count(Published("contact_force"), "<", 5): "failed",
        quantile(0.5, PEAK, "<", "6 kN"): "passed",
        quantile(1.0, PEAK, "<", "6 kN"): "undecided",
        quantile(1.0, PEAK, "<", "6 kN", within="1.9 s"): "passed",
        quantile(1.0, PEAK, "<", "6 kN", within="2 s"): "undecided",
        quantile(1.0, PEAK, "<", "6 kN", between=("3.5 s", "4 s")): "passed",
        count(Published("contact_force"), "==", 2, within="1.9 s"): "passed",
        count(Published("contact_force"), "==", 3, within="2 s"): "undecided",
        eventually(Published("contact_force"), within="1.9 s"): "passed",
        ~eventually(Published("contact_force", PEAK > "6 kN"), within="1.9 s"): "passed",
        ~eventually(Published("contact_force", PEAK > "6 kN"), within="2 s"): "undecided",
    }
    assert {formula: outcome(formula, record) for formula in expected} == expected
    verdict = evaluate(Expectation("it", always(PEAK < "6 kN")), record)
    assert verdict.text == "1 messages of contact_force are lost"


def test_losses_at_unknown_times_leave_only_what_was_seen():
    record = record_of(force={0: 10.0, SECOND // 2: 50.0, SECOND: 10.0})
    assert outcome(always(FORCE < "60 N"), record) == "passed"
    record.add_losses("reacting_force", 1)
    assert outcome(always(FORCE < "60 N"), record) == "undecided"
    assert outcome(always(FORCE < "45 N"), record) == "failed"
    assert outcome(eventually(FORCE > "45 N"), record) == "passed"


def test_losses_that_a_bag_counts_make_undecided_where_they_matter(faulty_bag, tmp_path):
    lossy = tmp_path / "lossy"
    with bags.BagWriter(lossy) as writer:
        copied(writer, faulty_bag)
        losses = {"/rpud/reacting_force": Losses(2, 1, 0)}
        writer.add_record(LOSSES_RECORD, losses_to_record(losses))
    formula = always(FORCE < "1 kN")
    topics = Expectation("it", formula).topics
    assert outcome(formula, Record.from_bag(faulty_bag, topics)) == "passed"
    record = Record.from_bag(lossy, topics)
    assert record.lost("reacting_force") == 3
    assert outcome(formula, record) == "undecided"
    assert outcome(always(WEIGHT <= "10 N"), record) == "passed"


def test_messages_that_come_twice_count_once():
    record = Record()
    for number in (0, 1, 1, 2, 0):
        record.add("/rpud/contact_force", number * SECOND, impact(number, 5000.0))
    assert outcome(count(Published("contact_force"), "==", 3), record) == "passed"


def test_a_topic_of_others_in_the_namespace_of_the_drill_keeps_its_absolute_name():
    record = Record()
    record.add("/rpud/supervisor/heartbeat", SECOND, {})
    assert outcome(count(Published("/rpud/supervisor/heartbeat"), "==", 1), record) == "passed"


def test_reports_of_one_stamp_are_ordered_by_their_counters():
    def report(accepted, weight):
        return {"commands_accepted": accepted, "weight_on_bit": weight}

    for order in (1, -1):
        record = Record()
        for message in (report(0, 10.0), report(1, 0.0))[::order]:
            record.add("status", SECOND, message)
        record.add("status", 2 * SECOND, report(1, 0.0))
        assert outcome(always(WEIGHT.equals(0)), record) == "passed"


def test_reports_of_one_stamp_with_equal_counters_are_in_the_order_of_their_publication():
    def judged(*faults):
        record = Record()
        record.add("status", 0, {"commands_accepted": 0, "active_faults": 0})
        for number in faults:  # an injected fault changes no counter
            record.add("status", SECOND, {"commands_accepted": 0, "active_faults": number})
        record.add("status", 2 * SECOND, {"commands_accepted": 0, "active_faults": faults[-1]})
        later = always(signal("status.active_faults").equals(1), between=("1 s", "2 s"))
        return outcome(later, record)

    assert judged(0, 1) == "passed"
    assert judged(0, 1, 1) == "passed"  # heard twice
    assert judged(1, 0) == "failed"
    assert judged(0, 1, 0) == "failed"


def test_values_of_one_stamp_without_an_order_are_bounds():
    for order in (1, -1):
        record = record_of()
        for force in (10.0, 50.0)[::order]:
            record.add("reacting_force", SECOND, {"force": force})
        assert outcome(always(FORCE < "60 N"), record) == "passed"
        assert outcome(always(FORCE < "45 N"), record) == "undecided"
        assert outcome(always(FORCE < "5 N"), record) == "failed"


def test_times_count_from_the_beginning_of_the_run():
    record = Record()
    record.add(*entry(0, "begin", 0, 3 * SECOND))
    record.add(*entry(1, "origin", 0, 3 * SECOND))
    record.add("status", 4 * SECOND, {"weight_on_bit": 10.0})
    record.add(*entry(2, "origin", SECOND, 5 * SECOND))
    record.add("status", 6 * SECOND, {"weight_on_bit": 10.0})
    assert record.zero(["status"]) == 3 * SECOND
    assert outcome(count(Published("status"), "==", 2), record) == "passed"


def test_the_last_run_of_a_bag_counts(faulty_bag, tmp_path):
    with bags.BagWriter(tmp_path / "bag") as writer, bags.open(faulty_bag) as source:
        for summary in source.topics:
            writer.add_topic(summary.topic, summary.definition)
        for later in (0, 10 * SECOND):
            for message in source.messages():
                published = message.publish_time + later
                writer.write(message.topic, message.data, published + 1, published)
    topics = ["contact_force", "reacting_force", "status"]
    both, one = (Record.from_bag(path, topics) for path in (tmp_path / "bag", faulty_bag))
    assert (both.runs, one.runs) == (2, 1)
    for topic in topics:
        assert len(both.messages(topic)) == len(one.messages(topic)) > 0
    assert both.span(topics) == one.span(topics)


HEARTBEAT = "std_msgs/Header header\nuint64 beats # [Hz]\nstring state\n"
HEADER = f"{'=' * 80}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
TIME = f"{'=' * 80}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
DEFINITION = HEARTBEAT + HEADER + TIME


@pytest.fixture
def other_bag(faulty_bag, tmp_path):
    """Return the bag with a topic of a supervisor."""
    path = tmp_path / "bag"
    with bags.BagWriter(path) as writer:
        copied(writer, faulty_bag)
        writer.add_topic(Topic("/supervisor/heartbeat", "pkg/msg/Heartbeat"), DEFINITION)
        for number in range(10):
            stamp = {"sec": 0, "nanosec": number * SECOND // 10}
            header = {"stamp": stamp, "frame_id": ""}
            fields = {"header": header, "beats": number, "state": "well"}
            data = serialized("pkg/msg/Heartbeat", DEFINITION, fields)
            writer.write("/supervisor/heartbeat", data, 10 * SECOND, 10 * SECOND)
    return path


def test_topics_of_others_are_judged_by_their_stamps(other_bag):
    beats = signal("/supervisor/heartbeat.beats")
    record = Record.from_bag(other_bag, ["/supervisor/heartbeat", "reacting_force", "status"])
    assert outcome(count(Published("/supervisor/heartbeat"), "==", 10), record) == "passed"
    assert outcome(eventually(beats.equals("9 Hz"), within="0.9 s"), record) == "passed"
    assert outcome(eventually(beats.equals("9 Hz"), within="0.8 s"), record) == "failed"
    assert (
        outcome(always(signal("/supervisor/heartbeat.state").has_text("well")), record) == "passed"
    )
    with pytest.raises(ParameterError, match="beats is in Hz, given 9 N"):
        outcome(always(beats < "9 N"), record)
    missing = Record.from_bag(other_bag, ["/supervisor/heartbeats", "status"])
    verdict = evaluate(Expectation("it", always(signal("/supervisor/heartbeats.x") > 0)), missing)
    assert (verdict.outcome, verdict.text) == (
        "undecided",
        "the bag holds no topic /supervisor/heartbeats; did you mean /supervisor/heartbeat?",
    )


def test_stamps_of_another_clock_are_outside_the_recording(other_bag):
    record = Record.from_bag(other_bag, ["reacting_force", "status"])
    record.add("/other", 1_700_000_000 * SECOND, {"value": 1.0})
    assert outcome(always(signal("/other.value") > 0), record) == "undecided"
    assert outcome(count(Published("/other"), ">=", 1), record) == "undecided"


def test_two_drills_in_a_bag_must_be_named(faulty_bag, tmp_path):
    path = merged(tmp_path / "bag", (faulty_bag, 0, "/one"), (faulty_bag, 0, "/two"))
    with pytest.raises(RecordingError, match="several drills: choose --namespace of /one, /two"):
        Record.from_bag(path, ["status"])
    with pytest.raises(RecordingError, match="no drill in '/three'; valid ones are /one, /two"):
        Record.from_bag(path, ["status"], "/three")
    record = Record.from_bag(path, ["status"], "two")
    assert outcome(always(WEIGHT.equals("8 N")), record) == "passed"
