"""Every legal MCAP file is read and recovered whole, whatever its summary says or lacks."""

from __future__ import annotations

import warnings
from dataclasses import replace
from itertools import combinations

import pytest
from mcap.reader import make_reader
from raw_mcap import ALL, Chunk, RawMcap, record
from sample_bags import START, serialized_string, write_mcap

import rpud_sim.bag
from rpud_sim.bag import BagFormatError
from rpud_sim.bag.recovery import recover
from rpud_sim.messages.errors import BagWarning

HI = serialized_string("hi")


def at(topic, *times):
    return [(topic, START + time, HI) for time in times]


CHUNKED = RawMcap([Chunk([*at("/a", 1, 2), *at("/b", 3)]), Chunk(at("/a", 4, 9))])
LOOSE = RawMcap([*at("/a", 1, 2), *at("/b", 3), *at("/a", 4, 9)])
MIXED = RawMcap([*at("/a", 1), Chunk([*at("/a", 2), *at("/b", 3)]), *at("/a", 4), *at("/a", 9)])
TIMES = {"/a": [1, 2, 4, 9], "/b": [3]}


def opened(path):
    """Open a bag and return it with its warnings."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        bag = rpud_sim.bag.open(path)
    return bag, [str(each.message) for each in said if each.category is BagWarning]


def check_times(path):
    bag, said = opened(path)
    with bag:
        found = {}
        for message in bag.messages():
            found.setdefault(message.topic, []).append(message.log_time - START)
        assert found == TIMES
        assert {t.topic.name: t.message_count for t in bag.topics} == {"/a": 4, "/b": 1}
        assert (bag.start_time - START, bag.end_time - START, bag.message_count) == (1, 9, 5)
        assert [*bag.arrays("/a")["log_time"] - START] == TIMES["/a"]
        known = [t for t in bag.topics if t.first_time is not None]
        for topic in known:
            times = TIMES[topic.topic.name]
            assert (topic.first_time - START, topic.last_time - START) == (times[0], times[-1])
    return said


@pytest.mark.parametrize("raw", [CHUNKED, LOOSE, MIXED], ids=["chunked", "loose", "mixed"])
@pytest.mark.parametrize("pad", [b"", b"\x01\xff\xff"], ids=["", "padded"])
def test_a_summary_may_lack_each_of_its_parts(tmp_path, raw, pad):
    path = tmp_path / "a.mcap"
    needed = {"schemas", "channels", "statistics", "metadata"}
    needed |= {"chunks"} if raw is not LOOSE else set()
    raw = replace(raw, pad=pad, unknown=bool(pad), metadata={"notes": {"weather": "fine"}})
    for count in range(len(ALL) + 1):
        for names in combinations(sorted(ALL), count):
            path.write_bytes(raw.without(*names).content())
            said = check_times(path)
            with opened(path)[0] as bag:
                assert bag.records("notes") == [{"weather": "fine"}]
            whole = ["the whole file was read to open it" in each for each in said]
            assert whole == ([True] if needed & {*names} else [])


@pytest.mark.parametrize("changes", [{}, {"pad": b"\x01\xff"}, {"footer_pad": b"\x01"}], ids=str)
@pytest.mark.parametrize("summary", [True, False])
def test_a_legal_file_of_chunks_is_recovered_whole(tmp_path, changes, summary):
    path = tmp_path / "a.mcap"
    path.write_bytes(replace(CHUNKED, **changes, summary=summary, unknown=True).content())
    check_times(path)
    found = recover(path, tmp_path / "out")
    assert (found.complete, found.message_count, found.size_lost) == (True, 5, 0)
    assert check_times(tmp_path / "out") == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"message_start_time": START + 4},
        {"message_end_time": START + 2},
        {"message_start_time": START + 4, "message_end_time": START + 4},
        {"message_count": 3},
        {"message_count": 0},
        {"chunk_count": 1},
    ],
    ids=str,
)
def test_wrong_statistics_hide_no_message(tmp_path, wrong):
    path = tmp_path / "a.mcap"
    path.write_bytes(replace(CHUNKED, statistics=wrong).content())
    check_times(path)


def test_a_message_at_time_zero_is_read_where_the_statistics_took_it_for_none(tmp_path):
    path = tmp_path / "a.mcap"
    messages = [("/a", time, HI) for time in (0, 1, 2)]
    for parts in ([Chunk(messages)], [Chunk(messages, (1, 2))], messages):
        path.write_bytes(RawMcap(parts, statistics={"message_start_time": 1}).content())
        with rpud_sim.bag.open(path) as bag:
            assert [each.log_time for each in bag.messages()] == [0, 1, 2]
            assert [*bag.arrays("/a")["log_time"]] == [0, 1, 2]
            assert [*bag.arrays("/a", start=1)["log_time"]] in ([1, 2], [2])


def test_chunks_that_overlap_show_the_first_and_the_last_time_of_a_topic(tmp_path):
    path = tmp_path / "a.mcap"
    parts = [
        Chunk([*at("/a", 0), *at("/b", 13, 14), *at("/a", 20)]),
        Chunk([*at("/b", *range(5, 13))]),
        Chunk([*at("/a", 2), *at("/c", 6), *at("/a", 19)]),
    ]
    for raw in (RawMcap(parts), RawMcap(parts).without("message indexes")):
        path.write_bytes(raw.content())
        with rpud_sim.bag.open(path) as bag:
            spans = [(t.first_time - START, t.last_time - START) for t in bag.topics]
            assert spans == [(0, 20), (5, 14), (6, 6)]
            assert bag.topics[1].rate == pytest.approx(1e9)


def test_messages_that_an_index_brings_out_of_order_are_refused(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(
        RawMcap([Chunk(at("/a", 5, 9)), Chunk(at("/a", 7, 12), (START + 10,) * 2)]).content()
    )
    with rpud_sim.bag.open(path) as bag:
        for read in (bag.messages, bag.batches):
            with pytest.raises(
                BagFormatError, match=r"a\.mcap: .* earlier than its chunk begins; rpud"
            ):
                list(read())
    assert recover(path, tmp_path / "out").message_count == 4


def test_a_damaged_file_without_a_summary_names_recover(tmp_path):
    path = tmp_path / "a.mcap"
    content = replace(CHUNKED, summary=False).content()
    path.write_bytes(content.replace(HI, HI[::-1]))
    with pytest.raises(
        BagFormatError, match="the checksum of a chunk is wrong; rpud recover makes"
    ):
        rpud_sim.bag.open(path)


@pytest.mark.parametrize("kept", [30, 200, -37])
def test_an_end_without_a_footer_names_recover(tmp_path, kept):
    path = tmp_path / "a.mcap"
    content = replace(LOOSE, summary=False).content()
    path.write_bytes(content[:kept] + content[-8:])
    with pytest.raises(BagFormatError, match="has no footer; rpud recover makes a whole bag"):
        rpud_sim.bag.open(path)


def test_undeclared_messages_are_refused(tmp_path):
    path = tmp_path / "a.mcap"
    channel = record(4, b"\1\0\1\0\2\0\0\0/a")
    raw = replace(LOOSE, summary=False).content()
    assert channel[9:15] in raw
    path.write_bytes(raw.replace(channel[9:13], b"\7\0\1\0"))
    with pytest.raises(BagFormatError, match="messages without a channel; rpud recover"):
        rpud_sim.bag.open(path)


def test_the_library_reads_the_files_of_these_tests(tmp_path):
    for raw in (CHUNKED, LOOSE):
        (tmp_path / "a.mcap").write_bytes(raw.content())
        with (tmp_path / "a.mcap").open("rb") as stream:
            assert len(list(make_reader(stream, validate_crcs=True).iter_messages())) == 5
    path = write_mcap(tmp_path / "b.mcap", at("/a", 1))
    bag, said = opened(path)
    bag.close()
    assert said == []
