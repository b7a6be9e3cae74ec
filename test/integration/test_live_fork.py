"""A fork as a drill node: it goes on where the bag was, and others command it."""

import json

import pytest
from drill_client import Client, nanoseconds, stamps
from rpud_msgs.msg import Result, WeightOnBit
from rpud_msgs.srv import ResetSimulation
from sample_bags import write_offline_bag
from support import Process

import rpud_sim.bag
from rpud_sim.messages.columns import to_plain
from rpud_sim.messages.definitions import installed_codec
from rpud_sim.recorded.fork import write_fork
from rpud_sim.recorded.verify import verify
from rpud_sim.simulation import preset
from rpud_sim.simulation.scenario_file import parse_scenario
from rpud_sim.simulation.topics import TOPICS

AT = 0.1234567
LIVE = ("publish_clock=true", "start_paused=true", "real_time_factor=0")
SCENARIO = parse_scenario(
    {
        "seed": 3,
        "faults": [
            {"kind": "noise", "channel": "wrench", "onset": 0.05},
            {"kind": "lost_preload", "onset": 0.1, "duration": 0.1},
        ],
    },
    "scenario",
)
COMMANDS = """
faults: [{kind: restitution_loss, onset: 0.2034, duration: 0.05}]
"""
Reset = ResetSimulation.Request


def decoded(bag, name):
    codec = installed_codec(TOPICS[name].type)
    with rpud_sim.bag.open(bag) as opened:
        return [codec.decode(message.data) for message in opened.messages({f"/rpud/{name}"})]


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    path = tmp_path_factory.mktemp("source") / "bag"
    write_offline_bag(path, preset("drilling"), 0.4, 0.2, SCENARIO, 7)
    return path


@pytest.fixture(scope="module")
def used(source, tmp_path_factory):
    """Fork a bag live, step it, command it and reset it; return its bag and what it answered."""
    folder = tmp_path_factory.mktemp("live")
    (folder / "commands.yaml").write_text(COMMANDS)
    words = [word for text in LIVE for word in ("--set", text)]
    files = ("--commands", folder / "commands.yaml", "--out", folder / "bag")
    with (
        Process(
            "rpud", "fork", source, "--at", str(AT), "--live", "--quiet", *words, *files
        ) as fork,
        Client() as client,
    ):
        fork.wait_for_line("the drill is active")
        answers = use(client)
        fork.interrupt()
        assert fork.wait() == 0, fork.output
    return folder / "bag", answers


def use(client):
    client.until(lambda: client.status)
    answers = {"first": client.status[0]}
    client.step(0.15)
    answers["reseeded"] = [
        client.reset(each, seed=8) for each in (Reset.SCOPE_ALL, Reset.SCOPE_SPAWNED)
    ]
    answers["reset"] = client.reset(Reset.SCOPE_ALL)
    client.step(0.15)
    client.command(WeightOnBit(force=30.0))
    client.until(lambda: client.status[-1].weight_on_bit == 30.0)
    client.step(0.15)
    answers["last"] = client.status[-1]
    return answers


def test_it_begins_at_the_instant(used):
    _, answers = used
    status = answers["first"]
    assert stamps([status]) == [123_456_700]
    assert (status.weight_on_bit, status.active_faults) == (8.0, 2)
    assert status.impacts > 20


def test_what_follows_is_the_rest_of_the_bag_also_after_a_reset(used, source):
    bag, answers = used
    assert answers["reset"].result == Result.RESULT_OK
    for rejected in answers["reseeded"]:
        assert rejected.result == Result.RESULT_OPERATION_FAILED
        assert rejected.error_message == "seed = 8: a fork keeps its seed 7"
    for topic in ("contact_force", "wrench"):
        rest, live = (
            [to_plain(m) for m in decoded(path, topic) if AT * 1e9 < stamps([m])[0] < 270e6]
            for path in (source, bag)
        )
        assert live == [*rest, *rest]
        assert len(rest) > 10


def test_commands_and_planned_faults_act(used):
    bag, answers = used
    assert answers["last"].weight_on_bit == 30.0
    entries = [(e.kind, json.loads(e.content)) for e in decoded(bag, "journal")]
    injected = [content for kind, content in entries if kind == "inject"]
    assert [content["time"] for content in injected] == [326_856_700]
    assert injected[0]["fault"]["kind"] == "restitution_loss"


def test_its_bag_is_proved_and_can_be_forked(used, tmp_path):
    bag, _ = used
    verification = verify(bag)
    assert verification.proved, verification
    forked = write_fork(bag, tmp_path / "again", 0.35, run=2)
    assert forked.duration == pytest.approx(AT + 0.3 - 0.35)
    assert verify(tmp_path / "again").proved
    assert nanoseconds(decoded(tmp_path / "again", "wrench")[0].header.stamp) == 360_000_000
