"""Bags of drills with many commands, and of recorders that came late or lost journal entries."""

import math

import numpy as np
import pytest
from altered_bags import altered, edited, flipped, messages_of, numbered
from forked_runs import JOURNAL
from support import called, extended

import rpud_sim.bag
from rpud_sim.bag.own_records import Manifest
from rpud_sim.messages.batch import rows_of
from rpud_sim.messages.definitions import find_definition, installed_codec
from rpud_sim.recorded.offline_bag import drill_bag
from rpud_sim.recorded.verify import verify
from rpud_sim.simulation.changes import Change, Inject
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.fields import CommandCounts
from rpud_sim.simulation.plan import Beginning, Journal, Plan
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.topics import COMMAND_TOPICS, TOPICS, offered_topics

SECOND = 1_000_000_000
HELD = ("journal", "status", "faults", "wrench", "contact_force", "waveform")


def streamed_bag(path, rate, duration, start, silent=()):
    """Record a drill whose weight on bit is a ramp, from a start on [s].

    The recorder asks the drill for the entries before. Silent topics have no message.
    """
    changes = [
        Change(round(number * SECOND / rate), WeightOnBit(10.0 + number / 1000.0))
        for number in range(1, round(duration * rate))
    ]
    changes.insert(0, Change(0, Inject(Fault("lost_preload", magnitude=0.1))))
    plan = Plan(Beginning(Settings(telemetry_rate=rate)), tuple(changes))
    run = Run(plan, Journal(), HELD.__contains__)
    run.begin(0)
    codecs = {name: installed_codec(TOPICS[name].type) for name in HELD}
    begun = round(start * SECOND)
    with rpud_sim.bag.BagWriter(path) as bag:
        for name in HELD:
            topic = rpud_sim.bag.Topic(f"/rpud/{name}", TOPICS[name].type)
            bag.add_topic(topic, find_definition(topic.type))
        for name in silent:
            bag.add_topic(rpud_sim.bag.Topic(f"/rpud/{name}", "rpud_msgs/msg/WeightOnBit"))

        def write(batches):
            for time, name, values in rows_of(batches):
                if name in HELD and (time >= begun or name == "journal"):
                    bag.write(f"/rpud/{name}", codecs[name].encode(values), max(time, begun), time)

        for second in range(math.ceil(duration) + 1):
            write(run.advance_to(min(second * SECOND, round(duration * SECOND))))
            if run.time == second * SECOND:
                write([run.status("running", CommandCounts(commands_accepted=second * rate))])
    return path


def commanded_bag(path, step, count, *, deferred):
    """Record a drill that gets another weight on bit after each step [ns], as the node gets it.

    With ``deferred``, waveform and trajectory of a step come after its command.
    """
    settings = Settings()
    offered = offered_topics(settings.values())
    run = Run(Plan(Beginning(settings)), Journal(), offered.__contains__)
    random, waiting = np.random.default_rng(5), []
    with drill_bag(path, "/rpud/", offered, Manifest()) as writer:
        run.begin(0)
        writer.write(run.changes())
        for number in range(1, count + 1):
            writer.write(run.advance_to(number * step, waiting.append if deferred else None))
            run.apply(WeightOnBit(random.uniform(0.0, 30.0)))
            run.watch()
            writer.write(run.changes())
            writer.write(batch for stream in waiting for batch in stream if batch is not None)
            waiting.clear()
            if run.time % SECOND == 0:
                writer.write([run.status("running", CommandCounts(commands_accepted=number))])
        writer.write(run.flush(ends=True))
        writer.write([run.status("stopped", CommandCounts(commands_accepted=count))])
    return path


@pytest.mark.parametrize(
    ("step", "count", "deferred"),
    [(SECOND // 100, 300, True), extended(SECOND // 20, 260, False)],
)
def test_a_drill_with_many_commands_is_proved(tmp_path, step, count, deferred):
    path = commanded_bag(tmp_path / "bag", step, count, deferred=deferred)
    assert len(messages_of(path, {JOURNAL})) > count
    verification = verify(path)
    assert verification.proved
    total = verification.total
    assert (total.different, total.missing, total.unexpected) == (0, 0, 0)
    assert verification.simulated == step * count
    # The commands decide: with another one, the bag is not proved.
    change = edited(lambda fields, content: _heavier(content, count * step // 2))
    assert not verify(altered(path, tmp_path / "other", change)).proved


def _heavier(content, time):
    if content.get("time") == time and "force" in content:
        content["force"] += 1e-9


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    return streamed_bag(tmp_path_factory.mktemp("late") / "bag", 400, 2.2, 1.0)


def test_a_recorder_that_came_late_and_has_the_whole_journal_proves_its_bag(late):
    verification = verify(late)
    assert verification.proved
    assert (verification.begins, verification.total.before) == (None, 0)
    assert verification.topics["/rpud/wrench"].equal == 481


def test_commands_that_the_drill_took_and_the_bag_lacks_are_a_warning(tmp_path, late):
    verification = verify(streamed_bag(tmp_path / "bag", 100, 3.1, 0.0, tuple(COMMAND_TOPICS)))
    assert verification.proved
    lacking = "the drill took 300 commands from the first to the last status, and the bag holds 0"
    assert lacking in verification.warnings
    assert not any("commands" in text for text in verify(late).warnings)  # none were to be recorded


def without_last_entries(bag, out, count, change=lambda message: [message.data]):
    entries = len(messages_of(bag, {JOURNAL}))
    numbers = iter(range(1_000_000))

    def cut(message):
        lost = message.topic == JOURNAL and next(numbers) >= entries - count
        return [] if lost else change(message)

    return altered(bag, out, cut)


@pytest.mark.parametrize("count", [2, 120])  # a status counts them, or not
def test_a_journal_that_ends_early_is_no_difference(late, tmp_path, capsys, count):
    verification = verify(without_last_entries(late, tmp_path / "bag", count))
    assert verification.first_difference is None
    assert verification.undecided.startswith("the journal ends early")
    code, output, _ = called(capsys, "verify", tmp_path / "bag")
    assert code == 1
    assert "not decided: the journal ends early" in output


def test_a_flipped_bit_before_an_early_end_is_a_difference(late, tmp_path):
    change = numbered("wrench", 5, lambda m: [flipped(m.data, 60)])
    verification = verify(without_last_entries(late, tmp_path / "bag", 120, change))
    assert verification.first_difference.topic == "/rpud/wrench"
