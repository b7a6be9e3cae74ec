"""Hostile bags end in one line, within limits of time and memory; ``make fuzz`` has more."""

import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor

import pytest

from fuzz import bag_campaign

pytestmark = pytest.mark.extended

BAGS = 400


def in_a_new_process(function, *arguments):
    """Call a function where there are no threads: the workers of a campaign are forked."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def test_hostile_bags_are_read_or_refused_in_one_line():
    outcome = in_a_new_process(bag_campaign.run, BAGS, 0)
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


def wait(bag):
    signal.pause()


def run_with(defect):
    """Run a small campaign whose reader of arrays has a defect, and no other reader works."""
    bag_campaign._arrays = defect
    bag_campaign._command = lambda *_: True
    if defect is wait:  # for memory that is new to the machine a second can be too short
        bag_campaign.PATIENCE = 1
    return bag_campaign.run(20, 0)


@pytest.mark.parametrize(
    ("defect", "harm"),
    [
        (crash, "ended by SIGXCPU"),
        (waste, "MB"),
        (fail, "ZeroDivisionError"),
        (complain, "the error is not one line"),
        (wait, "ended by exit 1"),
    ],
)
def test_a_defect_is_found(defect, harm):
    outcome = in_a_new_process(run_with, defect)
    assert sum(tally.inputs for tally in outcome.tallies.values()) == 20
    assert len(outcome.harms) == outcome.tallies["arrays"].inputs > 0
    assert all(harm in each for each in outcome.harms)
