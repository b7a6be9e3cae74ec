"""What a program prints is text, whatever a bag calls things."""

import base64
import re

import pytest
from frame_reader import decode
from sample_bags import SECOND, START, STRING_DEFINITION, serialized_string
from support import called, extended

from rpud_sim.bag import BagWriter, Topic
from rpud_sim.foundation.terminal import printable

EVIL = "/a\x1b[2J\r\n\x9b\u202e\x00"
ESCAPED = r"/a\x1b[2J\r\n\x9b\u202e\x00"


def test_what_steers_a_terminal_is_escaped_and_all_else_stays():
    assert printable(EVIL) == ESCAPED
    assert printable("\udcff") == r"\udcff"
    plain = "größer 钻 \N{NARROW NO-BREAK SPACE}|"
    assert printable(plain) == plain


@pytest.fixture
def evil_bag(tmp_path):
    path = tmp_path / "evil\x1b[2J"
    with BagWriter(path) as bag:
        bag.add_topic(Topic(EVIL, "std_msgs/msg/String"), STRING_DEFINITION)
        bag.add_topic(Topic("/untold" + EVIL, "pkg/msg/Un\x1btold"))
        for number in range(3):
            time = START + number * SECOND
            bag.write(EVIL, serialized_string(EVIL), time, time)
    return path


@pytest.mark.parametrize(
    "words",
    [
        ["info"],
        ["report", "--out"],
        extended(["export", "--out"]),
        ["recover", "--out"],
        ["verify"],
    ],
)
def test_no_command_prints_what_steers_a_terminal(capsys, evil_bag, tmp_path, words):
    command, *out = words
    out += [tmp_path / "out\x1b[2J"] if out else []
    _, output, errors = called(capsys, command, evil_bag, *out)
    printed = output + errors
    assert r"\x1b[2J" in printed
    assert "Traceback" not in printed
    assert printable(printed.replace("\n", "")) == printed.replace("\n", "")
    if command == "report":
        page = (tmp_path / "out\x1b[2J").read_text(encoding="utf-8")
        [frame] = re.findall('class="frame">([^<]*)<', page)
        assert f"{ESCAPED} " in " ".join(decode(base64.b64decode(frame))["timing"]) + " "
        assert not {"\x1b", "\x9b", "\u202e", "\x00"} & set(page)


@pytest.mark.parametrize(
    "words", [["info"], ["report", "--out"], ["export", "--out"], ["recover", "--out"], ["verify"]]
)
def test_a_name_has_a_greatest_length_wherever_it_is_printed(capsys, tmp_path, words):
    long = "/long name" * 500
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(Topic(long, "std_msgs/msg/String" + long), STRING_DEFINITION)
        bag.add_topic(Topic("/untold" + long, "pkg/msg/Untold" + long))
        bag.add_topic(Topic("/text", "std_msgs/msg/String"), STRING_DEFINITION)
        bag.write(long, b"\0\7\0\0", START, START)
    command, *out = words
    _, output, errors = called(
        capsys, command, tmp_path / "bag", *out, *[tmp_path / "o"] * len(out)
    )
    assert max(map(len, (output + errors).splitlines())) < 1100
    assert "/long name" * 25 not in output + errors


def test_a_long_text_loses_its_middle():
    assert printable("a" * 100 + "b" * 100, 21) == "a" * 9 + "..." + "b" * 9
    assert printable("a" * 21, 21) == "a" * 21
