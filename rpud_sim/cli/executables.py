"""Executables of ``ros2 run``: ``drill_node``, ``recorder`` and ``replayer``.

ROS is loaded when they run, so that a missing ROS is an error in one line.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

from rpud_sim.cli import record, replay
from rpud_sim.cli.options import Parser, add_with_parent, options_from, split_ros_arguments
from rpud_sim.cli.program import ExitCode, failing, report_errors, run_program
from rpud_sim.ros.record.record_options import RecordOptions
from rpud_sim.ros.replay.replay_options import ReplayOptions


def drill_node() -> None:
    parser = Parser(
        prog="drill_node",
        description="A drill in soft real time.",
        epilog="example: drill_node --ros-args -r __ns:=/rpud --params-file config/free.yaml",
    )
    add_with_parent(parser)

    def run() -> int:
        words, ros_arguments = split_ros_arguments(sys.argv[1:])
        arguments = parser.parse_args(words)
        from rpud_sim.ros.drill.drill_node import drill
        from rpud_sim.ros.starting import StartError

        with failing(RuntimeError), failing(StartError, code=ExitCode.USAGE):
            drill(ros_arguments, arguments.with_parent)
        return ExitCode.DONE

    _run("drill_node", "drill_node", run)


def recorder() -> None:
    parser = Parser(prog="recorder", description="Recorder of ROS topics.")
    record.add_arguments(parser)

    def run() -> int:
        words, ros_arguments = split_ros_arguments(sys.argv[1:])
        return record.record(options_from(parser.parse_args(words), RecordOptions), ros_arguments)

    _run("recorder", "rpud record", run)


def replayer() -> None:
    parser = Parser(prog="replayer", description="Replayer of bags.")
    replay.add_arguments(parser)

    def run() -> int:
        words, ros_arguments = split_ros_arguments(sys.argv[1:])
        return replay.replay(options_from(parser.parse_args(words), ReplayOptions), ros_arguments)

    _run("replayer", "rpud replay", run)


def _run(program: str, command: str, run: Callable[[], int]) -> None:
    """Run an executable; its expected errors name the command that it is the same as."""
    run_program(program, lambda: report_errors(command, run))
