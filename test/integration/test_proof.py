"""A recording of the node, whatever happened to it, is proved by what it holds."""

import contextlib
import itertools
import os
import signal
import threading

import pytest
from drill_client import ACTIVATE, CONFIGURE, DEACTIVATE, Client, end
from rpud_msgs.msg import Drive, Status, WeightOnBit
from rpud_msgs.srv import ResetSimulation
from sample_bags import PLAIN_PROVED
from support import Process

import rpud_sim.bag
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.definitions import find_definition
from rpud_sim.recorded.verify import verify

JOURNAL = "/rpud/journal"
SCENARIO = """
seed: 3
faults:
  - {kind: bias, channel: wrench, magnitude: 100, onset: 0.101, duration: {uniform: [0.05, 0.1]}}
  - {kind: delayed, channel: contact_force, magnitude: 0.03, onset: 0.1, duration: 0.2}
  - {kind: slow, channel: contact_force, magnitude: 0.02, onset: 0.15, duration: 0.2}
  - {kind: lost_preload, magnitude: 0.5, onset: 0.123456789, duration: 0.1}
"""
OPTIONS = {
    "autostart": "false",
    "start_paused": "true",
    "publish_clock": "true",
    "real_time_factor": "0.0",
    "command_timeout": "0.2",
    "command_loss_ramp": "0.1",
    "seed": "5",
}


@pytest.fixture(scope="module")
def bag(start_module_drill, tmp_path_factory):
    """Record a drill to which everything happens that can happen to one."""
    folder = tmp_path_factory.mktemp("proof")
    (folder / "scenario.yaml").write_text(SCENARIO)
    options = OPTIONS | {"scenario": folder / "scenario.yaml"}
    drill = start_module_drill("/rpud", "waiting for the transitions", **options)
    with Process("rpud", "record", "--out", folder / "bag") as recorder, Client() as client:
        use(client, recorder)
        end(drill, recorder)
    return folder / "bag"


def known(client, recorder, *others):
    """Wait until the recorder hears all that is proved."""
    for topic in (*PLAIN_PROVED, *others):
        recorder.wait_for_line(f"subscribed /rpud/{topic} ")
        client.until(lambda topic=topic: client.node.count_subscribers(f"/rpud/{topic}"))


def use(client, recorder):
    def command(message, field, value):
        client.command(message)
        client.until(lambda: statuses and getattr(statuses[-1], field) == value)

    statuses = client.status
    assert client.change(CONFIGURE)
    known(client, recorder)
    assert client.change(ACTIVATE)
    client.step(0.2)
    # A paused drill applies what is commanded at once.
    command(WeightOnBit(force=20.0), "weight_on_bit", 20.0)
    client.step(0.0734567)
    for _ in range(9):
        client.step(0.0013)
    assert client.inject("noise", "nodal_plane", 1e-6, 0.0123456).success
    assert client.inject("stuck", "reacting_force").success
    command(Drive(enabled=True, voltage=80.0, frequency=16050.0), "drive_frequency", 16050.0)
    client.step(0.1)
    for engaged in (False, True, False):  # the reset puts it into the rock again
        assert client.engage(engaged).success
        client.step(0.05)
    client.step(0.2)  # the commands are lost, and go down to nothing
    assert client.until(lambda: statuses[-1].commands_lost)
    client.reset(seed=9)
    client.step(0.1)
    client.reset(ResetSimulation.Request.SCOPE_TIME)
    client.step(0.105)
    client.reset(ResetSimulation.Request.SCOPE_SPAWNED)
    command(WeightOnBit(force=15.0), "weight_on_bit", 15.0)
    client.step(0.1)
    assert client.change(DEACTIVATE)
    client.step(0.05)
    assert client.change(ACTIVATE)
    client.step(0.1)
    assert statuses[-1].state != Status.STATE_INACTIVE


def messages(path, topic, kind):
    codec = Codec(kind, find_definition(kind))
    with rpud_sim.bag.open(path) as opened:
        return [codec.decode(message.data) for message in opened.messages({topic})]


def test_it_is_proved(bag):
    verification = verify(bag)
    assert verification.proved, verification.first_difference
    assert verification.warnings == ()
    assert {name.removeprefix("/rpud/") for name in verification.topics} == set(PLAIN_PROVED)
    for name, counts in verification.topics.items():
        assert counts.equal > 0
        assert (counts.different, counts.unexpected) == (0, 0)
        # Latched ground truth may be overwritten before it is sent; all else arrives.
        assert counts.missing == 0 or name == "/rpud/faults"


def test_the_journal_holds_all_that_happened(bag):
    entries = messages(bag, JOURNAL, "rpud_msgs/msg/JournalEntry")
    assert [entry.sequence for entry in entries] == list(range(len(entries)))
    kinds = {entry.kind for entry in entries}
    assert kinds >= {"begin", "origin", "weight_on_bit", "drive", "configure", "inject"}
    assert kinds >= {"clear_all", "stop", "flush", "end"}
    assert [entry.kind for entry in entries].count("begin") == 2


@contextlib.contextmanager
def streaming(client):
    """Command another weight on bit at 100 Hz meanwhile, as a controller of an arm does."""
    stop = threading.Event()

    def stream():
        for number in itertools.count():
            client.command(WeightOnBit(force=10.0 + 0.001 * number))
            if stop.wait(0.01):
                return

    client.command(WeightOnBit(force=9.0))  # it waits for the drill
    thread = threading.Thread(target=stream)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def await_entries(client, count):
    """Wait until the journal has so many further entries."""
    client.until(lambda: client.status)
    before = client.status[-1].journal_entries
    client.until(lambda: client.status[-1].journal_entries >= before + count)


def proved(bag, recorder):
    """Check that a bag holds all of its drill's journal, and give its proof."""
    entries = messages(bag, JOURNAL, "rpud_msgs/msg/JournalEntry")
    found = sorted(entry.sequence for entry in entries)
    assert (found[0], found[-1]) == (0, len(found) - 1), recorder.output
    verification = verify(bag)
    # Of a recorder that stood still or came late the bag is incomplete, and each message equal.
    wrong = verification.first_difference, verification.undecided, verification.total.tail
    assert wrong == (None, "", 0), verification.total
    assert verification.begins is None
    assert verification.topics["/rpud/nodal_plane"].equal > 50
    return verification


@pytest.mark.extended
def test_a_recorder_that_stands_still_in_a_stream_of_commands(
    process, start_drill, connect, tmp_path
):
    drill = start_drill("/rpud")
    client = connect("/rpud")
    recorder = process("rpud", "record", "--out", tmp_path / "bag")
    known(client, recorder, "journal")
    with streaming(client):
        await_entries(client, 100)
        os.kill(recorder.pid, signal.SIGSTOP)
        await_entries(client, 2500)
        os.kill(recorder.pid, signal.SIGCONT)
        recorder.wait_for_line(r"fetched \d+ missing entries of /rpud/journal")
        await_entries(client, 200)
    end(drill, recorder)
    verification = proved(tmp_path / "bag", recorder)
    # What it has missed is counted, by the recorder and by the proof.
    missing = {name: counts.missing for name, counts in verification.topics.items()}
    assert missing == {name: verification.lost[name] for name in missing}
    assert missing["/rpud/nodal_plane"] > 500
