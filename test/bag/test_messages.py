"""Messages by the block and one by one: those that were written, in the order of log times."""

import contextlib
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType
from sample_bags import (
    START,
    STRING_DEFINITION,
    TALK,
    write_mcap,
)

import rpud_sim.bag
from rpud_sim.bag import BagError, BagFormatError, BagWriter, Message

TOPICS = st.sampled_from(["/a", "/b", "/c"])
ENTRIES = st.lists(
    st.tuples(TOPICS, st.integers(0, 30), st.binary(max_size=12)), min_size=1, max_size=60
)


def one_by_one(bag, **chosen):
    """Messages of each topic, and the error that ends them."""
    duration = chosen.pop("duration", None)
    found, error = {}, ""
    end = None if duration is None else bag.start_time + chosen.get("start", 0) + duration
    try:
        for message in bag.messages(**chosen):
            if end is not None and message.log_time >= end:
                break
            entry = (message.log_time, message.publish_time, message.data)
            found.setdefault(message.topic, []).append(entry)
    except BagError as caught:
        error = str(caught)
    return found, error


def by_batch(bag, **chosen):
    found, error = {}, ""
    try:
        for batch in bag.batches(**chosen):
            assert len(batch)
            entries = zip(
                batch.log_times.tolist(),
                batch.publish_times.tolist(),
                map(batch.message, range(len(batch))),
                strict=True,
            )
            found.setdefault(batch.topic, []).extend(entries)
    except BagError as caught:
        error = str(caught)
    return found, error


def assert_same(path, **chosen):
    with rpud_sim.bag.open(path) as bag:
        expected = one_by_one(bag, **chosen)
        assert by_batch(bag, **chosen) == expected
    assert not expected[1]
    return expected[0]


def after_start(entries):
    return [(topic, START + time, data) for topic, time, data in entries]


@given(
    ENTRIES,
    st.sampled_from(CompressionType),
    st.sampled_from([30, 200, 100_000]),
    st.sampled_from([IndexType.ALL, IndexType.ALL ^ IndexType.MESSAGE]),
    st.booleans(),
    st.none() | st.sets(TOPICS),
    st.integers(0, 20),
    st.none() | st.integers(0, 20),
)
def test_they_are_the_same_whatever_wrote_the_file(
    tmp_path_factory, entries, compression, chunk_size, index, chunked, topics, start, duration
):
    path = tmp_path_factory.mktemp("batches") / "bag.mcap"
    write_mcap(
        path,
        after_start(entries),
        publishers=2,
        compression=compression,
        chunk_size=chunk_size,
        index_types=index,
        use_chunking=chunked,
    )
    assert_same(path, topics=topics, start=start, duration=duration)
    begin = START + min(time for _, time, _ in entries) + start
    expected = [
        Message(topic, START + time, START + number, data)
        for number, (topic, time, data) in enumerate(entries)
        if START + time >= begin and (topics is None or topic in topics)
    ]
    with rpud_sim.bag.open(path) as bag:
        found = [*bag.messages(topics, start)]
    assert sorted(found) == sorted(expected)
    times = [message.log_time for message in found]
    assert times == sorted(times)
    if chunk_size > 10_000 or not chunked:  # in one part those of one time keep their order
        assert found == sorted(expected, key=lambda each: each.log_time)


@pytest.fixture(scope="module")
def atomic_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "bag.mcap"
    entries = [("/a" if number % 3 else "/b", number, bytes(9)) for number in range(80)]
    options = {"compression": CompressionType.NONE, "enable_crcs": False}
    return write_mcap(path, entries, chunk_size=600, **options).read_bytes()


@given(st.data())
def test_a_damaged_file_gives_the_same_error(atomic_file, tmp_path_factory, data):
    content = bytearray(atomic_file)
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.mktemp("damaged") / "bag.mcap"
    path.write_bytes(content)
    try:
        bag = rpud_sim.bag.open(path)
    except BagFormatError:
        return
    with bag:
        with contextlib.suppress(BagFormatError):
            assert len(bag.topics) <= 3
        expected, error = one_by_one(bag)
        found, found_error = by_batch(bag)
    assert found_error == error
    for topic, entries in expected.items():
        # Those at the very time at which the damaged chunk begins may come before the error.
        assert found[topic][: len(entries)] == entries
        assert error or found[topic] == entries


def test_times_that_no_bag_can_have_are_refused_with_their_chunk(tmp_path):
    path = write_mcap(tmp_path / "bag.mcap", [("/a", 1, b"x"), ("/b", 2**63, b"y")])
    with rpud_sim.bag.open(path) as bag:
        with pytest.raises(BagFormatError, match=r"/b has a time of more than .*; rpud recover"):
            list(bag.messages())
        assert [message.data for message in bag.messages(["/a"])] == [b"x"]


@pytest.mark.parametrize(
    ("read", "most"),
    [
        (lambda bag: sum(map(len, bag.batches())), 3_000_000),
        (lambda bag: sum(1 for _ in bag.messages()), 2_000_000),
    ],
)
def test_memory_stays_bounded_by_the_chunks(tmp_path, read, most):
    with BagWriter(tmp_path / "run", compression="none", chunk_size=100_000) as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        for number in range(20_000):
            bag.write(TALK.name, bytes(1000), START + number, START)
    tracemalloc.start()
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        assert read(bag) == 20_000
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < most
