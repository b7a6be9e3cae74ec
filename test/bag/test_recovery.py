"""Recovery keeps every whole chunk of a torn or damaged bag, and lists the losses."""

import functools
import io
import os
import struct
import tracemalloc
import zlib

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from raw_mcap import record, text
from rosbags.highlevel import AnyReader
from sample_bags import CHAT, START, STRING_DEFINITION, TALK, write_bag
from support import examples

import rpud_sim.bag
from rpud_sim.bag import BagFormatError, BagNotFoundError, BagWriter
from rpud_sim.bag.records import MAGIC
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


@settings(max_examples=examples(30))
@given(data=st.data(), compression=st.sampled_from(["none", "zstd"]))
def test_a_file_cut_off_anywhere_gives_its_whole_chunks_up_to_there(
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


@settings(max_examples=examples(50))
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


def test_what_cannot_be_recovered_is_named_and_leaves_nothing(tmp_path):
    with pytest.raises(BagNotFoundError, match=r"no bag at .*missing"):
        recover(tmp_path / "missing", tmp_path / "out")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagNotFoundError, match="empty"):
        recover(tmp_path / "empty", tmp_path / "out")
    for name, content in {"notes": b"some notes of a student" * 100, "nothing": b""}.items():
        file = tmp_path / f"{name}.mcap"
        file.write_bytes(content)
        with pytest.raises(BagFormatError, match="has no part of an MCAP file"):
            recover(file, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_progress_adds_up_and_a_failure_in_it_leaves_nothing(whole, tmp_path):
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(whole("none")[:-100])
    steps = []
    recover(torn, tmp_path / "out", steps.append)
    assert sum(steps) == torn.stat().st_size
    assert len(steps) > 10

    def fail(size):
        steps.pop()
        if len(steps) < 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        recover(torn, tmp_path / "other", fail)
    assert not (tmp_path / "other").exists()


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


def packed_chunk(data):
    """Return a chunk of these records, compressed, with its checksum."""
    stored = zstandard.compress(data)
    head = struct.pack("<QQQI", 0, 9, len(data), zlib.crc32(data)) + text("zstd")
    return record(Opcode.CHUNK, head + struct.pack("<Q", len(stored)) + stored)


def test_each_declaration_of_a_chunk_is_parsed_once(tmp_path, monkeypatch):
    parsed = []
    original = rpud_sim.bag.recovery.parse
    monkeypatch.setattr(
        "rpud_sim.bag.recovery.parse", lambda *of, **how: parsed.append(of) or original(*of, **how)
    )
    schema = record(Opcode.SCHEMA, struct.pack("<H", 1) + text("a") + text("ros2msg") + text("x"))
    (tmp_path / "torn.mcap").write_bytes(MAGIC + packed_chunk(20_000 * schema))
    recover(tmp_path / "torn.mcap", tmp_path / "out")
    assert len(parsed) < 10


def test_damage_without_an_index_costs_what_follows_and_the_account_says_how_much(whole, tmp_path):
    content = whole("zstd")
    places = chunk_offsets(content)
    torn = bytearray(content[: places[4]])
    torn[places[3]] = 0  # no record's kind
    recovery, found = recovered(tmp_path, torn)
    assert len(found) == (chunks(content)[2].message_end_time - START) // 1_000_000 + 1
    assert recovery.size_lost == places[4] - places[3]
    assert recovery.damages == [
        f"torn.mcap: byte {places[3]} to {places[4]} ({recovery.size_lost} bytes) "
        "is not a whole chunk"
    ]


def test_messages_outside_of_chunks_are_counted(tmp_path):
    message = record(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 1, 1))
    recovery, found = recovered(tmp_path, MAGIC + 3 * message)
    assert (found, recovery.complete) == ([], False)
    assert recovery.damages == ["torn.mcap: 3 messages outside of chunks are left out"]


def test_too_many_topics_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("rpud_sim.bag.mcap_contents.TOPICS_LIMIT", 10)
    schemas = [
        record(Opcode.SCHEMA, struct.pack("<H", n) + text("a") + text("ros2msg") + text("x"))
        for n in range(1, 12)
    ]
    (tmp_path / "torn.mcap").write_bytes(MAGIC + packed_chunk(b"".join(schemas)))
    recovery = recover(tmp_path / "torn.mcap", tmp_path / "out")
    assert "is a lost chunk: it declares more than 10 topics" in recovery.damages[0]
