"""The journal of a bag: the run that a message belongs to, and what a proof needs of a journal."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from altered_bags import altered, edited, numbered, unchanged
from hypothesis import given
from hypothesis import strategies as st
from inspection.verify.proof_bags import JOURNAL
from rpud_sim.recorded.recorded_journal import JOURNAL as TYPE
from rpud_sim.recorded.recorded_journal import Recorded, UnverifiableError, installed_codec
from rpud_sim.recorded.verify.coverage import JournalStretches
from rpud_sim.recorded.verify.verification import PROVED, verify

from rpud_sim.bag import Message
from rpud_sim.bag.columns import to_plain
from rpud_sim.simulation.journal import JournalEntry
from rpud_sim.simulation.versions import ENGINE


def journal(*published):
    """Return a journal: kind and time of publishing of each entry."""
    return [recorded(number, kind, time) for number, (kind, time) in enumerate(published)]


def recorded(number, kind, time):
    message = Message("/rpud/journal", 0, time, b"")
    fields = SimpleNamespace(header=SimpleNamespace(frame_id="rpud_mount"))
    return Recorded(message, JournalEntry(number, 0, kind, {"origin": 0}), fields, 0)


TWO_RUNS = (
    ("begin", 10),
    ("origin", 11),
    ("stop", 20),
    ("flush", 30),
    ("begin", 40),
    ("origin", 41),
)
SET_BACK = (("begin", 100), ("stop", 110), ("begin", 50), ("stop", 60))


@pytest.mark.parametrize(
    ("entries", "time", "expected"),
    [
        (TWO_RUNS, 5, (0, 1)),  # what begins a run may be published before its entries
        (TWO_RUNS, 25, (1, 1)),
        (TWO_RUNS, 35, (1, 3)),
        (TWO_RUNS, 45, (3, 3)),
        (SET_BACK, 105, (0, 1)),  # the clock was set back, so it shows nothing
        (tuple((kind, 0) for kind, _ in TWO_RUNS), 0, (0, 3)),  # nor does one that stands
    ],
)
def test_a_message_belongs_to_the_run_in_which_it_was_published(entries, time, expected):
    assert (
        JournalStretches(journal(*entries)).of(Message("/rpud/wrench", 99, time, b"")) == expected
    )


@pytest.mark.parametrize("entries", [TWO_RUNS, SET_BACK])
@given(times=st.lists(st.integers(0, 120), max_size=5))
def test_messages_fit_a_stretch_up_to_the_first_that_was_published_in_another(entries, times):
    stretches = JournalStretches(journal(*entries))
    spans = [stretches.of(Message("/rpud/wrench", 99, time, b"")) for time in times]
    fit = itertools.takewhile(lambda span: span[0] <= 1 <= span[1], spans)
    assert stretches.fitting(1, np.array(times, np.int64)) == len([*fit])


def test_only_a_last_entry_ends_the_runs():
    assert JournalStretches(journal(*TWO_RUNS)).runs == 2
    assert not JournalStretches(journal(*TWO_RUNS)).ended
    assert JournalStretches(journal(*TWO_RUNS, ("end", 50))).ended
    assert not JournalStretches(journal(*TWO_RUNS, ("end", 50), ("begin", 60))).ended


def beginning(edit):
    """Return a change of the content of the entry with which the run begins."""
    return edited(lambda fields, content: fields["kind"] == "begin" and edit(content))


def test_other_parameters_in_the_journal_do_not_go_with_the_messages(bag, tmp_path):
    def edit(content):
        content["parameters"]["load_spring_rate"] *= 1.0 + 2.0**-52

    verification = verify(altered(bag, tmp_path / "bag", beginning(edit)))
    assert not verification.proved
    assert verification.warnings == ()


def test_other_libraries_of_the_same_engine_change_nothing(bag, tmp_path):
    made_by = {"rpud_sim": "0.0.1", "numpy": "0.0.1", "machine": "aarch64"}
    change = beginning(lambda content: content.update(made_by=made_by))
    verification = verify(altered(bag, tmp_path / "bag", change))
    assert (verification.proved, verification.warnings) == (True, ())


@pytest.mark.parametrize(
    ("edit", "field"),
    [
        (lambda fields: fields["header"]["stamp"].update(nanosec=7), "header.stamp"),
        (lambda fields: fields["header"].update(frame_id="map"), "header.frame_id"),
    ],
)
@pytest.mark.parametrize("number", [0, 1, 2])
def test_an_altered_header_of_an_entry_is_a_difference(bag, tmp_path, number, edit, field):
    change = edited(lambda fields, content: fields["sequence"] == number and edit(fields))
    difference = verify(altered(bag, tmp_path / "bag", change)).first_difference
    assert (difference.topic, difference.field) == (JOURNAL, field)


def test_a_shifted_origin_is_a_difference(bag, tmp_path):
    change = edited(lambda fields, content: content.update(origin=1) if "origin" in content else 0)
    assert verify(altered(bag, tmp_path / "bag", change)).first_difference is not None


def later_engine(content):
    content["engine"] = ENGINE + 1
    content["made_by"]["rpud_sim"] = "9.0"


def twice(message):
    fields = to_plain(installed_codec(TYPE).decode(message.data))
    return [message.data, installed_codec(TYPE).encode({**fields, "kind": "stop"})]


@pytest.mark.parametrize(
    ("change", "topics", "reason"),
    [
        (unchanged, PROVED, "holds no journal"),
        (unchanged, ["journal"], "holds nothing that /rpud/journal could prove"),
        (beginning(later_engine), None, r"rpud_sim 9\.0 proves it"),
        (numbered("journal", 1, twice), None, "entry 1 of the journal is there twice"),
        (numbered("journal", 0, lambda m: []), None, "can begin; its recorder came too late"),
        (numbered("journal", 1, lambda m: []), None, "entries 1 to 1"),
        (beginning(lambda content: content.update(time=2**63)), None, "journal"),
        (beginning(lambda content: content.pop("parameters")), None, "journal"),
        (edited(lambda _, content: content.pop("origin", None)), None, r"KeyError\('origin'\)"),
        (beginning(lambda c: c["parameters"].update(block_duration=0.0)), None, "journal"),
    ],
)
def test_what_cannot_be_verified_is_said(bag, tmp_path, change, topics, reason):
    held = topics and {f"/rpud/{name}" for name in topics}
    with pytest.raises(UnverifiableError, match=reason):
        verify(altered(bag, tmp_path / "bag", change, held))
