"""One run of a campaign several times: the same verdicts and the same messages, at any load.

`make campaign` flies it RUNS times beside busy loops.
"""

import os
from itertools import zip_longest
from pathlib import Path

import pytest

from rpud_sim.testing.campaign_file import read_campaign
from rpud_sim.testing.campaign_runs import run_once

CAMPAIGN = Path(__file__).resolve().parents[3] / "config" / "campaign.yaml"
RUN = "jammed actuator_restitution=0.8 seed=1"
REPETITIONS = int(os.environ.get("RPUD_REPETITIONS", "2"))
OF_THE_MACHINE = ("status",)  # it also says how fast the drill was


def published(drill):
    """Return what was published and commanded, by topic: simulation times and contents.

    The entries of the journal are numbered since the drill's start, which is before the attempt.
    """
    found = {}
    for topic, heard in sorted(drill.heard.items()):
        name = topic.removeprefix(f"{drill.namespace}/")
        if name == "journal":
            found[name] = [(each.kind, each.content) for each in heard.messages()]
        elif name not in OF_THE_MACHINE:
            found[name] = list(zip(heard.stamps, heard.payloads, strict=True))
    return found


def first_difference(first, other):
    """Return the topic and the message that differ first, an empty text if none does."""
    for topic in sorted({*first, *other}):
        pairs = zip_longest(first.get(topic, ()), other.get(topic, ()))
        for number, (one, two) in enumerate(pairs):
            if one != two:
                return f"{topic}, message {number}: {one!s:.500} and {two!s:.500}"
    return ""


@pytest.mark.extended
@pytest.mark.timeout(0)
def test_a_run_gives_the_same_results_each_time(pool):
    campaign = read_campaign(CAMPAIGN)
    (run,) = [each for each in campaign.runs if each.name == RUN]
    first = None
    for repetition in range(REPETITIONS):
        drill = pool.take(run.setup, campaign.system.place)
        outcome = run_once(drill, run, campaign.system, campaign.expectations)
        found = (outcome, published(drill))
        pool.give_back(drill)
        assert outcome.failures == []
        first = first or found
        assert found[0] == first[0]
        differs = first_difference(first[1], found[1])
        assert not differs, f"repetition {repetition}: {differs}"
