"""Bags of the writer are bags of rosbag2: independent libraries read them."""

import os
import resource
import sys

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from sample_bags import (
    CHAT,
    START,
    STRING,
    STRING_DEFINITION,
    STRING_HASH,
    TALK,
    serialized_string,
    write_bag,
)

import rpud_sim.bag
from rpud_sim.bag import BagError, BagExistsError, BagWriter
from rpud_sim.bag.writer import whole_bag


@pytest.mark.parametrize("compression", ["none", "zstd"])
def test_rosbags_reads_topics_offers_times_and_content(tmp_path, compression):
    write_bag(tmp_path / "run", 10, compression=compression)
    with AnyReader([tmp_path / "run"]) as bag:
        talk, chat = sorted(bag.connections, key=lambda connection: connection.msgcount)[::-1]
        assert (talk.topic, talk.msgtype, talk.msgcount) == (TALK.name, STRING, 10)
        assert talk.digest == STRING_HASH
        assert (chat.topic, chat.msgcount) == (CHAT.name, 0)
        offers = chat.ext.offered_qos_profiles
        assert [offer.reliability for offer in offers] == [
            QosReliability.BEST_EFFORT,
            QosReliability.RELIABLE,
        ]
        assert offers[1].durability == QosDurability.TRANSIENT_LOCAL
        assert offers[0].deadline.sec == 9223372036
        messages = [
            (time, bag.deserialize(data, connection.msgtype).data)
            for connection, time, data in bag.messages()
        ]
    assert messages == [(START + n * 1_000_000, f"message {n}") for n in range(10)]


def test_the_file_has_what_rosbag2_s_has(tmp_path):
    write_bag(tmp_path / "run", 1000, chunk_size=4096)
    with (tmp_path / "run" / "run_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        records = {record.name: record.metadata for record in reader.iter_metadata()}
    channel = next(item for item in summary.channels.values() if item.topic == TALK.name)
    assert channel.metadata.keys() == {"offered_qos_profiles", "topic_type_hash"}
    assert channel.metadata["topic_type_hash"] == STRING_HASH
    assert yaml.safe_load(channel.metadata["offered_qos_profiles"])[0]["durability"] == "volatile"
    document = yaml.safe_load((tmp_path / "run" / "metadata.yaml").read_text())
    record = yaml.safe_load(records["rosbag2"]["serialized_metadata"])
    assert record == document["rosbag2_bagfile_information"]
    assert record["relative_file_paths"] == ["run_0.mcap"]
    counts = [topic["message_count"] for topic in record["topics_with_message_count"]]
    assert counts == [1000, 0]
    assert sorted(os.listdir(tmp_path / "run")) == ["metadata.yaml", "run_0.mcap"]


@pytest.mark.parametrize(
    ("path", "error"),
    [
        *((path, "exists already; a bag is never overwritten") for path in ("run", "file", "")),
        ("file/run", "file/run: Not a directory"),
    ],
)
def test_nothing_is_overwritten(tmp_path, path, error):
    before = (write_bag(tmp_path / "run") / "run_0.mcap").read_bytes()
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match=error) as refused:
        BagWriter(tmp_path / path)
    assert isinstance(refused.value, BagExistsError) == ("exists" in error)
    assert (tmp_path / "run" / "run_0.mcap").read_bytes() == before


def test_an_error_inside_leaves_a_complete_bag(tmp_path):
    def fail():
        with BagWriter(tmp_path / "run") as bag:
            bag.add_topic(TALK, STRING_DEFINITION)
            bag.write(TALK.name, serialized_string("kept"), START, START)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        assert bag.message_count == 1


def test_an_empty_bag_is_complete_and_closing_it_twice_is_harmless(tmp_path):
    writer = BagWriter(tmp_path / "run")
    writer.close()
    writer.close()
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        assert (bag.message_count, bag.duration, bag.topics) == (0, 0, ())
    with AnyReader([tmp_path / "run"]) as bag:
        assert bag.message_count == 0


def test_misuse_is_named(tmp_path):
    with pytest.raises(BagError, match=r"compression is 'lz4'; it must be one of none, zstd"):
        BagWriter(tmp_path / "run", compression="lz4")
    assert not (tmp_path / "run").exists()
    with BagWriter(tmp_path / "run") as bag:
        with pytest.raises(BagError, match=r"/rpud/talk was not declared"):
            bag.write(TALK.name, b"", START, START)
        bag.add_topic(TALK, STRING_DEFINITION)
        with pytest.raises(BagError, match=r"declared twice"):
            bag.add_topic(TALK, STRING_DEFINITION)
        for time in (-1, 2**63):
            with pytest.raises(BagError, match=f"log_time {time} ns"):
                bag.write(TALK.name, b"", time, START)


@pytest.fixture
def small_disk(monkeypatch):
    """Limit the files of this process to 64 KiB; larger writes fail as on a full disk."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # it would be cut off, and stay
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 16, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_is_one_clear_error(tmp_path, small_disk):
    bag = BagWriter(tmp_path / "run", compression="none")
    bag.add_topic(TALK, STRING_DEFINITION)
    for _ in range(6):
        bag.write(TALK.name, bytes(10_000), START, START)
        bag.flush()
    bag.write(TALK.name, bytes(10_000), START, START)
    with pytest.raises(BagError, match=r"/run: File too large"):
        bag.flush()
    bag.close()
    assert not (tmp_path / "run" / "metadata.yaml").exists()


@pytest.mark.parametrize(
    "step",
    ["_sync", "_write_document", *(f"McapWriter.{step}" for step in ("add", "finish"))],
)
def test_an_interruption_at_any_step_leaves_nothing_of_a_whole_bag(tmp_path, monkeypatch, step):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"rpud_sim.bag.writer.{step}", interrupt)
    with pytest.raises(KeyboardInterrupt), whole_bag(tmp_path / "run") as bag:  # noqa: PT012
        bag.add_topic(TALK, STRING_DEFINITION)
        bag.write(TALK.name, serialized_string("one"), START, START)
    assert os.listdir(tmp_path) == []
