"""One run of a campaign several times: the same verdicts and the same messages, at any load.

`make campaign` flies it RUNS times beside busy loops.
"""

import hashlib
import json
import os
from pathlib import Path

import pytest
from rclpy.serialization import deserialize_message

from rpud_sim.testing.campaign_file import read_campaign
from rpud_sim.testing.campaign_runs import fly
from rpud_sim.testing.setup import DrillPool

CAMPAIGN = Path(__file__).resolve().parents[3] / "config" / "campaign.yaml"
RUN = "jammed actuator_restitution=0.8 seed=1"
REPETITIONS = int(os.environ.get("RPUD_REPETITIONS", "2"))
# Of a status: how fast the drill was, what it had discovered, and what no reset restores.
OF_THE_MACHINE = (
    "commanders",
    "deadlines_missed",
    "journal_entries",
    "messages_dropped",
    "real_time_factor",
    "lateness_max",
    "lag",
)


def content_of(name, message, payload):
    """Return what counts of a message."""
    if name == "status":
        fields = set(message.get_fields_and_field_types()) - {*OF_THE_MACHINE}
        return repr([(field, getattr(message, field)) for field in sorted(fields)]).encode()
    if name == "journal":
        entry = json.loads(message.content)
        if isinstance(entry.get("parameters"), dict):
            entry["parameters"].pop("scenario", None)  # a path that differs each time
        return f"{message.kind} {json.dumps(entry, sort_keys=True)}".encode()
    return payload


def digest_of(drill):
    """Return a digest of what was published and commanded, by topic and simulation time.

    Two commands of one step may reach the drill in either order, at one instant of simulation time.
    So messages of one instant have no order here, and only the last status of an instant counts.
    """
    digest = hashlib.sha256()
    for topic, heard in sorted(drill.heard.items()):
        name = topic.removeprefix(f"{drill.namespace}/")
        messages = list(zip(heard.stamps, heard.payloads, strict=True))
        if name == "status":
            messages = list(dict(messages).items())
        contents = [
            (stamp, content_of(name, deserialize_message(payload, heard.kind), payload))
            for stamp, payload in messages
        ]
        digest.update(f"{topic} {sorted(contents)}\n".encode())
    return digest.hexdigest()


@pytest.mark.extended
@pytest.mark.timeout(0)
def test_a_run_gives_the_same_results_each_time():
    campaign = read_campaign(CAMPAIGN)
    (run,) = [each for each in campaign.runs if each.name == RUN]
    found = set()
    pool = DrillPool()
    try:
        for _ in range(REPETITIONS):
            drill = pool.take(run.setup, campaign.system.folder)
            outcome = fly(drill, run, campaign.system, campaign.expectations)
            found.add((outcome, digest_of(drill)))
            pool.give_back(drill)
    finally:
        pool.close()
    assert len(found) == 1
    assert outcome.failures == []
