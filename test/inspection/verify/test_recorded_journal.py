"""The journal of a bag: the run that a message belongs to, and what a proof needs of a journal."""

import dataclasses
import json

import numpy as np
import pytest
from altered_bags import altered, numbered, unchanged
from inspection.verify.proof_bags import JOURNAL

from rpud_sim.bag import Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.inspection.recorded_journal import JOURNAL as TYPE
from rpud_sim.inspection.recorded_journal import UnverifiableError, installed_codec
from rpud_sim.inspection.verify.coverage import Stretches
from rpud_sim.inspection.verify.verification import PROVED, verify
from rpud_sim.simulation.journal import JournalEntry
from rpud_sim.simulation.versions import ENGINE


def journal(*published):
    """Return a journal: kind and time of publishing of each entry."""
    return [
        (Message("/rpud/journal", 0, time, b""), JournalEntry(number, 0, kind, {}))
        for number, (kind, time) in enumerate(published)
    ]


TWO_RUNS = (
    ("begin", 10),
    ("origin", 11),
    ("stop", 20),
    ("flush", 30),
    ("begin", 40),
    ("origin", 41),
)


@pytest.mark.parametrize(
    ("time", "expected"),
    [
        (5, (0, 1)),  # what begins a run may be published before its entries
        (25, (1, 1)),
        (29, (1, 1)),
        (35, (1, 3)),
        (45, (3, 3)),
    ],
)
def test_a_message_belongs_to_the_run_in_which_it_was_published(time, expected):
    stretches = Stretches(journal(*TWO_RUNS))
    assert stretches.of(Message("/rpud/wrench", 99, time, b"")) == expected
    assert stretches.runs == 2


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ([20, 25, 29], 3),
        ([25, 20, 29], 3),  # not in order
        ([25, 29, 45], 2),
        ([25, 45, 29], 1),
        ([45, 25], 0),
        ([5, 45, 25], 1),  # the earliest fits, the latest does not
        ([0, 35], 2),
    ],
)
def test_messages_fit_a_stretch_up_to_the_first_that_was_published_in_another(times, expected):
    stretches = Stretches(journal(*TWO_RUNS))
    assert stretches.fitting(1, np.array(times)) == expected


def test_stretches_that_the_clock_does_not_show_fit_every_message():
    stretches = Stretches(journal(("begin", 100), ("stop", 110), ("begin", 50), ("stop", 60)))
    assert [stretches.fitting(number, np.array([5, 105, 55])) for number in (0, 1)] == [3, 3]


def test_only_a_last_entry_ends_the_runs():
    assert not Stretches(journal(*TWO_RUNS)).ended
    assert Stretches(journal(*TWO_RUNS, ("end", 50))).ended
    assert not Stretches(journal(*TWO_RUNS, ("end", 50), ("begin", 60))).ended


def test_a_clock_that_was_set_back_shows_nothing():
    stretches = Stretches(journal(("begin", 100), ("stop", 110), ("begin", 50), ("stop", 60)))
    assert stretches.of(Message("/rpud/wrench", 99, 105, b"")) == (0, 1)


def test_a_recorder_that_keeps_no_times_of_publishing_shows_nothing():
    stretches = Stretches(journal(*((kind, 0) for kind, _ in TWO_RUNS)))
    assert stretches.of(Message("/rpud/wrench", 99, 0, b"")) == (0, 3)


def edited(edit):
    """Return a change of the journal's first entry."""
    codec = Codec("rpud_msgs/msg/JournalEntry", find_definition("rpud_msgs/msg/JournalEntry"))

    def change(message):
        if message.topic != JOURNAL:
            return [message.data]
        entry = codec.decode(message.data)
        if entry.kind != "begin":
            return [message.data]
        content = json.loads(entry.content)
        edit(content)
        stamp = {"sec": entry.header.stamp.sec, "nanosec": entry.header.stamp.nanosec}
        fields = {
            "header": {"stamp": stamp, "frame_id": entry.header.frame_id},
            "sequence": entry.sequence,
            "kind": entry.kind,
            "content": json.dumps(content),
        }
        return [codec.encode(fields)]

    return change


def test_other_parameters_in_the_journal_do_not_go_with_the_messages(bag, tmp_path):
    def edit(content):
        content["parameters"]["load_spring_rate"] *= 1.0 + 2.0**-52

    verification = verify(altered(bag, tmp_path / "bag", edited(edit)))
    assert not verification.proved
    assert verification.warnings == ()


