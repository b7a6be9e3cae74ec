"""One run of a campaign several times: the same verdicts and the same messages, at any load.

`make campaign` flies it RUNS times beside busy loops.
"""

import hashlib
import os
from pathlib import Path

import pytest

from rpud_sim.testing.campaign_file import read_campaign
from rpud_sim.testing.campaign_runs import run_once

CAMPAIGN = Path(__file__).resolve().parents[3] / "config" / "campaign.yaml"
RUN = "jammed actuator_restitution=0.8 seed=1"
REPETITIONS = int(os.environ.get("RPUD_REPETITIONS", "2"))
OF_THE_MACHINE = ("status",)  # it also says how fast the drill was


def digest_of(drill):
    """Return a digest of what was published and commanded, by topic and simulation time.

    The entries of the journal are numbered since the drill's start, which is before the attempt.
    """
    digest = hashlib.sha256()
    for topic, heard in sorted(drill.heard.items()):
        name = topic.removeprefix(f"{drill.namespace}/")
        if name == "journal":
            digest.update(f"{[(each.kind, each.content) for each in heard.messages()]}".encode())
        elif name not in OF_THE_MACHINE:
            messages = list(zip(heard.stamps, heard.payloads, strict=True))
            digest.update(f"{topic} {messages}\n".encode())
    return digest.hexdigest()


@pytest.mark.extended
@pytest.mark.timeout(0)
def test_a_run_gives_the_same_results_each_time(pool):
    campaign = read_campaign(CAMPAIGN)
    (run,) = [each for each in campaign.runs if each.name == RUN]
    found = []
    for _ in range(REPETITIONS):
        drill = pool.take(run.setup, campaign.system.place)
        outcome = run_once(drill, run, campaign.system, campaign.expectations)
        found.append((outcome, digest_of(drill)))
        pool.give_back(drill)
    assert found == [found[0]] * REPETITIONS
    assert outcome.failures == []
