"""Commands, and the command line of each, which follows from the declarations of its options."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Mapping
from types import MappingProxyType, SimpleNamespace
from typing import Any, NamedTuple, NoReturn, TypeAlias, TypeVar

from rpud_sim.foundation.options import DOMAIN, bag_argument, option
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import printable

RUN = Quantity("", "number of a run", 1, 1e9, whole=True)

# Groups of options by a rule; any other name of a group is a title.
AT_MOST_ONE, EXACTLY_ONE = "at most one", "exactly one"

_METAVARS = {"": "N", "%": "PERCENT"}  # of units that are no word

Fields: TypeAlias = Mapping[str, Any]  # declarations of options by name, in their order


class Command(NamedTuple):
    """Command of ``rpud``."""

    example: str  # call of it
    help: str  # what it does
    fields: Fields  # its arguments
    run: Callable[..., int]  # takes the options, returns the exit code
    details: str  # sentences for its own help
    kind: Callable[..., Any]  # makes the options of their values by name


DECLARED: dict[str, Command] = {}
"""Commands of the modules that are loaded, by name."""

_Run = TypeVar("_Run", bound=Callable[..., int])


def command(
    name: str,
    example: str,
    text: str,
    details: str = "",
    shared: Fields | type[Any] = MappingProxyType({}),
    **own: Any,
) -> Callable[[_Run], _Run]:
    """Declare the function of a command: the words of an example, its help, and its options.

    ``shared`` are options that others have, too, or a dataclass with all of them; ``own`` are
    further ones.
    """
    fields = fields_of(shared) if isinstance(shared, type) else {**shared, **own}
    kind: Callable[..., Any] = shared if isinstance(shared, type) else SimpleNamespace

    def declare(run: _Run) -> _Run:
        DECLARED[name] = Command(
            f"rpud {name} {example}".rstrip(), text, fields, run, details, kind
        )
        return run

    return declare


def fields_of(kind: type[Any]) -> Fields:
    """Return the declarations of a dataclass of options."""
    return {field.name: field for field in dataclasses.fields(kind)}


JSON: Fields = {"json": option(False, "print one JSON object", last=True)}
BAG: Fields = {**JSON, "bag": bag_argument()}
# Where a drill runs.
PLACE: Fields = {
    "namespace": option("/rpud", "namespace of the drill (default: %(default)s)", last=True),
    "domain": option(None, "ROS domain (default: ROS_DOMAIN_ID, or 0)", DOMAIN, last=True),
}
ASSIGNMENT: dict[str, Any] = {"flag": "--set", "action": "append", "metavar": "NAME=VALUE"}
PARAMETERS: Fields = {
    "regime": option(
        None,
        "free is before drilling, drilling is in the rock (default: drilling)",
        choices=("free", "drilling"),
    ),
    "config": option(None, "a ROS parameter file, such as config/drilling.yaml", metavar="FILE"),
    "assignments": option((), "set one parameter, in SI units; can be repeated", **ASSIGNMENT),
}


def parameter_values(options: Any) -> dict[str, Any]:
    """Return the given parameters: those of the file, then --regime, then each --set."""
    from rpud_sim.simulation.configuration import parse_assignment, read_parameter_file

    values = read_parameter_file(options.config) if options.config else {}
    if options.regime:
        values["regime"] = options.regime
    values.update(parse_assignment(text) for text in options.assignments)
    return values


def run_number_option(condition: str = "") -> int:
    return option(
        1,
        f"{condition}number of the simulation, if resets or restored checkpoints began "
        "several (default: the first)",
        RUN,
    )


class Parser(argparse.ArgumentParser):
    """Parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Exit with 2."""
        self.exit(2, f"{self.prog}: {printable(message)}; see {self.prog} --help\n")


class _Number(argparse.Action):
    """Argument that is a number in a range; outside, a ParameterError names the option."""

    def __init__(
        self, *arguments: Any, quantity: Quantity, append: bool = False, **options: Any
    ) -> None:
        super().__init__(*arguments, **options)
        self._quantity = quantity
        self._append = append

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        number = self._quantity.check(self.option_strings[-1], _parse_number(values))
        if self._append:
            number = [*(getattr(namespace, self.dest) or ()), number]
        setattr(namespace, self.dest, number)


def _parse_number(text: Any) -> Any:
    """Return the number that a text says; the text itself where it says none."""
    for kind in (int, float):  # integers first: a float would round a long seed
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def add_options(parser: argparse.ArgumentParser, fields: Fields) -> None:
    """Declare arguments, in the order of their fields."""
    groups: dict[str, argparse._ActionsContainer] = {"": parser}
    declared = [(name, field) for name, field in fields.items() if field.metadata]
    for name, field in sorted(declared, key=lambda each: each[1].metadata.get("last", False)):
        words = {key: word for key, word in field.metadata.items() if key != "last"}
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
        flag = words.pop("flag", f"--{name.replace('_', '-')}")
        if isinstance(field.default, bool):
            words["action"] = "store_true"
        elif not words.get("required"):
            words["default"] = None if field.default == () else field.default
        if "quantity" in words:
            unit = words["quantity"].unit
            words = {"action": _Number, "metavar": _METAVARS.get(unit, unit.upper()), **words}
        groups[group].add_argument(flag, dest=name, **words)


def options_from(arguments: argparse.Namespace, fields: Fields, kind: Callable[..., Any]) -> Any:
    """Return the options of parsed arguments; one that is not given has its default."""
    values = {name: field.default for name, field in fields.items()}
    values.update((n, v) for n, v in vars(arguments).items() if n in fields and v is not None)
    return kind(**values)


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