def test_other_libraries_of_the_same_engine_change_nothing(bag, tmp_path):
    def edit(content):
        content["made_by"] = {"rpud_sim": "0.0.1", "numpy": "0.0.1", "machine": "aarch64"}

    verification = verify(altered(bag, tmp_path / "bag", edited(edit)))
    assert (verification.proved, verification.warnings) == (True, ())


def test_a_later_engine_cannot_be_repeated(bag, tmp_path):
    def edit(content):
        content["engine"] = ENGINE + 1
        content["made_by"]["rpud_sim"] = "9.0"

    with pytest.raises(UnverifiableError, match=r"rpud_sim 9\.0 proves it"):
        verify(altered(bag, tmp_path / "bag", edited(edit)))


def test_a_bag_without_a_journal_cannot_be_verified(bag, tmp_path):
    topics = {f"/rpud/{name}" for name in PROVED}
    altered(bag, tmp_path / "bag", unchanged, topics)
    with pytest.raises(UnverifiableError, match="holds no journal"):
        verify(tmp_path / "bag")


def test_a_journal_alone_proves_nothing(bag, tmp_path):
    altered(bag, tmp_path / "bag", unchanged, {JOURNAL})
    with pytest.raises(UnverifiableError, match="holds nothing that /rpud/journal could prove"):
        verify(tmp_path / "bag")


@pytest.mark.parametrize(
    ("edit", "field"),
    [
        (lambda header: header["stamp"].update(nanosec=7), "header.stamp"),
        (lambda header: header.update(frame_id="map"), "header.frame_id"),
    ],
)
@pytest.mark.parametrize("number", [0, 1, 2])
def test_an_altered_header_of_an_entry_is_a_difference(bag, tmp_path, number, edit, field):
    def change(message):
        fields = dataclasses.asdict(installed_codec(TYPE).decode(message.data))
        edit(fields["header"])
        return [installed_codec(TYPE).encode(fields)]

    verification = verify(altered(bag, tmp_path / "bag", numbered("journal", number, change)))
    assert not verification.proved
    assert verification.first_difference.topic == JOURNAL
    assert verification.first_difference.field == field


def test_a_shifted_origin_is_a_difference(bag, tmp_path):
    def change(message):
        fields = dataclasses.asdict(installed_codec(TYPE).decode(message.data))
        assert fields["content"] == '{"time": 0, "origin": 0}'
        return [installed_codec(TYPE).encode({**fields, "content": '{"time": 0, "origin": 1}'})]

    verification = verify(altered(bag, tmp_path / "bag", numbered("journal", 1, change)))
    assert verification.first_difference is not None


def test_an_entry_that_is_there_twice_with_other_content_is_not_proved(bag, tmp_path):
    def change(message):
        fields = dataclasses.asdict(installed_codec(TYPE).decode(message.data))
        return [message.data, installed_codec(TYPE).encode({**fields, "kind": "stop"})]

    altered(bag, tmp_path / "bag", numbered("journal", 1, change))
    with pytest.raises(UnverifiableError, match="entry 1 of the journal is there twice"):
        verify(tmp_path / "bag")


@pytest.mark.parametrize(
    ("number", "text"), [(0, "can begin; its recorder came too late"), (1, "entries 1 to 1")]
)
def test_a_journal_with_a_gap_cannot_be_verified(bag, tmp_path, number, text):
    altered(bag, tmp_path / "bag", numbered("journal", number, lambda m: []))
    with pytest.raises(UnverifiableError, match=text):
        verify(tmp_path / "bag")


@pytest.mark.parametrize(
    "edit",
    [
        lambda content: content.pop("time"),
        lambda content: content.update(time=2**63),
        lambda content: content.pop("parameters"),
        lambda content: content["parameters"].update(telemetry_rate="fast"),
        lambda content: content["parameters"].update(block_duration=0.0),
        lambda content: content["faults"][0].update(kind="jam on toast"),
    ],
)
def test_a_journal_that_makes_no_sense_cannot_be_verified(bag, tmp_path, edit):
    altered(bag, tmp_path / "bag", edited(edit))
    with pytest.raises(UnverifiableError, match="journal"):
        verify(tmp_path / "bag")
