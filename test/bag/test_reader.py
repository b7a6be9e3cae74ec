"""Reading is in order, in bounded memory, and damage is one clear error."""

import os

import pytest
from mcap.writer import Writer
from sample_bags import (
    CHAT,
    START,
    STRING_DEFINITION,
    TALK,
    serialized_string,
    write_bag,
    write_mcap,
)
from support import MANY_EXAMPLES

import rpud_sim.bag
import rpud_sim.bag.tables
from rpud_sim.bag import (
    BagError,
    BagFormatError,
    BagNotFoundError,
    BagReader,
    QosProfile,
)
from rpud_sim.bag.metadata import dump_offered_qos


def texts(messages):
    return [message.data[8:-1].decode() for message in messages]


def test_a_bag_lists_its_topics_and_messages(tmp_path):
    write_bag(tmp_path / "run", 11)
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        assert isinstance(bag, BagReader)
        assert bag.path == tmp_path / "run"
        assert bag.message_count == 11
        assert (bag.start_time, bag.end_time) == (START, START + 10_000_000)
        assert bag.duration == 10_000_000
        assert bag.size == (tmp_path / "run" / "run_0.mcap").stat().st_size
        assert bag.compression == "zstd"
        chat, talk = bag.topics
    assert (talk.topic, talk.message_count, talk.definition) == (TALK, 11, STRING_DEFINITION)
    assert (talk.first_time, talk.last_time) == (START, START + 10_000_000)
    assert talk.rate == pytest.approx(1000.0)
    assert talk.losses is None
    assert (chat.topic, chat.message_count, chat.rate) == (CHAT, 0, None)
    assert (chat.first_time, chat.last_time) == (None, None)


@pytest.mark.parametrize("offers", ["- {history: 3", "5", "- depth: x", "[1]", "!!timestamp 1"])
def test_offers_that_cannot_be_read_hide_no_message(tmp_path, offers):
    path = write_mcap(
        tmp_path / "a.mcap",
        [(name, START, serialized_string("hi")) for name in ("/a", "/b")],
        metadata={"offered_qos_profiles": offers},
    )
    said = "a.mcap: the QoS of 2 topics, such as /a, cannot be read: "
    with rpud_sim.bag.open(path) as bag:
        assert [each.topic.offered_qos for each in bag.topics] == [(), ()]
        assert len(list(bag.messages())) == 2
        [unread] = bag.unread_offers
    assert said in unread
    assert "<unicode string>" not in unread
    assert "Error" not in unread


def test_a_topic_has_the_offers_and_types_of_all_its_publishers(tmp_path):
    one, two = QosProfile(durability="volatile"), QosProfile(durability="transient_local")
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        for kind, text, offers in (("a/msg/A", b"int8 x", one), ("a/msg/B", b"int8 y", two)):
            schema = writer.register_schema(kind, "ros2msg", text)
            metadata = {"offered_qos_profiles": dump_offered_qos((offers,))}
            writer.register_channel("/a", "cdr", schema, metadata)
        writer.finish()
    with rpud_sim.bag.open(tmp_path / "a.mcap") as bag:
        [found] = bag.topics
    assert found.topic.offered_qos == (one, two)
    assert found.types == ("a/msg/A", "a/msg/B")


def test_a_closed_bag_is_no_damaged_one(tmp_path):
    bag = rpud_sim.bag.open(write_bag(tmp_path / "run"))
    bag.close()
    for read in (lambda: list(bag.messages()), lambda: bag.topics, lambda: bag.records("rosbag2")):
        with pytest.raises(BagError, match="was closed; open the bag again") as refused:
            read()
        assert not isinstance(refused.value, BagFormatError)


def test_what_is_not_there_is_named(tmp_path):
    with pytest.raises(BagNotFoundError, match=r"no bag at .*missing"):
        rpud_sim.bag.open(tmp_path / "missing")
    with pytest.raises(BagNotFoundError, match=r"neither metadata.yaml nor an MCAP file"):
        rpud_sim.bag.open(tmp_path)
    write_bag(tmp_path / "run")
    (tmp_path / "run" / "run_0.mcap").unlink()
    with pytest.raises(BagNotFoundError, match=r"run_0.mcap, which metadata.yaml lists with 10"):
        rpud_sim.bag.open(tmp_path / "run")


def test_a_file_cut_off_anywhere_is_a_clear_error(tmp_path):
    file = write_bag(tmp_path / "run", 20) / "run_0.mcap"
    size = file.stat().st_size
    for length in sorted({*range(9), *range(0, size, 1 if MANY_EXAMPLES else 17)}, reverse=True):
        os.truncate(file, length)
        with pytest.raises(BagFormatError, match=r"run_0.mcap is (cut off|not an MCAP file|empty)"):
            rpud_sim.bag.open(file)


def many_channels(path, channels, texts):
    """Write a file of two messages on each of many channels, which share a few texts."""
    offers = dump_offered_qos((QosProfile(),))
    names = [f"/talk{number}" for number in range(channels)]
    return write_mcap(
        path,
        [(name, time, serialized_string("x")) for time, name in enumerate(names * 2)],
        definitions={name: f"string data{number % texts}\n" for number, name in enumerate(names)},
        metadata={"offered_qos_profiles": offers, "topic_type_hash": "x"},
        chunk_size=64 * 1024,
    )


def test_what_channels_share_is_read_once(tmp_path, monkeypatch):
    compiled = []
    original = rpud_sim.bag.tables.Codec
    monkeypatch.setattr(
        rpud_sim.bag.tables, "Codec", lambda *kind: compiled.append(kind) or original(*kind)
    )
    with rpud_sim.bag.open(many_channels(tmp_path / "many.mcap", 500, 7)) as bag:
        assert len(bag.topics) == 500
        assert all(topic.message_count == 2 for topic in bag.topics)
        assert bag.left_out == {}
        for topic in bag.topics[:100]:
            assert len(bag.arrays(topic.topic.name)["log_time"]) == 2
    assert len(compiled) == 7
