"""`rpud`: one program, one file per command, each loaded when it is called."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import NoReturn

from rpud_sim.foundation.terminal import end_with, printable

COMMANDS = (
    "run",
    "record",
    "replay",
    "simulate",
    "info",
    "recover",
    "verify",
    "rebuild",
    "export",
    "report",
    "sweep",
    "reproduce",
)


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong with a call."""

    def error(self, message: str) -> NoReturn:
        """Exit with 2."""
        self.exit(2, f"{self.prog}: {printable(message)}; see {self.prog} --help\n")


class Help(argparse.HelpFormatter):
    """Leaves room for the longest command: argparse forgets that commands are indented."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = 4 + max(len(name) for name in COMMANDS)


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of `rpud` with all its commands."""
    parser = Parser(
        prog="rpud",
        description="Impact dynamics of a rotary-percussive ultrasonic drill.",
        formatter_class=Help,
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in COMMANDS:
        module = importlib.import_module(f"rpud_sim.cli.{name}")
        command = commands.add_parser(
            name,
            help=module.HELP,
            description=f"{module.HELP[0].upper()}{module.HELP[1:]}.",
            epilog=f"example: {module.EXAMPLE}",
        )
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return parser


def main(words: Sequence[str] | None = None) -> None:
    """Run the command and exit: 0 when it did its work, 1 when it failed, 2 for a wrong call."""
    words = sys.argv[1:] if words is None else words
    program = f"rpud {words[0]}" if words and words[0] in COMMANDS else "rpud"
    end_with(program, lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    arguments = build_parser().parse_args(words)
    code: int = arguments.run(arguments)
    return code


if __name__ == "__main__":
    main()
