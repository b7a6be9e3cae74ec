"""What a recovery keeps beside messages, what it counts, and what it leaves out with a reason."""

import struct

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from sample_bags import (
    START,
    STRING,
    STRING_DEFINITION,
    TALK,
    serialized_string,
    write_mcap,
)

import rpud_sim.bag
from rpud_sim.bag import BagWriter
from rpud_sim.bag.metadata import LOSSES_RECORD, RECORDING_RECORD, Losses, losses_to_record
from rpud_sim.bag.recovery import recover


@pytest.mark.parametrize("compression", list(CompressionType))
def test_files_of_other_writers_keep_all_that_they_have(tmp_path, compression):
    torn = tmp_path / "other.mcap"
    with torn.open("wb") as stream:
        writer = Writer(stream, compression=compression)
        writer.start()
        schema = writer.register_schema("my/Type", "jsonschema", b'{"type": "object"}')
        channels = [writer.register_channel("/a", "json", s, {"by": "me"}) for s in (schema, 0)]
        for number in range(6):
            writer.add_message(channels[number % 2], START + number, b"{}", number, 70 + number)
        writer.add_attachment(3, 4, "photo.png", "image/png", b"\x89PNG")
        writer.add_metadata("notes", {"weather": "fine"})
        writer.add_metadata("notes", {"weather": "worse"})
        writer.finish()
    whole = recover(torn, tmp_path / "whole")
    assert (whole.message_count, whole.size_lost, whole.damage_count) == (6, 0, 1)
    torn.write_bytes(torn.read_bytes()[:-30])
    damages = recover(torn, tmp_path / "out").damages
    assert ["is an attachment, which is left out" in each for each in damages][:1] == [True]
    with (tmp_path / "out" / "out_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = [
            (schema, channel.topic, channel.message_encoding, channel.metadata, message)
            for schema, channel, message in reader.iter_messages()
        ]
        notes = [record.metadata for record in reader.iter_metadata() if record.name == "notes"]
    assert [item[1:4] for item in found] == [("/a", "json", {"by": "me"})] * 6
    assert [item[4].publish_time for item in found] == list(range(6))
    assert [item[4].sequence for item in found] == list(range(70, 76))
    assert {item[0] and item[0].name for item in found} == {"my/Type", None}
    assert found[0][0].data == b'{"type": "object"}'
    assert notes == [{"weather": "fine"}, {"weather": "worse"}]


def test_the_recorder_s_records_are_kept_and_shown(tmp_path):
    with BagWriter(tmp_path / "run") as bag:
        bag.add_record(RECORDING_RECORD, {"max_loss": "0.5"})
        bag.add_topic(TALK, STRING_DEFINITION)
        bag.write(TALK.name, serialized_string("kept"), START, START)
        bag.add_record(LOSSES_RECORD, losses_to_record({TALK.name: Losses(3, 1)}))
    file = tmp_path / "run" / "run_0.mcap"
    file.write_bytes(file.read_bytes()[:-9])
    recovery = recover(tmp_path / "run", tmp_path / "out")
    assert recovery.max_loss == 0.5
    assert recovery.topics[TALK.name].recording_losses == Losses(3, 1)
    with rpud_sim.bag.open(tmp_path / "out") as bag:
        assert bag.topics[0].losses == Losses(3, 1)
        assert len(bag.records("rosbag2")) == len(bag.records("rpud_recovery")) == 1


def test_messages_that_rosbag2_cannot_time_are_counted(tmp_path):
    data = struct.pack("<I", 0)
    torn = write_mcap(tmp_path / "other.mcap", [("/a", time, data) for time in (1, 2**63, 2)])
    recovery = recover(torn, tmp_path / "out")
    assert (recovery.message_count, recovery.complete) == (2, False)
    assert recovery.topics["/a"].lost == 1


def odd_bag(path, *, schema=STRING_DEFINITION, offers="", records=()):
    """Write a file with another library: one message, and a part that a new bag cannot hold."""
    return write_mcap(
        path,
        [("/talk", 5, serialized_string("here"))],
        definitions={"/talk": schema},
        metadata={"offered_qos_profiles": offers, "topic_type_hash": "x"},
        records=records,
    )


@pytest.mark.parametrize(
    ("odd", "reason"),
    [
        (
            {"records": [(LOSSES_RECORD, {"/a": '{"transport": -1, "queue": 0}'})]},
            "not a number of",
        ),
        ({"offers": "[1]"}, "the offers on /talk are left out: a profile of offered_qos"),
        ({"schema": b"string data\xff\n"}, "the definition of std_msgs/msg/String is left out"),
        (
            {"records": [("rosbag2", {"serialized_metadata": "{}"}), (LOSSES_RECORD, {"a": "[]"})]},
            "the record rpud_losses is unreadable",
        ),
    ],
)
def test_what_no_bag_can_have_is_left_out_with_its_reason(tmp_path, odd, reason):
    recovery = recover(odd_bag(tmp_path / "odd.mcap", **odd), tmp_path / "out")
    assert not recovery.complete
    assert recovery.damage_count == 1
    assert reason in recovery.damages[0]
    assert recovery.message_count == 1
    with rpud_sim.bag.open(tmp_path / "out") as bag:
        [topic] = bag.topics
        assert topic.topic.type == STRING
        assert [message.data for message in bag.messages()] == [serialized_string("here")]
        if "schema" not in odd:
            assert bag.arrays("/talk")["data"].tolist() == ["here"]
    with next((tmp_path / "out").glob("*.mcap")).open("rb") as stream:
        assert len(list(make_reader(stream, validate_crcs=True).iter_messages())) == 1
