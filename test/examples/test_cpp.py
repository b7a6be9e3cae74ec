"""The example in C++: it compiles without a warning, and prints the answer to its own command."""

import os
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
PREFIXES = f"{os.environ.get('AMENT_PREFIX_PATH', '')}:{os.environ.get('CMAKE_PREFIX_PATH', '')}"
pytestmark = [
    pytest.mark.extended,
    pytest.mark.skipif(
        not any(Path(p, "share/rclcpp/cmake").is_dir() for p in PREFIXES.split(":") if p),
        reason="no folder of AMENT_PREFIX_PATH or CMAKE_PREFIX_PATH has rclcpp",
    ),
]
WARNINGS = "-DCMAKE_CXX_FLAGS=-Wall -Wextra -Wpedantic -Werror"


def test_it_prints_the_answer_to_its_own_command_and_to_no_earlier_one(process, tmp_path):
    for words in (("-S", EXAMPLES / "cpp", "-B", tmp_path, WARNINGS), ("--build", tmp_path)):
        cmake = process("cmake", *words)
        assert cmake.wait() == 0, cmake.output

    def press(force):
        return process(tmp_path / "press_and_listen", "--ros-args", "-p", f"force:={force}")

    process("drill_node", "--ros-args", "-r", "__ns:=/rpud")
    # Its command has no header: the latched result matches a header that nobody has filled in.
    assert process(sys.executable, EXAMPLES / "press_harder.py").wait() == 0

    accepted = press(20.0)
    accepted.wait_for_line(r"\[rpud.press_and_listen\]: the drill presses with 20.0 N$")
    accepted.wait_for_line(r"\[rpud.press_and_listen\]: reacting force \d+\.\d N$")
    accepted.interrupt()
    assert accepted.wait() == 0
    assert accepted.output.count("presses") == 1

    rejected = press(-3.0)
    rejected.wait_for_line(r"rejected: weight_on_bit")
    rejected.interrupt()
    assert rejected.wait() == 0
    assert "presses" not in rejected.output  # the latched result of the same name
