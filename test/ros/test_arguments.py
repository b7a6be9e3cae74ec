"""Numbers on the command line are checked, with one line that names value, unit and range."""

import argparse

import pytest

from rpud_sim.bag.output_file import COMPRESSIONS
from rpud_sim.ros import arguments as arguments_module
from rpud_sim.ros.arguments import add_record_arguments, add_replay_arguments


@pytest.fixture
def record():
    parser = argparse.ArgumentParser(prog="rpud record")
    add_record_arguments(parser)
    return parser


@pytest.fixture
def replay():
    parser = argparse.ArgumentParser(prog="rpud replay")
    add_replay_arguments(parser)
    return parser


def test_defaults(record, replay):
    arguments = record.parse_args(["--out", "bag"])
    assert (arguments.topics, arguments.namespace) == ([], "/rpud")
    assert (arguments.compression, arguments.duration) == ("zstd", None)
    arguments = replay.parse_args(["bag"])
    assert (arguments.rate, arguments.start, arguments.clock) == (1.0, 0.0, None)
    assert (arguments.topics, arguments.loop, arguments.wait_for_subscribers) == (
        None,
        False,
        False,
    )
    assert replay.parse_args(["bag", "--clock"]).clock == 40.0
    assert replay.parse_args(["bag", "--clock", "100"]).clock == 100.0


def test_the_compressions_are_the_writer_s():
    assert set(arguments_module.COMPRESSIONS) == set(COMPRESSIONS)


@pytest.mark.parametrize("value", ["0", "-1", "nan", "inf", "-inf", "fast", ""])
@pytest.mark.parametrize(("option", "unit"), [("--rate", "times real time"), ("--clock", "Hz")])
def test_what_must_be_positive_is_refused_otherwise(replay, capsys, option, unit, value):
    with pytest.raises(SystemExit) as ended:
        replay.parse_args(["bag", f"{option}={value}"])
    assert ended.value.code == 2
    complaint = capsys.readouterr().err.splitlines()[-1]
    assert f"{option}: {value!r}" in complaint
    assert unit in complaint
    assert "greater than 0" in complaint


@pytest.mark.parametrize("value", ["-0.1", "nan", "inf", "x"])
def test_the_start_is_not_before_the_bag(replay, capsys, value):
    with pytest.raises(SystemExit) as ended:
        replay.parse_args(["bag", f"--start={value}"])
    assert ended.value.code == 2
    assert f"--start: {value!r} s; it must be a finite number at least 0" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--rate", "1e7"], "it must be a finite number greater than 0 and at most 1e+06"),
        (["--duration", "0"], "--duration: '0' s; it must be a finite number greater than 0"),
        (["--duration", "1e300"], "it must be a finite number greater than 0 and at most 1e+09"),
        (
            ["--clock", "1e6"],
            "'1e6' Hz; it must be a finite number greater than 0 and at most 10000",
        ),
        (["--remap", "talk:=/b"], "'talk:=/b' is not of the form OLD:=NEW with two absolute topic"),
        (["--remap", "/a:=/b", "/c"], "'/c' is not of the form OLD:=NEW"),
    ],
)
def test_a_replay_refuses_what_cannot_be(replay, capsys, words, complaint):
    with pytest.raises(SystemExit) as ended:
        replay.parse_args(["bag", *words])
    assert ended.value.code == 2
    assert complaint in capsys.readouterr().err


def test_a_replay_takes_rules_for_names(replay):
    arguments = replay.parse_args(["bag", "--remap", "/a:=/b", "/a_1/b:=/c/d"])
    assert arguments.remap == ["/a:=/b", "/a_1/b:=/c/d"]


@pytest.mark.parametrize("option", ["--duration", "--max-loss", "--max-bag-duration"])
@pytest.mark.parametrize("value", ["0", "nan", "inf", "1e300"])
def test_a_duration_is_positive_and_no_eternity(record, capsys, option, value):
    with pytest.raises(SystemExit) as ended:
        record.parse_args(["--out", "bag", f"{option}={value}"])
    assert ended.value.code == 2
    assert f"{option}: {value!r} s; it must be a finite number greater than 0 and at most" in (
        capsys.readouterr().err
    )
