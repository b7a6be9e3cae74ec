"""``rpud record`` and ``rpud replay``, and the executables of ``ros2 run``.

``drill_node``, ``recorder`` and ``replayer`` load ROS when they run, so that a missing ROS is an
error in one line.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from rpud_sim.cli.options import (
    DECLARED,
    Parser,
    add_options,
    command,
    fields_of,
    split_ros_arguments,
)
from rpud_sim.cli.program import (
    ExitCode,
    failing,
    progress_bar,
    report_errors,
    run_program,
    status_line,
)
from rpud_sim.foundation.options import parent_flag
from rpud_sim.foundation.quantities import ExpectedError
from rpud_sim.foundation.terminal import printable
from rpud_sim.ros.options import RecordOptions, ReplayOptions

_REPLAY_BAR = "{desc}: {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s{postfix}"


@command(
    "record",
    "--out bags/first --duration 10",
    "record ROS topics into a bag that rosbag2 reads",
    shared=fields_of(RecordOptions),
)
def _record(options: Any, ros_arguments: Sequence[str] = ()) -> int:
    from rpud_sim.ros.record import recorder

    with status_line(printable(Path(options.out).name)) as show:
        result = recorder.record(RecordOptions(**vars(options)), ros_arguments, show)
    if result.summary:
        with suppress(BrokenPipeError):
            print(result.summary, flush=True)
    if result.failure:
        raise ExpectedError(result.failure)
    return ExitCode.DONE


@command(
    "replay",
    "bags/first --rate 0.5",
    "publish a bag's messages with their types, QoS and timing",
    "Exit codes: 0 done, 3 done but for messages that are not plain CDR, 1 failed, 2 usage error.",
    shared=fields_of(ReplayOptions),
)
def _replay(options: Any, ros_arguments: Sequence[str] = ()) -> int:
    from rpud_sim.ros.replay import replayer

    bar = partial(progress_bar, "s", delay=0.0, layout=_REPLAY_BAR)
    result = replayer.replay(ReplayOptions(**vars(options)), ros_arguments, bar)
    print(result.summary, flush=True)
    return ExitCode.DONE if result.complete else ExitCode.INCOMPLETE


# Not a command of ``rpud``, which does not list it.
@command("drill_node", "", "drill", with_parent=parent_flag())
def _drill(options: Any, ros_arguments: Sequence[str]) -> int:
    from rpud_sim.ros.drill.drill_node import drill

    with failing(RuntimeError):
        drill(ros_arguments, options.with_parent)
    return ExitCode.DONE


def drill_node() -> None:
    example = "example: drill_node --ros-args -r __ns:=/rpud --params-file config/free.yaml"
    _execute(
        "drill_node", Parser("drill_node", description="A drill in soft real time.", epilog=example)
    )


def recorder() -> None:
    _execute("record", Parser("recorder", description="Recorder of ROS topics."))


def replayer() -> None:
    _execute("replay", Parser("replayer", description="Replayer of bags."))


def _execute(name: str, parser: Parser) -> None:
    """Run an executable that is the same as a command, which its expected errors name."""
    same = DECLARED[name]
    add_options(parser, same.fields)

    def execute() -> int:
        words, ros_arguments = split_ros_arguments(sys.argv[1:])
        return same.execute(parser.parse_args(words), ros_arguments)

    program = name if name == parser.prog else f"rpud {name}"
    run_program(parser.prog, lambda: report_errors(program, execute))
