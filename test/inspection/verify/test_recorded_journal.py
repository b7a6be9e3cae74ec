"""Which run a message belongs to, by the times at which it and the journal were published."""

import pytest

from rpud_sim.bag import Message
from rpud_sim.inspection.verify.recorded_journal import Stretches
from rpud_sim.simulation.journal import JournalEntry


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
