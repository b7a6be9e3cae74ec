"""The writer's files are those of the library, byte for byte, however messages come."""

import io
from contextlib import contextmanager

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Channel, Schema
from mcap.writer import CompressionType, Writer
from sample_bags import CHAT, START, STRING_DEFINITION, TALK, serialized_string
from support import examples

import rpud_sim.bag
from rpud_sim.bag import BagError, BagWriter
from rpud_sim.bag.chunks import compressor
from rpud_sim.bag.mcap_writer import McapWriter
from rpud_sim.bag.messages import MessageBlock

TIMES = st.integers(0, 2**62)
MESSAGES = st.lists(
    st.tuples(st.integers(1, 3), TIMES, TIMES, st.binary(max_size=40) | st.just(b"\1" * 3000)),
    max_size=40,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("files")


def library_file(stream, messages, chunk_size):
    """File of the library, with each declaration also outside of the chunks."""
    writer = Writer(stream, chunk_size=chunk_size, compression=CompressionType.NONE)
    writer.start("ros2", "rpud_sim")
    for number, name in enumerate("abc", 1):
        schema = writer.register_schema(name, "ros2msg", b"int32 x\n")
        writer.register_channel(f"/{name}", "cdr", schema, {"key": name})
        copies = RecordBuilder()
        Schema(number, b"int32 x\n", "ros2msg", name).write(copies)
        Channel(number, f"/{name}", "cdr", {"key": name}, number).write(copies)
        stream.write(copies.end())
    for channel, log_time, publish_time, data in messages:
        writer.add_message(channel, log_time, data, publish_time, 7)
    writer.flush()
    writer.add_attachment(1, 2, "notes", "text/plain", b"text")
    writer.add_metadata("made", {"by": "hand"})
    writer.finish()
    return stream.getvalue()


@contextmanager
def written(folder, compression, chunk_size):
    """Own writer with three channels, and the bytes of its file in the end."""
    path = folder / "file.mcap"
    writer = McapWriter(path, compression, chunk_size)
    for name in "abc":
        schema = Schema(0, b"int32 x\n", "ros2msg", name)
        writer.add_channel(f"/{name}", "cdr", schema, {"key": name})
    content = []
    yield writer, content
    writer.finish()
    writer.close()
    content.append(path.read_bytes())
    path.unlink()


@settings(max_examples=examples(30), deadline=None)
@given(MESSAGES, st.sampled_from([100, 2000, 1 << 20]))
def test_one_by_one_the_file_is_that_of_the_library(folder, messages, chunk_size):
    with written(folder, "none", chunk_size) as (writer, content):
        for channel, log_time, publish_time, data in messages:
            writer.write(channel, data, log_time, publish_time, 7)
        writer.flush()
        writer.add_attachment(Attachment(1, 2, "notes", "text/plain", b"text"))
        writer.add_record("made", {"by": "hand"})
    assert content == [library_file(io.BytesIO(), messages, chunk_size)]


def blocks_of(messages):
    """Messages by channel, with their places, between bytes that are none."""
    parts = []
    for channel in {channel for channel, *_ in messages}:
        own = [(place, *rest) for place, (one, *rest) in enumerate(messages) if one == channel]
        data = [each[3] for each in own]
        sizes = np.array([len(each) for each in data], np.int64)
        starts = np.cumsum(sizes + 3) - sizes
        block = MessageBlock(
            f"/{channel}",
            np.array([each[1] for each in own], np.int64),
            np.array([each[2] for each in own], np.int64),
            np.frombuffer(b"".join(b"###" + each for each in data), np.uint8),
            starts,
            sizes,
        )
        parts.append((channel, block, np.array([each[0] for each in own], np.int64)))
    return parts


@settings(max_examples=examples(30), deadline=None)
@given(
    st.lists(MESSAGES, max_size=3),
    st.sampled_from([1, 100, 2000, 1 << 20]),
    st.sampled_from(["none", "lz4", "zstd"]),
)
def test_by_the_block_the_file_is_the_same_as_one_by_one(folder, groups, chunk_size, compression):
    files = []
    for by_block in (False, True):
        with written(folder, compression, chunk_size) as (writer, content):
            for messages in groups:
                if by_block and messages:
                    writer.write_blocks(blocks_of(messages))
                    continue
                for channel, log_time, publish_time, data in messages:
                    writer.write(channel, data, log_time, publish_time, 0)
        files += content
    assert files[0] == files[1]


def test_zstd_has_the_level_that_the_documentation_names():
    data = b"".join(b"%d," % number**2 for number in range(20_000))
    found = compressor("zstd")(data)
    by_level = [zstandard.ZstdCompressor(level=level).compress(data) for level in (-1, 1, 3)]
    assert [found == each for each in by_level] == [True, False, False]


def talk(first, count, topic=TALK):
    data = [serialized_string(f"message {n}") for n in range(first, first + count)]
    sizes = np.array([len(each) for each in data], np.int64)
    times = START + 1_000_000 * np.arange(first, first + count)
    joined = np.frombuffer(b"".join(data), np.uint8)
    return MessageBlock(topic.name, times, times + 5, joined, np.cumsum(sizes) - sizes, sizes)


@pytest.mark.parametrize("options", [{}, {"max_file_size": 70_000}])
def test_a_bag_by_the_block_is_the_same_as_one_by_one(tmp_path, options):
    found = []
    for by_block in (False, True):
        path = tmp_path / str(by_block) / "run"
        with BagWriter(path, chunk_size=2048, compression="none", **options) as bag:
            bag.add_topic(TALK, STRING_DEFINITION)
            bag.add_topic(CHAT, STRING_DEFINITION)
            for first in range(0, 600, 100):
                blocks = [talk(first, 100), talk(first, 10, CHAT)]
                if by_block:
                    bag.write_blocks([(each, 2 * np.arange(len(each))) for each in blocks])
                    continue
                for number in range(100):
                    for each in blocks:
                        if number < len(each):
                            times = int(each.log_times[number]), int(each.publish_times[number])
                            bag.write(each.topic, each.message(number), *times)
        assert bag.message_count == 660
        found.append([file.read_bytes() for file in sorted(path.iterdir())])
    assert found[0] == found[1]
    with rpud_sim.bag.open(path) as bag:
        assert bag.message_count == 660


def test_blocks_of_unknown_topics_and_impossible_times_are_refused(tmp_path):
    with BagWriter(tmp_path / "run") as bag:
        with pytest.raises(BagError, match=r"topic /rpud/talk was not declared"):
            bag.write_blocks([(talk(0, 3), np.arange(3))])
        bag.add_topic(TALK, STRING_DEFINITION)
        block = talk(0, 3)
        block.publish_times[1] = -1
        with pytest.raises(BagError, match=r"publish_time -1 ns; both must be from 0"):
            bag.write_blocks([(block, np.arange(3))])
        assert bag.message_count == 0
