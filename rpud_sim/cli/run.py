"""``rpud run``: drill in real time, and record if requested."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rpud_sim.cli.live_line import LiveLine, logging_above, summary_text
from rpud_sim.cli.options import (
    POSITIVE_SECONDS,
    Number,
    add_parameter_arguments,
    chosen_parameters,
)
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.recorder_process import RecorderProcess
from rpud_sim.cli.watch import DEFAULT_PORT, PORT
from rpud_sim.cli.watch_process import watching
from rpud_sim.foundation.terminal import complain, printable
from rpud_sim.ros.record.record_options import RecordOptions

if TYPE_CHECKING:
    from rpud_sim.ros.drill.drill_node import DrillNode
    from rpud_sim.ros.stopping import StopRequest

HELP = "drill in real time on ROS topics"
EXAMPLE = "rpud run --duration 10 --record bags/first --set weight_on_bit=20"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_parameter_arguments(parser)
    parser.add_argument(
        "--duration",
        action=Number,
        quantity=POSITIVE_SECONDS,
        metavar="S",
        help="stop after that many seconds (default: at SIGINT or SIGTERM)",
    )
    parser.add_argument(
        "--record",
        metavar="DIR",
        help="record the namespace into a new bag, by a recorder process",
    )
    parser.add_argument(
        "--max-loss",
        action=Number,
        quantity=POSITIVE_SECONDS,
        default=RecordOptions.max_loss,
        metavar="S",
        help="with --record: seconds of messages that a crash may cost at most, where processor "
        "and disk keep up (default: %(default)g)",
    )
    parser.add_argument(
        "--watch",
        action=Number,
        quantity=PORT,
        nargs="?",
        const=str(DEFAULT_PORT),
        metavar="PORT",
        help="also serve the page of the drill, by a process of its own; 0 is a free port "
        f"(default: {DEFAULT_PORT})",
    )
    parser.add_argument(
        "--namespace",
        default=RecordOptions.namespace,
        help="namespace of the node (default: %(default)s)",
    )
    parser.add_argument(
        "--allow-duplicate",
        action="store_true",
        help="drill although a drill of the same name runs; both answer the same requests",
    )
    parser.add_argument("--quiet", action="store_true", help="no live line of rate and forces")


def run(arguments: argparse.Namespace) -> int:
    """Drill until the duration is over or a signal stops it; return the exit code."""
    values = chosen_parameters(arguments)
    from rpud_sim.ros.drill.session import NamesakeError, open_drill
    from rpud_sim.ros.starting import StartError
    from rpud_sim.ros.stopping import StopRequest

    with (
        failing(NamesakeError),
        failing(StartError, code=ExitCode.USAGE),
        StopRequest() as stop,
        watching(arguments.watch, arguments.namespace, stop),
        logging_above(
            not arguments.quiet,
            open_drill(
                values,
                arguments.namespace,
                arguments.duration,
                allow_duplicate=arguments.allow_duplicate,
            ),
        ) as node,
    ):
        return drill(
            node,
            stop,
            "rpud run",
            record=arguments.record,
            max_loss=arguments.max_loss,
            live=not arguments.quiet,
        )


def drill(
    node: DrillNode,
    stop: StopRequest,
    program: str,
    *,
    record: str | None,
    max_loss: float = RecordOptions.max_loss,
    live: bool = True,
) -> ExitCode:
    """Drill to the end, and print a summary; return the exit code.

    ``record`` is a new bag for the node's namespace. A crash may cost it at most ``max_loss`` of
    messages [s].
    """
    if record:
        return _drill_and_record(node, stop, program, record, max_loss, live)
    drilled = _drill(node, stop, program, live)
    _print_summary(node)
    return ExitCode.DONE if drilled else ExitCode.FAILED


def _drill_and_record(
    node: DrillNode, stop: StopRequest, program: str, record: str, max_loss: float, live: bool
) -> ExitCode:
    from rpud_sim.ros.drill.session import await_recorder

    with failing(RuntimeError):
        node.prepare()  # so that the recorder finds its topics, and has the first message
    recorder = RecorderProcess(record, node.get_namespace(), max_loss)
    if not recorder.wait_until_ready(stop):
        closed = recorder.close()
        return ExitCode.DONE if stop.requested and closed else ExitCode.FAILED
    await_recorder(node, stop)
    node.count_sent()
    try:
        drilled = _drill(node, stop, program, live)
    finally:
        recorded = recorder.close()
    for line in recorder.missing(node.sent) if recorded else ():
        recorded = False
        complain(program, line)
    _print_summary(node)
    if recorded:
        print(f"bag: {printable(record)}", flush=True)
    return ExitCode.DONE if drilled and recorded else ExitCode.FAILED


def _print_summary(node: DrillNode) -> None:
    print(summary_text(node.totals.figures(), node.report, node.faults), flush=True)


def _drill(node: DrillNode, stop: StopRequest, program: str, live: bool) -> bool:
    """Drill to the end; print why it failed, and return whether it did not."""
    from rpud_sim.ros.drill.drill_node import spin

    line = LiveLine(live)
    reason = None
    try:
        spin(node, stop, line.show)
    except RuntimeError as error:
        reason = error
    finally:
        line.end()
    if reason is not None:
        complain(program, reason)
    return reason is None
