"""Commands, and the command line of each, which follows from the declarations of its options."""

from __future__ import annotations

import argparse
import dataclasses
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any, NamedTuple, NoReturn, TypeAlias, TypeVar

from rpud_sim.foundation.options import DOMAIN, NAMESPACE, bag_argument, option
from rpud_sim.foundation.quantities import ExpectedError, ParameterError, Quantity, short_repr
from rpud_sim.foundation.terminal import print_error, printable
from rpud_sim.foundation.verbs import EXACTLY_ONE

RUN = Quantity("", "number of a run", 1, 1e9, whole=True)

# Groups of options by a rule; any other name of a group is a title.
AT_MOST_ONE = "at most one"

# Of texts that name a file.
_FILES = ("A", "B", "BAG", "BAG|CAMPAIGN", "DIR", "FILE", "FILE.csv|.parquet", "TORN")
_METAVARS = {"": "N", "%": "PERCENT"}  # metavars of units without a word

Fields: TypeAlias = Mapping[str, Any]  # declarations of options by name, in their order


class Command(NamedTuple):
    """Command of ``rpud``."""

    example: str  # call of it
    help: str  # what it does
    fields: Fields  # its arguments
    run: Callable[..., int]  # takes the options, returns the exit code
    details: str  # sentences for its own help

    def execute(self, arguments: argparse.Namespace, *more: Any) -> int:
        """Run it with parsed arguments; an error names the options, not the arguments of Python."""
        options = options_from(arguments, self.fields)
        try:
            with new_output(arguments, self.fields):
                return self.run(options, *more)
        except ExpectedError as error:
            values = vars(arguments)
            given = {k: v for k, v in self.fields.items() if values.get(k) is not None}
            error.args = (_with_flags(str(error), given),)
            raise


DECLARED: dict[str, Command] = {}
"""Commands of the modules that are loaded, by name."""

_Run = TypeVar("_Run", bound=Callable[..., int])


def command(
    name: str,
    example: str,
    text: str,
    details: str = "",
    shared: Fields = MappingProxyType({}),
    **own: Any,
) -> Callable[[_Run], _Run]:
    """Declare the function of a command: the words of an example, its help, and its options.

    ``shared`` are options that others have, too; ``own`` are further ones.
    """

    def declare(run: _Run) -> _Run:
        call = f"rpud {name} {example}".rstrip()
        DECLARED[name] = Command(call, text, {**shared, **own}, run, details)
        return run

    return declare


def fields_of(kind: type[Any]) -> Fields:
    return {field.name: field for field in dataclasses.fields(kind)}


JSON: Fields = {"json": option(False, "print one JSON object", last=True)}
BAG: Fields = {**JSON, "bag": bag_argument()}
# Where a drill runs.
PLACE: Fields = {
    "namespace": option(NAMESPACE, "namespace of the drill", last=True),
    "domain": option(None, "ROS domain (default: ROS_DOMAIN_ID, or 0)", DOMAIN, last=True),
}
ASSIGNMENT: dict[str, Any] = {"flag": "--set", "action": "append", "metavar": "NAME=VALUE"}
PARAMETERS: Fields = {
    "regime": option(None, "before drilling or in the rock", choices=("free", "drilling")),
    "config": option(None, "a ROS parameter file, such as config/drilling.yaml", metavar="FILE"),
    "assignments": option((), "set one parameter, in SI units; can be repeated", **ASSIGNMENT),
}


def parameter_values(options: Any) -> dict[str, Any]:
    """Return the given parameters: from the file, then --regime, then each --set."""
    from rpud_sim.simulation.configuration import parse_assignment, read_parameter_file

    namespace = getattr(options, "namespace", NAMESPACE).strip("/")
    node = f"/{namespace}/drill_node" if namespace else "/drill_node"
    values = {}
    if options.config:
        values = read_parameter_file(options.config, node, partial(print_error, "rpud"))
    if options.regime:
        values["regime"] = options.regime
    values.update(parse_assignment(text) for text in options.assignments)
    return values


def run_number_option(condition: str = "") -> int:
    return option(1, f"{condition}number of the run, if resets began several", RUN)


