"""Recovery keeps every whole message of a torn or damaged bag, and lists the losses."""

import contextlib
import functools
import io
import os
import struct
import tracemalloc
from array import array

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from sample_bags import (
    CHAT,
    START,
    STRING,
    STRING_DEFINITION,
    TALK,
    serialized_string,
    write_bag,
)

import rpud_sim.bag
from rpud_sim.bag import BagError, BagExistsError, BagFormatError, BagNotFoundError, BagWriter
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.bag.losses import RECORD_NAME, RECORDING_RECORD, Losses, losses_to_record
from rpud_sim.bag.metadata import FILE_NAME as METADATA_FILE
from rpud_sim.bag.metadata import BagMetadata, FileInformation
from rpud_sim.bag.recovery import recover

COUNT = 60
TEXTS = [f"message {number}" for number in range(COUNT)]
compressions = pytest.mark.parametrize("compression", ["none", "zstd"])


def texts(path):
    with rpud_sim.bag.open(path) as bag:
        return [message.data[8:-1].decode() for message in bag.messages()]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the bytes of a bag of several chunks with a compression."""

    def write(compression):
        path = tmp_path_factory.mktemp("whole") / "run"
        write_bag(path, COUNT, compression=compression, chunk_size=600)
        return (path / "run_0.mcap").read_bytes()

    return functools.cache(write)


def chunks(content):
    return make_reader(io.BytesIO(content)).get_summary().chunk_indexes


def chunk_offsets(content):
    return [index.chunk_start_offset for index in chunks(content)]


def recovered(folder, content):
    """Recover a file of these bytes; return the account and the texts of its messages."""
    torn = folder / "torn.mcap"
    torn.write_bytes(content)
    recovery = recover(torn, folder / "out")
    return recovery, texts(folder / "out")


@compressions
def test_a_whole_bag_comes_back_as_it_was(whole, tmp_path, compression):
    recovery, found = recovered(tmp_path, whole(compression))
    assert found == TEXTS
    assert recovery.complete
    assert (recovery.size_lost, recovery.damages) == (0, [])
    with rpud_sim.bag.open(tmp_path / "out") as bag:
        chat, talk = bag.topics
        times = [(message.log_time, message.publish_time) for message in bag.messages()]
    assert (chat.topic, talk.topic, talk.definition) == (CHAT, TALK, STRING_DEFINITION)
    assert times[1] == (START + 1_000_000, START + 999_000)
    with AnyReader([tmp_path / "out"]) as bag:
        assert bag.message_count == COUNT
    assert sorted(os.listdir(tmp_path / "out")) == ["metadata.yaml", "out_0.mcap"]


@settings(max_examples=30)
@given(data=st.data(), compression=st.sampled_from(["none", "zstd"]))
def test_a_file_cut_off_anywhere_gives_its_messages_up_to_there(
    whole, tmp_path_factory, data, compression
):
    content = whole(compression)
    length = data.draw(st.integers(8, len(content) - 1))
    recovery, found = recovered(tmp_path_factory.mktemp("cut"), content[:length])
    assert found == TEXTS[: len(found)]
    assert not recovery.closed
    assert not recovery.complete
    assert recovery.topics.get(TALK.name) is None or recovery.message_count == len(found)
    for chunk in chunks(content):
        if chunk.chunk_start_offset + chunk.chunk_length <= length:
            assert len(found) > (chunk.message_end_time - START) // 1_000_000


@settings(max_examples=50)
@given(data=st.data(), compression=st.sampled_from(["none", "zstd"]))
def test_a_changed_bit_costs_one_chunk_at_most(whole, tmp_path_factory, data, compression):
    content = bytearray(whole(compression))
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= 1 << data.draw(st.integers(0, 7))
    recovery, found = recovered(tmp_path_factory.mktemp("flip"), content)
    assert found == [text for text in TEXTS if text in found]  # in order, none twice, none other
    assert len(found) >= COUNT - 16
    if len(found) < COUNT:
        assert not recovery.complete
        assert recovery.size_lost > 0
        assert recovery.topics[TALK.name].lost == COUNT - len(found)


@settings(max_examples=50)
@given(data=st.data(), compression=st.sampled_from(["none", "zstd"]))
def test_whatever_happens_to_the_bytes_it_is_a_bag_or_one_error(
    whole, tmp_path_factory, data, compression
):
    content = bytearray(whole(compression))
    for _ in range(data.draw(st.integers(1, 20))):
        place = data.draw(st.integers(0, len(content) - 1))
        kind = data.draw(st.sampled_from(["set", "cut", "double", "insert"]))
        length = data.draw(st.integers(0, 200))
        if kind == "set":
            content[place] = data.draw(st.integers(0, 255))
        elif kind == "cut":
            del content[place : place + length]
        elif kind == "double":
            content[place:place] = content[place : place + length]
        else:
            content[place:place] = bytes(length)
        if not content:
            return
    folder = tmp_path_factory.mktemp("damaged")
    with contextlib.suppress(BagError):
        _, found = recovered(folder, content)
        assert found is not None
        assert (folder / "out" / "metadata.yaml").is_file()
    assert (folder / "torn.mcap").read_bytes() == content


@pytest.mark.parametrize("place", [1, 2, 5, 8])
@compressions
def test_a_chunk_with_a_wrong_length_is_still_read_or_passed(whole, tmp_path, compression, place):
    content = bytearray(whole(compression))
    second = chunk_offsets(content)[1]
    content[second + place] ^= 0x40
    _, found = recovered(tmp_path, content)
    assert found == TEXTS  # the length inside it is right, and the checksum proves it


def test_where_a_chunk_is_no_chunk_any_more_the_next_one_is_found(whole, tmp_path):
    content = bytearray(whole("zstd"))
    first, second, third, *_ = chunk_offsets(content)
    content[second] = 0x77
    recovery, found = recovered(tmp_path, content)
    assert len(found) < COUNT
    assert found[-1] == TEXTS[-1]
    assert found[0] == TEXTS[0]
    assert "holds no whole record" in recovery.damages[0]
    assert recovery.topics[TALK.name].lost == COUNT - len(found)
    assert 0 < recovery.size_lost < third - first


def test_without_the_end_the_index_of_a_damaged_chunk_shows_its_content(whole, tmp_path):
    content = bytearray(whole("none"))
    second = chunk_offsets(content)[1]
    content[second + 200] ^= 1
    recovery, found = recovered(tmp_path, content[: len(content) - 100])
    assert recovery.topics[TALK.name].lost == COUNT - len(found) > 0
    assert recovery.damages[0].endswith("is a chunk whose checksum is wrong")


def test_of_the_last_chunk_the_messages_that_are_whole_are_saved(tmp_path):
    content = write_bag(tmp_path / "run", COUNT, compression="none") / "run_0.mcap"
    whole = content.read_bytes()
    cut = whole.index(b"message 41")
    recovery, found = recovered(tmp_path, whole[:cut])
    assert found == TEXTS[:41]
    assert recovery.topics[TALK.name].unchecked == 41
    assert "41 messages of it were saved, without a checksum" in recovery.damages[0]


def test_of_a_compressed_chunk_whole_blocks_are_saved(tmp_path):
    with BagWriter(tmp_path / "run") as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        for number in range(200):
            bag.write(TALK.name, serialized_string(f"{number} ") + os.urandom(4000), START, START)
    whole = (tmp_path / "run" / "run_0.mcap").read_bytes()
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(whole[: len(whole) * 3 // 4])
    recovery = recover(torn, tmp_path / "out")
    assert 100 < recovery.message_count < 160
    with rpud_sim.bag.open(tmp_path / "out") as bag:
        numbers = [int(message.data[8:].split()[0]) for message in bag.messages()]
    assert numbers == list(range(len(numbers)))


def test_channels_survive_the_loss_of_the_chunk_that_declares_them(whole, tmp_path):
    content = bytearray(whole("zstd"))
    first = chunk_offsets(content)[0]
    content[first + 60 : first + 200] = os.urandom(140)
    _, found = recovered(tmp_path, content[: len(content) - 100])
    assert found == TEXTS[COUNT - len(found) :]
    assert len(found) > COUNT // 2
    with rpud_sim.bag.open(tmp_path / "out") as bag:
        assert [topic.topic for topic in bag.topics] == [CHAT, TALK]


def test_what_a_crashed_file_system_filled_with_zeros_is_passed(whole, tmp_path):
    content = whole("zstd")
    third = chunk_offsets(content)[2]
    recovery, found = recovered(tmp_path, content[:third] + bytes(3_000_000))
    assert found == TEXTS[: len(found)]
    assert len(found) == (chunks(content)[1].message_end_time - START) // 1_000_000 + 1
    assert recovery.size_lost == 3_000_000


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
def test_files_of_other_writers_keep_all_that_they_have(tmp_path, compression, chunked):
    torn = tmp_path / "other.mcap"
    with torn.open("wb") as stream:
        writer = Writer(stream, compression=compression, use_chunking=chunked)
        writer.start()
        schema = writer.register_schema("my/Type", "jsonschema", b'{"type": "object"}')
        channels = [writer.register_channel("/a", "json", s, {"by": "me"}) for s in (schema, 0)]
        for number in range(6):
            writer.add_message(channels[number % 2], START + number, b"{}", number, 70 + number)
        writer.add_attachment(3, 4, "photo.png", "image/png", b"\x89PNG")
        writer.add_metadata("notes", {"weather": "fine"})
        writer.add_metadata("notes", {"weather": "worse"})
        writer.finish()
    torn.write_bytes(torn.read_bytes()[:-30])
    assert not recover(torn, tmp_path / "out").complete
    with (tmp_path / "out" / "out_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = [
            (schema, channel.topic, channel.message_encoding, channel.metadata, message)
            for schema, channel, message in reader.iter_messages()
        ]
        [attachment] = reader.iter_attachments()
        notes = [record.metadata for record in reader.iter_metadata() if record.name == "notes"]
    assert [item[1:4] for item in found] == [("/a", "json", {"by": "me"})] * 6
    assert [item[4].publish_time for item in found] == list(range(6))
    assert [item[4].sequence for item in found] == list(range(70, 76))
    assert {item[0] and item[0].name for item in found} == {"my/Type", None}
    assert found[0][0].data == b'{"type": "object"}'
    assert (attachment.name, attachment.data, attachment.create_time) == (
        "photo.png",
        b"\x89PNG",
        3,
    )
    assert notes == [{"weather": "fine"}, {"weather": "worse"}]


def test_the_recorder_s_records_are_kept_and_shown(tmp_path):
    with BagWriter(tmp_path / "run", custom_data={"place": "Mars"}) as bag:
        bag.add_record(RECORDING_RECORD, {"max_loss": "0.5"})
        bag.add_topic(TALK, STRING_DEFINITION)
        bag.write(TALK.name, serialized_string("kept"), START, START)
        bag.add_record(RECORD_NAME, losses_to_record({TALK.name: Losses(3, 1)}))
    file = tmp_path / "run" / "run_0.mcap"
    file.write_bytes(file.read_bytes()[:-9])
    recovery = recover(tmp_path / "run", tmp_path / "out")
    assert recovery.max_loss == 0.5
    assert recovery.topics[TALK.name].recording_losses == Losses(3, 1)
    assert "place: Mars" in (tmp_path / "out" / "metadata.yaml").read_text()
    with rpud_sim.bag.open(tmp_path / "out") as bag:
        assert bag.topics[0].losses == Losses(3, 1)
        assert len(bag.records("rosbag2")) == len(bag.records("rpud_recovery")) == 1


@pytest.mark.parametrize(
    ("publishers", "numbers", "gaps"),
    [
        (1, [5, 6, 9, 10, 2**40, 0, 1], 2 + 2**40 - 11),  # at last the drill restarts
        (1, [5, 6, 7], 0),
        (2, [5, 900, 6, 901, 8, 902], 1),
    ],
)
def test_gaps_in_the_numbers_of_impacts_are_counted(tmp_path, publishers, numbers, gaps):
    name = "rpud_msgs/msg/ContactForce"
    definition = find_definition(name)
    codec = Codec(name, definition)
    header = {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "rpud_tool_tip"}
    numbers_of_an_impact = ("peak_force", "contact_duration", "impact_velocity", "impulse")
    energies = ("energy", "energy_transferred")
    others = {**dict.fromkeys((*numbers_of_an_impact, *energies), 0.0), "squeezed": False}
    topic = rpud_sim.bag.Topic(
        "/rpud/contact_force", name, offered_qos=(rpud_sim.bag.QosProfile(),) * publishers
    )
    with BagWriter(tmp_path / "run") as bag:
        bag.add_topic(topic, definition)
        for number in numbers:
            data = codec.encode({"header": header, "sequence": number, **others})
            bag.write(topic.name, data, START, START)
    recovery = recover(tmp_path / "run", tmp_path / "out")
    assert recovery.topics[topic.name].gaps == gaps


def test_blocks_of_a_waveform_have_no_count_of_gaps(tmp_path):
    name = "rpud_msgs/msg/Waveform"
    definition = find_definition(name)
    zeros = array("d", [0.0])
    fields = {
        line.split()[1]: zeros for line in definition.splitlines() if line.startswith("float64[]")
    }
    header = {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": ""}
    data = Codec(name, definition).encode(
        {"header": header, "sequence": 1000, "sample_period": 1e-5, **fields}
    )
    with BagWriter(tmp_path / "run") as bag:
        bag.add_topic(rpud_sim.bag.Topic("/w", name), definition)
        bag.write("/w", data, START, START)
    assert recover(tmp_path / "run", tmp_path / "out").topics["/w"].gaps is None


def test_all_files_of_a_split_bag_become_one(whole, tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run_0.mcap").write_bytes(whole("none"))
    (tmp_path / "run" / "run_1.mcap").write_bytes(whole("zstd")[:-1])
    recovery = recover(tmp_path / "run", tmp_path / "out")
    assert recovery.message_count == 2 * COUNT
    assert not recovery.closed
    with rpud_sim.bag.open(tmp_path / "out") as bag:
        assert [topic.message_count for topic in bag.topics] == [0, 2 * COUNT]


def test_nothing_is_overwritten_or_changed(whole, tmp_path):
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(whole("zstd")[:-50])
    torn.chmod(0o444)
    before = torn.stat()
    recover(torn, tmp_path / "out")
    after = torn.stat()
    assert (after.st_mtime_ns, after.st_size) == (before.st_mtime_ns, before.st_size)
    first = (tmp_path / "out" / "out_0.mcap").read_bytes()
    with pytest.raises(BagExistsError, match="exists already"):
        recover(torn, tmp_path / "out")
    assert (tmp_path / "out" / "out_0.mcap").read_bytes() == first


def test_what_cannot_be_recovered_is_named_and_leaves_nothing(tmp_path):
    with pytest.raises(BagNotFoundError, match=r"no bag at .*missing"):
        recover(tmp_path / "missing", tmp_path / "out")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagNotFoundError, match="empty"):
        recover(tmp_path / "empty", tmp_path / "out")
    for name, content in {"notes": b"some notes of a student" * 100, "nothing": b""}.items():
        file = tmp_path / f"{name}.mcap"
        file.write_bytes(content)
        with pytest.raises(BagFormatError, match="holds nothing of an MCAP file"):
            recover(file, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("mode", ["MESSAGE", "FILE"])
def test_what_rosbag2_compressed_on_its_own_is_refused(whole, tmp_path, mode):
    torn = tmp_path / "torn"
    torn.mkdir()
    (torn / "torn_0.mcap").write_bytes(whole("none"))
    files = (FileInformation("torn_0.mcap", 0, 0, 0),)
    metadata = BagMetadata(0, 0, 0, (), files, compression_format="zstd", compression_mode=mode)
    (torn / METADATA_FILE).write_text(metadata.to_document())
    with pytest.raises(BagFormatError, match=f"compression_mode is '{mode}'"):
        recover(torn, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_recovery_that_fails_midway_leaves_nothing(whole, tmp_path, monkeypatch):
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(whole("none"))
    calls = []

    def fail(size):
        calls.append(size)
        if len(calls) > 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        recover(torn, tmp_path / "out", fail)
    assert not (tmp_path / "out").exists()


def test_progress_adds_up_to_the_files(whole, tmp_path):
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(whole("none")[:-100])
    steps = []
    recover(torn, tmp_path / "out", steps.append)
    assert sum(steps) == torn.stat().st_size
    assert len(steps) > 10


def test_memory_stays_bounded(tmp_path):
    with BagWriter(tmp_path / "run", compression="none", chunk_size=100_000) as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        for number in range(20_000):
            bag.write(TALK.name, bytes(1000), START + number, START)
    file = tmp_path / "run" / "run_0.mcap"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content[:-1])
    del content
    tracemalloc.start()
    recovery = recover(file, tmp_path / "out")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert recovery.message_count > 19_000
    assert peak < 8_000_000


def test_a_chunk_that_is_larger_than_all_memory_is_passed(whole, tmp_path):
    content = whole("zstd")
    place = chunk_offsets(content)[1]
    bomb = RecordBuilder()
    Chunk("zstd", b"\x28\xb5\x2f\xfd", 0, 0, 1, 2**50).write(bomb)
    recovery, found = recovered(tmp_path, content[:place] + bomb.end() + content[place:])
    assert found == TEXTS
    assert "is a chunk of more than" in recovery.damages[0]


def test_messages_that_rosbag2_cannot_time_are_counted(tmp_path):
    torn = tmp_path / "other.mcap"
    with torn.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema(STRING, "ros2msg", STRING_DEFINITION.encode())
        channel = writer.register_channel("/a", "cdr", schema)
        for time in (1, 2**63, 2):
            writer.add_message(channel, time, struct.pack("<I", 0), time)
        writer.finish()
    recovery = recover(torn, tmp_path / "out")
    assert (recovery.message_count, recovery.complete) == (2, False)
    assert recovery.topics["/a"].lost == 1


def odd_bag(path, *, schema=b"string data\n", offers="", records=()):
    """Write a file with another library: one message, and a part that a new bag cannot hold."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "test")
        number = writer.register_schema(STRING, "ros2msg", schema)
        metadata = {"offered_qos_profiles": offers, "topic_type_hash": "x"}
        channel = writer.register_channel("/talk", "cdr", number, metadata)
        writer.add_message(channel, 5, serialized_string("here"), 5)
        for name, content in records:
            writer.add_metadata(name, content)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("odd", "reason"),
    [
        ({"records": [(RECORD_NAME, {"count": "many"})]}, "the record rpud_losses is unreadable"),
        ({"records": [(RECORD_NAME, {"/a": '{"transport": -1, "queue": 0}'})]}, "no number of"),
        ({"offers": "[1]"}, "the offers on /talk are left out: a profile of offered_qos"),
        ({"offers": "- !!timestamp 1"}, "the offers on /talk are left out"),
        ({"schema": b"string data\xff\n"}, "the definition of std_msgs/msg/String is left out"),
        (
            {"records": [("rosbag2", {"serialized_metadata": "{}"}), (RECORD_NAME, {"a": "[]"})]},
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


def test_metadata_that_would_be_too_large_is_left_out(tmp_path):
    content = BagMetadata(0, 0, 0, (), (), custom_data={"a": "x" * 2_000_000}).to_record()
    records = [("rosbag2", {"serialized_metadata": content})]
    recovery = recover(odd_bag(tmp_path / "odd.mcap", records=records), tmp_path / "out")
    assert recovery.damages == ["custom data of 2000001 characters is left out: at most 1048576"]
    with rpud_sim.bag.open(tmp_path / "out") as bag:
        assert bag.message_count == 1


def test_topics_that_no_metadata_can_list_are_refused(tmp_path):
    path = tmp_path / "odd.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "test")
        for number in range(3):
            topic = f"/{'x' * 1_000_000}{number}"
            writer.add_message(writer.register_channel(topic, "cdr", 0), 5, b"", 5)
        writer.finish()
    with pytest.raises(BagFormatError, match="more than the metadata of a bag can list"):
        recover(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()
