"""The writer's files are those of the library, byte for byte, however messages come."""

import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema
from mcap.writer import CompressionType, Writer
from sample_bags import START, STRING, STRING_DEFINITION, batch_of
from support import examples

from rpud_sim.bag import BagError, BagWriter, Topic
from rpud_sim.bag.mcap_writer import McapWriter

TIMES = st.integers(0, 2**62)
MESSAGES = st.lists(
    st.tuples(st.integers(1, 3), TIMES, TIMES, st.binary(max_size=40) | st.just(b"\1" * 3000)),
    max_size=40,
)


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
        writer.add_message(channel, log_time, data, publish_time)
    writer.flush()
    writer.add_metadata("made", {"by": "hand"})
    writer.finish()
    return stream.getvalue()


@settings(max_examples=examples(30), deadline=None)
@given(MESSAGES, st.sampled_from([100, 2000, 1 << 20]))
def test_one_by_one_the_file_is_that_of_the_library(tmp_path_factory, messages, chunk_size):
    path = tmp_path_factory.mktemp("file") / "file.mcap"
    writer = McapWriter(path, "none", chunk_size)
    for name in "abc":
        schema = Schema(0, b"int32 x\n", "ros2msg", name)
        writer.add_channel(f"/{name}", "cdr", schema, {"key": name})
    for channel, log_time, publish_time, data in messages:
        writer.add(channel, data, log_time, publish_time)
    writer.flush()
    writer.add_record("made", {"by": "hand"})
    writer.finish()
    writer.close()
    assert path.read_bytes() == library_file(io.BytesIO(), messages, chunk_size)


def batches_of(messages):
    """Messages by topic, in one group."""
    batches = []
    for channel in {channel for channel, *_ in messages}:
        own = [(place, *rest) for place, (one, *rest) in enumerate(messages) if one == channel]
        found, *times, data = zip(*own, strict=True)
        batch = batch_of(data, f"/{channel}", b"###", np.transpose(times))
        batches.append(replace(batch, group=1, order=np.array(found, np.int64)))
    return batches


@settings(max_examples=examples(30), deadline=None)
@given(
    st.lists(MESSAGES, max_size=3),
    st.sampled_from([1, 100, 2000, 1 << 20]),
    st.sampled_from(["none", "zstd"]),
)
def test_by_the_batch_a_bag_is_the_same_as_one_by_one(
    tmp_path_factory, groups, chunk_size, compression
):
    folder = tmp_path_factory.mktemp("bags")
    found = []
    for kind in ("single", "batches", "both"):
        path = folder / kind / "run"
        with BagWriter(path, chunk_size=chunk_size, compression=compression) as bag:
            for number in range(1, 4):
                bag.add_topic(Topic(f"/{number}", STRING), STRING_DEFINITION)
            for number, messages in enumerate(groups):
                if kind == "batches" or (kind == "both" and number % 2):
                    bag.write_batches(batches_of(messages))
                    continue
                for channel, log_time, publish_time, data in messages:
                    bag.write(f"/{channel}", data, log_time, publish_time)
        assert bag.message_count == sum(map(len, groups))
        found.append({file.name: file.read_bytes() for file in path.iterdir()})
    assert found[0] == found[1] == found[2]


def test_batches_of_unknown_topics_and_impossible_times_are_refused(tmp_path):
    with BagWriter(tmp_path / "run") as bag:
        with pytest.raises(BagError, match=r"topic /1 was not declared"):
            bag.write_batches(batches_of([(1, START, START, b"")]))
        bag.add_topic(Topic("/1", STRING), STRING_DEFINITION)
        with pytest.raises(BagError, match=r"publish_time -1 ns; both must be from 0"):
            bag.write_batches(batches_of([(1, START, START, b""), (1, START, -1, b"")]))
        assert bag.message_count == 0
