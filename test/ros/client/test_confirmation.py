"""A command is accepted or refused by evidence about itself, not about another publisher's."""

import json

import pytest
from builtin_interfaces.msg import Time
from rpud_msgs.msg import JournalEntry, Status
from std_msgs.msg import Header

from rpud_sim.ros.client.confirmation import Confirmation


def status(accepted=0, rejected=0, force=10.0, at=5):
    return Status(
        header=Header(stamp=Time(sec=at)),
        commands_accepted=accepted,
        commands_rejected=rejected,
        weight_on_bit=force,
    )


def entry(force, at=6, kind="weight_on_bit"):
    content = json.dumps({"time": 0, "force": force})
    return JournalEntry(header=Header(stamp=Time(sec=at)), kind=kind, content=content)


@pytest.fixture
def press():
    """Confirmation of 30 N, sent when the drill had accepted 3 commands and refused 2."""
    before = status(3, 2)
    return Confirmation("weight_on_bit", {"force": 30.0}, {"weight_on_bit": 30.0}, before)


def test_it_is_accepted_when_it_is_counted_and_in_force(press):
    press.see_status(status(3, 2, force=30.0))
    assert not press.accepted
    press.see_status(status(4, 2, force=30.0))
    assert press.accepted


def test_another_command_that_is_counted_is_no_evidence(press):
    press.see_status(status(4, 2, force=20.0))
    assert not press.accepted
    press.see_status(status(5, 2, force=30.0))
    assert press.accepted


def test_the_journal_shows_a_command_that_another_one_overrides_at_once(press):
    press.see_entry(entry(20.0))
    press.see_entry(entry(30.0, kind="drive"))
    press.see_status(status(5, 2, force=20.0))
    assert not press.accepted
    press.see_entry(entry(30.0))
    assert press.accepted


def test_a_late_entry_of_the_past_is_no_evidence(press):
    press.see_entry(entry(30.0, at=5))
    press.see_status(status(4, 2, force=20.0))
    assert not press.accepted


def test_a_refusal_gives_the_count_at_which_the_reason_is_found(press):
    press.see_status(status(3, 2))
    assert not press.refused
    press.see_status(status(3, 3))
    assert press.refused == 3
    assert not press.accepted


def test_a_reset_in_between_counts_from_zero(press):
    press.see_status(status(1, 0, force=30.0, at=0))
    assert press.accepted
    assert not press.refused
