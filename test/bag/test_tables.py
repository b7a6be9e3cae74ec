"""Two lines turn any topic of a bag into NumPy arrays or a pandas frame."""

import math
import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_bags import (
    SECOND,
    START,
    STRING_DEFINITION,
    TALK,
    serialized,
    write_everything,
    write_mcap,
    write_offline_bag,
)

import rpud_sim.bag
from rpud_sim.bag import BagError, BagFormatError, BagWriter, Topic
from rpud_sim.bag.tables import _offsets as offsets_of_blocks
from rpud_sim.bag.tables import _starts as starts_of_segments
from rpud_sim.messages.columns import Kind
from rpud_sim.messages.definitions import find_definition
from rpud_sim.simulation import preset
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation

DURATION = 0.31


@pytest.fixture(scope="module")
def drilled(tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "bag"
    write_offline_bag(path, preset("drilling"), DURATION)
    return path


def test_two_lines_give_arrays(drilled):
    bag = rpud_sim.bag.open(drilled)
    impacts = bag.arrays("/rpud/contact_force")
    expected = Simulation(preset("drilling")).advance_to(round(DURATION * 1e9)).impacts
    assert np.array_equal(impacts["peak_force"], expected["peak_force"])
    assert np.array_equal(impacts["sequence"], np.arange(len(expected)))
    times = expected["seconds"] * SECOND + np.rint(expected["fraction"] * SECOND).astype(int)
    assert np.array_equal(impacts["header.stamp"], times)
    assert set(impacts["header.frame_id"]) == {"rpud_tool_tip"}
    units = {column.name: column.unit for column in bag.columns("/rpud/contact_force")}
    assert [*units] == [*impacts]
    assert (units["peak_force"], units["energy"], units["sequence"]) == ("N", "J", "")
    bag.close()


def test_two_lines_give_a_frame(drilled):
    bag = rpud_sim.bag.open(drilled)
    frame = bag.frame("/rpud/reacting_force")
    assert frame.index.name == "log_time"
    assert frame["header.stamp"].dtype == "datetime64[ns]"
    assert len(frame) == 31
    assert frame["force"].resample("100ms").count().tolist() == [9, 10, 10, 2]
    assert bag.frame("/rpud/waveform").index.name == "time"
    assert bag.frame("/rpud/faults")["faults"].tolist() == [[]]
    bag.close()


def test_every_sample_of_a_waveform_has_its_exact_time(drilled):
    with rpud_sim.bag.open(drilled) as bag:
        rows = bag.arrays("/rpud/waveform")
    count = len(rows["time"])
    assert count == 15_500
    assert np.array_equal(rows["sequence"], np.arange(count))
    assert np.array_equal(rows["time"], np.arange(count) * SECOND // 50_000)
    block = Simulation(preset("drilling")).advance_to(round(DURATION * 1e9))
    samples = block.sample(Times.from_grid(0, count, 50_000))
    assert np.array_equal(rows["contact_force"], samples.contact_force)
    assert rows["header.stamp"][2499:2501].tolist() == [0, SECOND // 20]


def _offsets(period, first, count):
    return offsets_of_blocks(period, np.array([first], np.uint64), np.array([count]))


@given(
    st.integers(1, 10**6),
    st.integers(0, 10**9),
    st.integers(0, 10**6),
    st.integers(0, 50),
    st.integers(1, 50),
)
def test_times_of_samples_do_not_depend_on_how_they_are_divided(rate, seconds, more, cut, count):
    first = seconds * rate + more

    def stamp(number):
        return number * SECOND // rate

    together = stamp(first) + _offsets(1.0 / rate, first, cut + count)
    later = stamp(first + cut) + _offsets(1.0 / rate, first + cut, count)
    assert together[cut:].tolist() == later.tolist()
    assert later.tolist() == [stamp(first + cut + k) for k in range(count)]


def test_samples_of_a_rate_that_is_not_whole():
    assert _offsets(0.3, 7, 3).tolist() == [0, 300_000_000, 600_000_000]
    for period in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(BagFormatError, match=r"sample_period = .* s is not the time"):
            _offsets(period, 0, 3)


@pytest.mark.parametrize(
    ("seconds", "fraction"), [(0, math.nan), (0, 1e300), (0, -0.1), (10**10, 0.0), (-1, 0.0)]
)
def test_segments_without_a_time_are_refused(seconds, fraction):
    with pytest.raises(BagFormatError, match="a segment starts at "):
        starts_of_segments(np.array([0, seconds]), np.array([0.5, fraction]))


def test_any_type_of_ros_is_a_table(tmp_path):
    with rpud_sim.bag.open(write_everything(tmp_path / "bag")) as bag:
        table = bag.arrays("/all")
        columns = {column.name: column for column in bag.columns("/all")}
        frame = bag.frame("/all")
    assert [*table] == [*columns]
    assert table["log_time"].tolist() == [START, START + SECOND, START + 2 * SECOND]
    assert table["publish_time"].tolist() == [START] * 3
    assert table["log_time_"].tolist() == [4.5] * 3
    assert table["stamp"].tolist() == [12 * SECOND + 34] * 3
    assert table["age"].tolist() == [-SECOND + 5] * 3
    assert table["parts"][0] == [{"x": 2.0, "turn": 3.0}]
    dtypes = {name: table[name].dtype for name in ("raw", "good", "small", "large")}
    assert dtypes == {"raw": np.uint8, "good": bool, "small": np.int8, "large": np.uint64}
    assert "CONSTANT" not in columns
    units = {name: column.unit for name, column in columns.items() if column.unit}
    assert units == {
        "part.x": "m",
        "part.turn": "rad",
        "matrix": "N, m",
        "ranges": "m",
        "good": "1",
        "log_time_": "s",
    }
    assert columns["stamp"].description == "of the reading"
    assert columns["matrix"].kind is Kind.ARRAY

    assert frame["age"].tolist() == [pd.Timedelta(-SECOND + 5, "ns")] * 3
    assert frame["stamp"].iloc[0] == pd.Timestamp(12 * SECOND + 34)
    assert frame["matrix"].iloc[0].tolist() == [1.0, 2.0, 3.0, 4.0]


def test_several_topics_come_from_one_pass(drilled, monkeypatch):
    with rpud_sim.bag.open(drilled) as bag:
        names = [summary.topic.name for summary in bag.topics]
        single = {name: bag.arrays(name) for name in names}
        passes = []
        batches = bag.batches
        monkeypatch.setattr(
            bag, "batches", lambda *chosen: passes.append(chosen) or batches(*chosen)
        )
        together = bag.arrays(names)
        assert len(passes) == 1
        assert [*bag.arrays(["/rpud/wrench"])] == ["/rpud/wrench"]
        assert bag.arrays([]) == {}
        with pytest.raises(BagError, match="holds no topic '/none'"):
            bag.arrays(["/rpud/wrench", "/none"])
    assert [*together] == names
    for name, table in together.items():
        pair = (
            [(key, each.dtype, repr(each.tolist())) for key, each in one.items()]
            for one in (table, single[name])
        )
        assert next(pair) == next(pair)


def test_batches_are_the_whole_in_pieces_of_bounded_size(tmp_path, monkeypatch):
    monkeypatch.setattr("rpud_sim.bag.tables.BATCH_SIZE", 50_000)
    monkeypatch.setattr("rpud_sim.bag.tables.TOTAL_SIZE", 80_000)
    with rpud_sim.bag.open(write_everything(tmp_path / "bag", 50)) as bag:
        pieces = list(bag.tables())
        whole = bag.arrays("/all")
    assert {piece.topic for piece in pieces} == {"/all"}
    assert max(len(piece) for piece in pieces) < 20
    assert sum(piece.message_count for piece in pieces) == 50
    joined = np.concatenate([piece.columns["log_time"] for piece in pieces])
    assert np.array_equal(joined, whole["log_time"])


def test_a_type_that_changed_within_a_bag_is_not_read_as_the_first(tmp_path):
    def write(name, definition):
        entries = [("/a", 0, b"\x00\x01\x00\x00" + bytes(4))]
        write_mcap(tmp_path / name, entries, kind="pkg/msg/A", definitions={"/a": definition})

    write("a_0.mcap", "int32 a # as it was first told\n")
    write("a_1.mcap", "int32   a # as it is told now\n")
    with rpud_sim.bag.open(tmp_path) as bag:
        assert list(bag.arrays("/a")["a"]) == [0, 0]
    write("a_2.mcap", "float32 a\n")
    with rpud_sim.bag.open(tmp_path) as bag:
        assert bag.left_out == {"/a": "its messages are of several types or definitions"}
        assert (
            bag.left_out is bag.left_out
        )  # every reader of a table asks: with 400 topics it was slow


def test_what_cannot_be_a_table_is_left_out_with_its_reason(tmp_path):
    path = tmp_path / "odd"
    with BagWriter(path) as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        bag.add_topic(Topic("/untold", "pkg/msg/Untold"))
        bag.add_topic(Topic("/wrong", "pkg/msg/Wrong"), "this is no definition !")
    write_mcap(path / "odd_1.mcap", [("/json", 1, b"{}")], encoding="json")
    (path / "metadata.yaml").unlink()
    reasons = {
        "/json": "its messages are 'json'; only 'cdr' is read",
        "/untold": "the bag does not hold the definition of its type",
        "/wrong": "a definition of pkg/msg/Wrong cannot be understood",
    }
    with rpud_sim.bag.open(path) as bag:
        left_out = bag.left_out
        assert list(bag.tables()) == []
        assert left_out.keys() == reasons.keys()
        for topic, reason in reasons.items():
            assert left_out[topic].startswith(reason)
            with pytest.raises(BagFormatError, match=f"odd: {topic} cannot be a table: {reason}"):
                bag.arrays(topic)


def waveform(counts):
    """Return a message of a waveform with so many values of each kind, in turn."""
    kind = "rpud_msgs/msg/Waveform"
    definition = find_definition(kind)
    names = re.findall(r"^float64\[\] (\w+)", definition, re.MULTILINE)
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    fields = dict(zip(names, map(np.zeros, counts), strict=True))
    fields |= {"header": header, "sequence": 0, "sample_period": 0.1}
    return kind, definition, serialized(kind, definition, fields)


STRINGS = (TALK.type, STRING_DEFINITION)


@pytest.mark.parametrize(
    ("kind", "definition", "data", "time", "complaint"),
    [
        (*STRINGS, b"\0\1\0\0\xff\xff", START, "a message of std_msgs/msg/String"),
        (*waveform([3, 3, 3, 3, 3, 2]), START, r"\w+ has 2 values, and \w+ 3"),
    ],
)
def test_a_damaged_message_is_an_error_that_names_its_topic(
    tmp_path, kind, definition, data, time, complaint
):
    path = write_mcap(
        tmp_path / "a.mcap", [("/a", time, data)], kind=kind, definitions={"/a": definition}
    )
    with (
        rpud_sim.bag.open(path) as bag,
        pytest.raises(BagFormatError, match=rf"a\.mcap: /a: {complaint}"),
    ):
        bag.arrays("/a")
