"""Hostile bags end in one line, within limits of time and memory; ``make fuzz`` has more."""

import os
import signal

import pytest

from fuzz import bag_campaign

BAGS = 400


def test_hostile_bags_are_read_or_refused_in_one_line():
    outcome = bag_campaign.run(BAGS, seed=0)
    assert outcome.harms == []
    for way, tally in outcome.tallies.items():
        assert 0 < tally.refused < tally.inputs, way
        assert tally.slowest > 0.0
    # A reader whose process has room left takes no more memory.
    assert any(tally.largest > 0 for tally in outcome.tallies.values())


def crash(bag):
    os.kill(os.getpid(), signal.SIGXCPU)


def waste(bag):
    return bool(b"x" * (bag_campaign.MEMORY + 2**26 + 1))


def fail(bag):
    raise ZeroDivisionError


def complain(bag):
    bag_campaign._check_line("one\ntwo")


@pytest.mark.parametrize(
    ("defect", "harm"),
    [
        (crash, "ended by SIGXCPU"),
        (waste, "MB"),
        (fail, "ZeroDivisionError"),
        (complain, "the error is not one line"),
    ],
)
def test_a_defect_is_found(monkeypatch, defect, harm):
    monkeypatch.setattr(bag_campaign, "_arrays", defect)
    monkeypatch.setattr(bag_campaign, "_command", lambda *_: True)
    outcome = bag_campaign.run(20, seed=0)
    assert sum(tally.inputs for tally in outcome.tallies.values()) == 20
    assert len(outcome.harms) == outcome.tallies["arrays"].inputs > 0
    assert all(harm in each for each in outcome.harms)
