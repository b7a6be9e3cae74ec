"""Arguments become checked options; a number outside is one line with value, unit and range."""

import re

import pytest

from rpud_sim.bag.mcap_writer import COMPRESSIONS
from rpud_sim.cli.options import (
    Parser,
    add_options,
    fields_of,
    options_from,
    split_ros_arguments,
)
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros import options as ros_options
from rpud_sim.ros.options import RecordOptions, ReplayOptions


def parsed(kind, *words):
    parser = Parser(prog="rpud")
    add_options(parser, fields_of(kind))
    return kind(**vars(options_from(parser.parse_args(words), fields_of(kind))))


def record(*words):
    return parsed(RecordOptions, "--out", "bag", *words)


def replay(*words):
    return parsed(ReplayOptions, "bag", *words)


def test_the_defaults_of_the_command_line_are_those_of_the_options():
    recorded = record()
    assert recorded == RecordOptions(out="bag", topics=[])
    assert (recorded.namespace, recorded.compression, recorded.max_loss) == ("/rpud", "zstd", 1.0)
    assert replay() == ReplayOptions(bag="bag")
    assert replay("--clock").clock == 40.0
    assert replay("--clock", "100").clock == 100.0
    assert replay("--remap", "/a:=/b", "/a_1/b:=/c/d").remap == ["/a:=/b", "/a_1/b:=/c/d"]
    assert record("--max-bag-size", "1e6").max_bag_size == 1_000_000
    assert set(ros_options.COMPRESSIONS) == set(COMPRESSIONS)


@pytest.mark.parametrize(
    ("make", "words", "complaint"),
    [
        (replay, ["--start=-0.1"], "--start = -0.1 s is outside its range [0, 1e+09] s"),
        (replay, ["--rate", "fast"], "--rate = 'fast' is not a number; its range is (0, 1e+06]"),
        (replay, ["--clock=-inf"], "--clock = -inf Hz is outside its range (0, 10000] Hz"),
        (record, ["--max-loss", "nan"], "--max-loss = nan s is outside its range [1e-09, 1e+09] s"),
        (record, ["--max-disk", "1.5"], "--max-disk = 1.5 bytes is not a whole number"),
    ],
)
def test_numbers_that_cannot_be_are_refused(make, words, complaint):
    with pytest.raises(ParameterError, match=f"^{re.escape(complaint)}$"):
        make(*words)


def test_words_for_ros_are_split_from_those_of_the_program():
    own, ros = split_ros_arguments(
        ["bag", "--ros-args", "-r", "__ns:=/a", "--", "--remap", "/a:=/b", "--ros-args", "-p", "x"]
    )
    assert own == ["bag", "--remap", "/a:=/b"]
    assert ros == ["--ros-args", "-r", "__ns:=/a", "--", "--ros-args", "-p", "x"]


def test_each_exclude_counts():
    recorded = record("--exclude", "a.*", "--exclude", "b")
    assert [each.pattern for each in recorded.exclude] == ["a.*", "b"]
    assert [*replay("--exclude", "/a", "/b", "--exclude", "/c").exclude] == ["/a", "/b", "/c"]
