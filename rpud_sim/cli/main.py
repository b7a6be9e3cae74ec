"""``rpud``: one program with all commands, in groups."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Iterable, Mapping, Sequence

from rpud_sim.cli.options import DECLARED, Command, Parser, add_options
from rpud_sim.cli.program import report_errors, run_program
from rpud_sim.foundation.quantities import did_you_mean
from rpud_sim.foundation.verbs import VERBS

_MODULES = (
    ("drill", "run", "run"),
    ("drill", "executables", "record replay"),
    ("drill", "simulate", "simulate"),
    ("drill", "run", "watch"),
    (
        *("command a running drill", "drill_commands"),
        f"{' '.join(VERBS)} set echo",
    ),
    ("bags", "bags", "info recover verify"),
    ("bags", "simulate", "fork"),
    ("bags", "bags", "export report"),
    ("bags", "bags", "compare"),
    ("test", "test", "test"),
    ("study", "sweep", "sweep"),
)

COMMANDS: Mapping[str, tuple[str, str]] = {
    name: (group, module) for group, module, names in _MODULES for name in names.split()
}
"""Commands in the order of the help: the group of each, and its module in this package."""

GROUPS = tuple(dict.fromkeys(group for group, _ in COMMANDS.values()))
"""Groups in that order."""


def load_command(name: str) -> Command:
    importlib.import_module(f"rpud_sim.cli.{COMMANDS[name][1]}")
    return DECLARED[name]


def build_parser(names: Iterable[str] = COMMANDS) -> argparse.ArgumentParser:
    """Return the parser of ``rpud`` with some commands, by default all."""
    loaded = {name: load_command(name) for name in names}
    parser = Parser(
        prog="rpud",
        description="Impact dynamics of a rotary-percussive ultrasonic drill.",
        epilog="\n\n".join(_group_help(group, loaded) for group in GROUPS),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--version", action=_Version, nargs=0, help="print the versions of package, engine and bags"
    )
    commands = parser.add_subparsers(
        dest="command",
        metavar="COMMAND",
        required=True,
        help="one of these; rpud COMMAND --help shows its options",
    )
    for name, each in loaded.items():
        subparser = commands.add_parser(
            name,
            description=f"{each.help[0].upper()}{each.help[1:]}. {each.details}",
            epilog=f"example: {each.example}",
        )
        add_options(subparser, each.fields)
    return parser


class _Version(argparse.Action):
    """Option that prints versions, which are looked up only then, and ends."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from rpud_sim.bag.metadata import VERSION
        from rpud_sim.simulation.versions import ENGINE, version_of

        print(f"rpud_sim {version_of('rpud_sim')}, engine {ENGINE}, bags of rosbag2 {VERSION}")
        parser.exit()


def _group_help(group: str, loaded: Mapping[str, Command]) -> str:
    width = max(map(len, COMMANDS))
    lines = (
        f"  {name:<{width}}  {each.help}"
        for name, each in loaded.items()
        if COMMANDS[name][0] == group
    )
    return "\n".join([f"{group}:", *lines])


def execute(words: Sequence[str]) -> int:
    """Run a command and return its exit code; an expected error is printed as one line."""
    name = words[0] if words else ""
    if name in COMMANDS:
        return report_errors(f"rpud {name}", lambda: _run(build_parser([name]), words))
    parser = build_parser()
    if name and not name.startswith("-"):
        hint = did_you_mean(name, COMMANDS)
        parser.error(f"argument COMMAND: invalid choice: {name!r}{hint}")
    return _run(parser, words)


def _run(parser: argparse.ArgumentParser, words: Sequence[str]) -> int:
    arguments, further = parser.parse_known_args(words)
    chosen = DECLARED[arguments.command]
    if further and "further" not in chosen.fields:
        parser.prog = f"rpud {arguments.command}"
        parser.error(f"unrecognized arguments: {' '.join(further)}")
    arguments.further = further
    return chosen.execute(arguments)


def main(words: Sequence[str] | None = None) -> None:
    words = sys.argv[1:] if words is None else words
    program = f"rpud {words[0]}" if words and words[0] in COMMANDS else "rpud"
    run_program(program, lambda: execute(words))


if __name__ == "__main__":
    main()
