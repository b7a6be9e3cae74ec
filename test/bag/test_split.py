"""A bag of several files is one bag for rosbag2's readers and for those of this project."""

import os

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from sample_bags import SECOND, START, STRING_DEFINITION, TALK, serialized_string

import rpud_sim.bag
from rpud_sim.bag import BagWriter, QosProfile, Topic
from rpud_sim.bag.recovery import recover

LATCHED = Topic(
    "/rpud/status", TALK.type, TALK.type_hash, (QosProfile(durability="transient_local"),)
)


def write(path, count=100, **options):
    """Write a latched message, and then ``count`` on TALK, 100 a second."""
    with BagWriter(path, **options) as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        bag.add_topic(LATCHED, STRING_DEFINITION)
        bag.write(LATCHED.name, serialized_string("latched"), START, START)
        for number in range(count):
            time = START + number * SECOND // 100
            bag.write(TALK.name, serialized_string(f"{number:04} " + "x" * 200), time, time - 5)
    return path


def talk(bag):
    return [int(message.data[8:12]) for message in bag.messages([TALK.name])]


def test_by_duration_every_file_begins_with_what_is_latched(tmp_path):
    path = write(tmp_path / "run", max_file_duration=0.25)
    document = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    names = [f"run_{number}.mcap" for number in range(4)]
    assert sorted(os.listdir(path)) == ["metadata.yaml", *names]
    assert document["relative_file_paths"] == names
    assert [file["path"] for file in document["files"]] == names
    assert [file["message_count"] for file in document["files"]] == [26, 26, 26, 26]
    assert document["message_count"] == 104
    assert document["duration"] == {"nanoseconds": 990_000_000}
    for number, (name, file) in enumerate(zip(names, document["files"], strict=True)):
        with (path / name).open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            statistics = reader.get_summary().statistics
            found = [(channel.topic, message) for _, channel, message in reader.iter_messages()]
        begin = file["starting_time"]["nanoseconds_since_epoch"]
        assert begin == statistics.message_start_time
        assert begin + file["duration"]["nanoseconds"] == statistics.message_end_time
        assert statistics.message_count == 26
        assert found[0][0] == LATCHED.name
        assert found[0][1].publish_time == START
        assert found[0][1].log_time == (START + (number * 25 - 1) * 10_000_000 if number else START)
    with AnyReader([path]) as reader:
        assert reader.message_count == 104


@pytest.mark.parametrize("compression", ["none", "zstd"])
def test_by_size_no_file_is_larger(tmp_path, compression):
    path = write(
        tmp_path / "run", 1000, max_file_size=40_000, compression=compression, chunk_size=2000
    )
    sizes = [file.stat().st_size for file in path.glob("*.mcap")]
    assert len(sizes) > 3
    assert max(sizes) <= 40_000
    with rpud_sim.bag.open(path) as bag:
        assert bag.compression == compression
        assert talk(bag) == list(range(1000))
        counts = {summary.topic.name: summary.message_count for summary in bag.topics}
        assert counts == {TALK.name: 1000, LATCHED.name: 1}
        assert bag.message_count == len(list(bag.messages())) == 1001


def test_one_file_of_it_is_a_bag_with_what_it_repeats(tmp_path):
    path = write(tmp_path / "run", max_file_duration=0.25)
    with rpud_sim.bag.open(path / "run_2.mcap") as bag:
        assert talk(bag) == list(range(50, 75))
        assert next(message.topic for message in bag.messages()) == LATCHED.name
        assert bag.message_count == 26


def test_a_message_larger_than_a_file_may_be_has_its_own(tmp_path):
    with BagWriter(tmp_path / "run", max_file_size=50_000) as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        for number in range(3):
            bag.write(TALK.name, os.urandom(100_000), START + number, START)
        assert bag.file_count == 3
        bound = bag.closed_size
        assert bag.size <= bound
    assert sum(file.stat().st_size for file in (tmp_path / "run").iterdir()) <= bound


def test_a_split_on_request_keeps_as_many_latched_messages_as_publishers(tmp_path):
    twice = Topic(LATCHED.name, LATCHED.type, LATCHED.type_hash, LATCHED.offered_qos * 2)
    with BagWriter(tmp_path / "run") as bag:
        bag.add_topic(twice, STRING_DEFINITION)
        for number, text in enumerate("abc"):
            bag.write(twice.name, serialized_string(text), START + number, START + number)
        bag.split()
        bag.split()
    for number, count in enumerate([3, 2, 2]):
        with rpud_sim.bag.open(tmp_path / "run" / f"run_{number}.mcap") as bag:
            assert [chr(message.data[8]) for message in bag.messages()] == list("abc")[-count:]
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        assert [chr(message.data[8]) for message in bag.messages()] == list("abc")


def test_a_torn_one_is_recovered_into_one_file_without_repetitions(tmp_path):
    path = write(tmp_path / "run", 300, max_file_duration=0.25)
    (path / "metadata.yaml").unlink()
    with rpud_sim.bag.open(path) as bag:  # files are in the order of their numbers
        assert bag.message_count == 301
        assert talk(bag) == list(range(300))
    last = path / "run_11.mcap"
    last.write_bytes(last.read_bytes()[:-20])
    with pytest.raises(rpud_sim.bag.BagFormatError, match=r"run_11\.mcap is cut off"):
        rpud_sim.bag.open(path)
    recovery = recover(path, tmp_path / "whole")
    assert not recovery.closed
    assert {name: topic.recovered for name, topic in recovery.topics.items()} == {
        TALK.name: 300,
        LATCHED.name: 1,
    }
    assert not any(topic.lost for topic in recovery.topics.values())
    with rpud_sim.bag.open(tmp_path / "whole") as bag:
        assert talk(bag) == list(range(300))
