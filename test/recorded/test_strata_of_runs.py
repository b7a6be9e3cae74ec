"""Runs after resets whose strata are in the journal once: each reader has them, or says why not."""

import json

import pytest
from altered_bags import altered, edited, unchanged
from forked_runs import JOURNAL, entries_of, write_used

import rpud_sim.bag
from rpud_sim.bag import BagWriter
from rpud_sim.drilling.rock import Strata, preset_layer
from rpud_sim.recorded.fork import write_fork
from rpud_sim.recorded.journal import UnverifiableError
from rpud_sim.recorded.output import SkippedParts
from rpud_sim.recorded.rebuild import rebuild
from rpud_sim.recorded.runs import find_drill, runs_of
from rpud_sim.recorded.verify import verify

STRATA = Strata(tuple(preset_layer("limestone", 1e-3 * number) for number in range(20))).to_text()
MISSING = "journal entry 27 has the strata of entry 0: missing"


def runs_in(path):
    with rpud_sim.bag.open(path) as bag:
        return runs_of(bag)


def strata_in(path):
    """Return what each begin of a bag's journal contains about its strata."""
    begins = (json.loads(e.content) for e in entries_of(path) if e.kind == "begin")
    return [each["parameters"]["strata"] for each in begins]


@pytest.fixture(scope="module")
def layered(tmp_path_factory):
    """Bag of a drill that was reset."""
    path = tmp_path_factory.mktemp("layered") / "bag"
    write_used(path, {"strata": STRATA})
    return path


def test_the_second_run_has_the_strata_of_the_first(layered):
    assert strata_in(layered) == [STRATA, {"same_as_entry": 0}]
    assert [run.parameters["strata"] for run in runs_in(layered)] == [STRATA, STRATA]
    assert verify(layered).proved


@pytest.mark.extended
def test_the_second_run_is_rebuilt(layered, tmp_path):
    assert rebuild(layered, tmp_path / "out", 1000, run=2)


def test_a_fork_of_the_second_run_contains_them(layered, tmp_path):
    write_fork(layered, tmp_path / "fork", 0.02, run=2)
    assert strata_in(tmp_path / "fork") == [STRATA]
    assert verify(tmp_path / "fork").proved


def test_a_bag_in_which_each_run_contains_them_is_proved(layered, tmp_path):
    def repeat(fields, content):
        if fields["kind"] == "begin":
            content["parameters"]["strata"] = STRATA

    path = altered(layered, tmp_path / "bag", edited(repeat))
    assert strata_in(path) == [STRATA, STRATA]
    assert [run.plan for run in runs_in(path)] == [run.plan for run in runs_in(layered)]
    assert verify(path).proved


def test_a_split_bag_has_them_and_its_second_file_says_that_they_are_missing(layered, tmp_path):
    with (
        rpud_sim.bag.open(layered) as source,
        BagWriter(tmp_path / "bag", max_file_duration=0.5) as writer,
    ):
        for summary in source.topics:
            writer.add_topic(summary.topic, summary.definition)
        for message in source.messages():
            writer.write(message.topic, message.data, message.log_time, message.publish_time)
    assert [run.parameters["strata"] for run in runs_in(tmp_path / "bag")] == [STRATA, STRATA]
    with pytest.raises(UnverifiableError, match=MISSING):
        verify(tmp_path / "bag" / "bag_1.mcap")


def test_a_bag_that_lost_the_entry_says_that_they_are_missing(layered, tmp_path):
    begun = []

    def without_first(message):
        if message.topic == JOURNAL and not begun:
            begun.append(message)
            return []
        return unchanged(message)

    path = altered(layered, tmp_path / "bag", without_first)
    with pytest.raises(UnverifiableError, match=MISSING):
        verify(path)
    with rpud_sim.bag.open(path) as bag:
        found = find_drill(bag, SkippedParts(bag))
    assert (found.entries, found.parameters) == ((), {})
    assert MISSING in found.warnings[0]
