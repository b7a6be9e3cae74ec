"""``rpud``: one program, one file per command, each loaded when it is called."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence

from rpud_sim.cli.options import Parser
from rpud_sim.cli.program import report_errors, run_program
from rpud_sim.foundation.quantities import did_you_mean

COMMANDS = (
    "run",
    "record",
    "replay",
    "press",
    "drive",
    "feed",
    "engage",
    "inject",
    "clear",
    "faults",
    "pause",
    "play",
    "step",
    "reset",
    "set",
    "echo",
    "watch",
    "simulate",
    "info",
    "recover",
    "verify",
    "test",
    "rebuild",
    "fork",
    "export",
    "report",
    "compare",
    "sweep",
    "fit",
    "reproduce",
    "precompile",
)


class _HelpFormatter(argparse.HelpFormatter):
    """Formatter with room for the longest command: argparse forgets that commands are indented."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = 4 + max(len(name) for name in COMMANDS)


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of ``rpud`` with all its commands."""
    parser = Parser(
        prog="rpud",
        description="Impact dynamics of a rotary-percussive ultrasonic drill.",
        formatter_class=_HelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in COMMANDS:
        module = importlib.import_module(f"rpud_sim.cli.{name}")
        details = getattr(module, "DETAILS", "")
        command = commands.add_parser(
            name,
            help=module.HELP,
            description=f"{module.HELP[0].upper()}{module.HELP[1:]}. {details}",
            epilog=f"example: {module.EXAMPLE}",
        )
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return parser


def execute(words: Sequence[str]) -> int:
    """Run a command and return its exit code; an expected error is printed as one line."""
    parser = build_parser()
    name = words[0] if words else ""
    if name in COMMANDS:
        return report_errors(f"rpud {name}", lambda: _run(parser, words))
    if name and not name.startswith("-"):
        hint = did_you_mean(name, COMMANDS)
        parser.error(f"argument COMMAND: invalid choice: {name!r}; {hint}")
    return _run(parser, words)


def _run(parser: argparse.ArgumentParser, words: Sequence[str]) -> int:
    arguments = parser.parse_args(words)
    code: int = arguments.run(arguments)
    return code


def main(words: Sequence[str] | None = None) -> None:
    """Run the command and exit with its code."""
    words = sys.argv[1:] if words is None else words
    program = f"rpud {words[0]}" if words and words[0] in COMMANDS else "rpud"
    run_program(program, lambda: execute(words))


if __name__ == "__main__":
    main()
