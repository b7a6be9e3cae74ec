"""Bags that are true although the machine's clock was set while they were recorded."""

from importlib import import_module
from pathlib import Path

import pytest
from altered_bags import altered, flipped, merged, messages_of, numbered
from forked_runs import JOURNAL

from rpud_sim.bag import BagWriter
from rpud_sim.bag import open as open_bag
from rpud_sim.recorded.compare import compare
from rpud_sim.recorded.rebuild import rebuild
from rpud_sim.recorded.runs import runs_of
from rpud_sim.recorded.verify import verify

MS = 1_000_000


def with_steps(source, out, steps):
    """Copy a bag; from each share of its messages on, all times are shifted by so much [ms]."""
    messages = messages_of(source)
    with open_bag(source) as reader, BagWriter(out) as writer:
        for summary in reader.topics:
            writer.add_topic(summary.topic, summary.definition)
        for number, message in enumerate(messages):
            shift = MS * sum(step for share, step in steps if number >= share * len(messages))
            times = message.log_time + shift, message.publish_time + shift
            writer.write(message.topic, message.data, *times)
    return out


@pytest.mark.parametrize(
    "steps",
    [
        [(0.4, -5)],
        [(0.6, -200)],
        [(0.7, 3_600_000)],
        [(0.3, 3_600_000), (0.6, -3_600_000)],
        [(0.2, -50), (0.4, -50), (0.8, 70)],
    ],
)
def test_a_bag_is_proved_whatever_steps_the_clock_made(bag, tmp_path, steps):
    found = verify(with_steps(bag, tmp_path / "bag", steps))
    assert (found.proved, found.total) == (True, verify(bag).total)


def test_each_run_is_proved_when_the_clock_is_set_back(bag, tmp_path):
    path = merged(tmp_path / "twice", (bag, 0, "/rpud"), (bag, 10_000 * MS, "/rpud"))
    found = verify(with_steps(path, tmp_path / "bag", [(0.25, -100), (0.75, -100)]))
    assert (found.proved, found.total) == (True, verify(path).total)


def test_a_step_of_the_clock_is_no_difference_of_two_runs(bag, tmp_path):
    path = with_steps(bag, tmp_path / "bag", [(0.4, -50), (0.6, -5)])
    assert compare([bag, path], begin=0.0).equal_bits


@pytest.mark.extended
def test_a_waveform_is_rebuilt_although_the_clock_was_set_back(bag, tmp_path):
    parquet = import_module("pyarrow.parquet")
    path = with_steps(bag, tmp_path / "bag", [(0.4, -50), (0.6, -5)])
    whole, other = (rebuild(each, tmp_path / out, 2000) for each, out in ((bag, "a"), (path, "b")))
    assert (other.count, other.missing) == (whole.count, whole.missing)
    first, second = (parquet.read_table(Path(each.path, each.table)) for each in (whole, other))
    assert first.equals(second)


def test_an_altered_message_is_named_although_the_clock_was_set_back(bag, tmp_path):
    path = altered(
        bag, tmp_path / "altered", numbered("wrench", 20, lambda m: [flipped(m.data, -8)])
    )
    found, plain = verify(with_steps(path, tmp_path / "bag", [(0.5, -100)])), verify(path)
    assert (found.total.different, found.total) == (1, plain.total)
    assert found.first_difference.stamp == plain.first_difference.stamp


def test_an_entry_that_came_on_two_ways_counts_once(bag, tmp_path):
    entry = messages_of(bag, {JOURNAL})[1]
    with open_bag(bag) as reader, BagWriter(tmp_path / "bag") as writer:
        for summary in reader.topics:
            writer.add_topic(summary.topic, summary.definition)
        for message in messages_of(bag):
            writer.write(message.topic, message.data, *message[1:3])
            if message == entry:
                times = message.log_time + MS, message.publish_time + 13_000
                writer.write(message.topic, message.data, *times)
    with open_bag(bag) as reader, open_bag(tmp_path / "bag") as twice:
        numbers = [[each.entry.sequence for each in run.entries] for run in runs_of(reader)]
        assert [[e.entry.sequence for e in run.entries] for run in runs_of(twice)] == numbers
    assert verify(tmp_path / "bag").proved