class Parser(argparse.ArgumentParser):
    """Parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {printable(message)}; see {self.prog} --help\n")


def add_options(parser: argparse.ArgumentParser, fields: Fields) -> None:
    """Declare arguments, in the order of their fields."""
    groups: dict[str, argparse._ActionsContainer] = {"": parser}
    declared = [(name, field) for name, field in fields.items() if field.metadata]
    for name, field in sorted(declared, key=lambda each: each[1].metadata.get("last", False)):
        words = {key: word for key, word in field.metadata.items() if key not in ("last", "new")}
        group = words.pop("group", "")
        if group not in groups:
            groups[group] = (
                parser.add_mutually_exclusive_group(required=group == EXACTLY_ONE)
                if group in (AT_MOST_ONE, EXACTLY_ONE)
                else parser.add_argument_group(group)
            )
        if words.pop("positional", False):
            groups[group].add_argument(name, **words)
            continue
        words.pop("flag", None)
        if isinstance(field.default, bool):
            words["action"] = "store_true"
        elif not words.get("required"):
            words["default"] = None if field.default == () else field.default
            if words["default"] not in (None, "") and "default" not in words["help"]:
                words["help"] += " (default: %(default)s)"
        if "quantity" in words:
            unit = words.pop("quantity").unit
            words = {"metavar": _METAVARS.get(unit, unit.upper()), **words}
        groups[group].add_argument(_flag(name, field), dest=name, **words)
    for field in filter(_is_new, fields.values()):
        text = f"replace an existing {'bag' if field.metadata['metavar'] == 'DIR' else 'file'}"
        parser.add_argument("--force", action="store_true", help=text)


def _is_new(field: Any) -> bool:
    return bool(field.metadata.get("new"))


@contextmanager
def new_output(arguments: argparse.Namespace, fields: Fields) -> Iterator[None]:
    """Reject an output that exists, or replace it with ``--force``.

    What was there comes back if the command fails to write its output.
    """
    names = [getattr(arguments, name) for name, field in fields.items() if _is_new(field)]
    out = next((Path(name) for name in names if name and os.path.lexists(name)), None)
    if out is None:
        yield
        return
    if not arguments.force:
        raise ExpectedError(f"{out} exists already; --force replaces it")
    marks = ("metadata.yaml", "export.json")
    if out.is_dir() and not any((out / mark).is_file() for mark in marks):
        raise ExpectedError(f"{out} is not a folder of rpud; --force does not replace it")
    aside = out.with_name(f"{out.name}.replaced")
    if os.path.lexists(aside):  # remains of a killed command, or a file of the user
        raise ExpectedError(f"{aside} exists already; move it away before you use --force")
    previous = out.rename(aside)
    try:
        yield
    finally:
        if not os.path.lexists(out):
            previous.rename(out)
        elif previous.is_dir() and not previous.is_symlink():
            shutil.rmtree(previous)
        else:
            previous.unlink()


def _flag(name: str, field: Any) -> str:
    if field.metadata.get("positional"):
        return str(field.metadata["metavar"])
    return str(field.metadata.get("flag", f"--{name.replace('_', '-')}"))


def _with_flags(text: str, fields: Fields) -> str:
    """Return an error with ``--from = 1 s`` for ``begin = 1 s``; after a colon are other names."""
    flags = {name: _flag(name, field) for name, field in fields.items()}
    flags |= {flag[2:]: flag for flag in flags.values()}
    head, colon, reason = text.partition(": ")
    return re.sub(r"(?<!\S)\w+(?= = )", lambda m: flags.get(m[0], m[0]), head) + colon + reason


def options_from(arguments: argparse.Namespace, fields: Fields) -> SimpleNamespace:
    """Return the options of parsed arguments; one that is not given has its default.

    A number outside its range is a ParameterError that names the option. So is an empty text: a
    shell gives it for a variable that is not set. Only the name of a file need not be UTF-8.
    """
    values = {}
    for name, field in fields.items():
        value = getattr(arguments, name, None)
        quantity = field.metadata.get("quantity")
        flag = _flag(name, field)
        if value is None:
            value = field.default
        elif value != field.default and "" in (value if isinstance(value, list) else [value]):
            raise ParameterError(f"{flag} is empty")
        elif quantity and isinstance(value, list):
            value = [quantity.check(flag, _number(each)) for each in value]
        elif quantity:
            value = quantity.check(flag, _number(value))
        elif field.metadata.get("metavar") not in _FILES:
            _check_texts(flag, value)
        values[name] = value
    return SimpleNamespace(**values)


def _check_texts(flag: str, value: Any) -> None:
    """Reject bytes of a shell in Latin-1 and the like, which ROS and JSON cannot hold."""
    for text in value if isinstance(value, list) else [value]:
        try:
            str(text).encode()
        except UnicodeEncodeError:
            raise ParameterError(f"{flag} = {short_repr(text)} is not UTF-8") from None


def _number(value: Any) -> Any:
    """Return the number that a text reports; anything else as it is."""
    if isinstance(value, str):
        for kind in (int, float):  # integers first: a float would round a long seed
            with suppress(ValueError):
                return kind(value)
    return value


def split_ros_arguments(words: list[str]) -> tuple[list[str], list[str]]:
    """Return the words of a program itself, and those for ROS, from ``--ros-args`` to ``--``.

    rclpy would also read an option ``--remap`` of the program as its own.
    """
    own, ros = list(words), []
    while "--ros-args" in own:
        begin = own.index("--ros-args")
        end = own.index("--", begin) + 1 if "--" in own[begin:] else len(own)
        ros += own[begin:end]
        del own[begin:end]
    return own, ros
