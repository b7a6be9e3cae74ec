"""``rpud``: one program with all commands, in groups."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from rpud_sim.cli.options import Parser
from rpud_sim.cli.program import report_errors, run_program
from rpud_sim.foundation.quantities import did_you_mean

_DRILL, _RUNNING, _BAGS, _TEST, _STUDY = (
    "drill",
    "command a running drill",
    "bags",
    "test",
    "study",
)

COMMANDS: Mapping[str, tuple[str, str]] = {
    "run": (_DRILL, "run"),
    "record": (_DRILL, "record"),
    "replay": (_DRILL, "replay"),
    "simulate": (_DRILL, "simulate"),
    "watch": (_DRILL, "watch"),
    "press": (_RUNNING, "drill_commands"),
    "drive": (_RUNNING, "drill_commands"),
    "feed": (_RUNNING, "drill_commands"),
    "engage": (_RUNNING, "drill_commands"),
    "inject": (_RUNNING, "drill_commands"),
    "clear": (_RUNNING, "drill_commands"),
    "pause": (_RUNNING, "drill_commands"),
    "play": (_RUNNING, "drill_commands"),
    "step": (_RUNNING, "drill_commands"),
    "reset": (_RUNNING, "drill_commands"),
    "set": (_RUNNING, "drill_commands"),
    "echo": (_RUNNING, "echo"),
    "info": (_BAGS, "info"),
    "recover": (_BAGS, "recover"),
    "verify": (_BAGS, "verify"),
    "fork": (_BAGS, "fork"),
    "export": (_BAGS, "export"),
    "report": (_BAGS, "report"),
    "compare": (_BAGS, "compare"),
    "test": (_TEST, "test"),
    "sweep": (_STUDY, "sweep"),
    "fit": (_STUDY, "fit"),
}
"""Commands in the order of the help: the group of each, and its module in this package."""

GROUPS = tuple(dict.fromkeys(group for group, _ in COMMANDS.values()))
"""Groups in that order."""


def load_command(name: str) -> Any:
    """Return what a command is made of: HELP, EXAMPLE, add_arguments and run."""
    module = importlib.import_module(f"rpud_sim.cli.{COMMANDS[name][1]}")
    return getattr(module, "DRILL_COMMANDS", {}).get(name, module)


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of ``rpud`` with all its commands."""
    loaded = {name: load_command(name) for name in COMMANDS}
    parser = Parser(
        prog="rpud",
        description="Impact dynamics of a rotary-percussive ultrasonic drill.",
        epilog="\n\n".join(_group_help(group, loaded) for group in GROUPS),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(
        dest="command",
        metavar="COMMAND",
        required=True,
        help="one of these; rpud COMMAND --help shows its options",
    )
    for name, command in loaded.items():
        subparser = commands.add_parser(
            name,
            description=f"{command.HELP[0].upper()}{command.HELP[1:]}. "
            f"{getattr(command, 'DETAILS', '')}",
            epilog=f"example: {command.EXAMPLE}",
        )
        command.add_arguments(subparser)
        subparser.set_defaults(run=command.run)
    return parser


def _group_help(group: str, loaded: Mapping[str, Any]) -> str:
    width = max(map(len, COMMANDS))
    lines = (
        f"  {name:<{width}}  {loaded[name].HELP}"
        for name, (own, _) in COMMANDS.items()
        if own == group
    )
    return "\n".join([f"{group}:", *lines])


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
    arguments, further = parser.parse_known_args(words)
    if further and not hasattr(arguments, "further"):
        parser.error(f"unrecognized arguments: {' '.join(further)}")
    arguments.further = further
    code: int = arguments.run(arguments)
    return code


def main(words: Sequence[str] | None = None) -> None:
    """Run the command and exit with its code."""
    words = sys.argv[1:] if words is None else words
    program = f"rpud {words[0]}" if words and words[0] in COMMANDS else "rpud"
    run_program(program, lambda: execute(words))


if __name__ == "__main__":
    main()
