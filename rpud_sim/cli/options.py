"""Commands, and the command line of each, which is generated from its options object."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NoReturn, TypeVar

from rpud_sim.foundation.options import DOMAIN, bag_argument, option
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import printable

RUN = Quantity("", "number of a run", 1, 1e9, whole=True)

# Groups of options by a rule; any other name of a group is a title.
AT_MOST_ONE, EXACTLY_ONE = "at most one", "exactly one"

_METAVARS = {"": "N", "%": "PERCENT"}  # of units that are no word

_Options = TypeVar("_Options")


@dataclasses.dataclass(frozen=True)
class Command:
    """Command of ``rpud``."""

    example: str  # call of it
    help: str  # what it does
    options: type[Any]  # frozen dataclass whose fields declare the arguments
    run: Callable[[Any], int]  # takes the options, returns the exit code
    details: str  # sentences for its own help


DECLARED: dict[str, Command] = {}
"""Commands of the modules that are loaded, by name."""

_Run = TypeVar("_Run", bound=Callable[[Any], int])


def command(
    name: str, example: str, text: str, kind: type[Any], details: str = ""
) -> Callable[[_Run], _Run]:
    """Declare the function of a command: the words of an example, its help, and its options."""

    def declare(run: _Run) -> _Run:
        DECLARED[name] = Command(f"rpud {name} {example}".rstrip(), text, kind, run, details)
        return run

    return declare


@dataclasses.dataclass(frozen=True, kw_only=True)
class JsonOptions:
    """Options of a command that prints text or JSON."""

    json: bool = option(False, "print one JSON object", last=True)


@dataclasses.dataclass(frozen=True, kw_only=True)
class BagOptions(JsonOptions):
    """Options of a command that reads a bag."""

    bag: str = bag_argument()


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlaceOptions:
    """Options that say where a drill runs."""

    namespace: str = option("/rpud", "namespace of the drill (default: %(default)s)", last=True)
    domain: int | None = option(
        None, "ROS domain (default: ROS_DOMAIN_ID, or 0)", DOMAIN, last=True
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class ParameterOptions:
    """Options that give parameters of a drill."""

    regime: str | None = option(
        None,
        "free is before drilling, drilling is in the rock (default: drilling)",
        choices=("free", "drilling"),
    )
    config: str | None = option(
        None, "a ROS parameter file, such as config/drilling.yaml", metavar="FILE"
    )
    assignments: Sequence[str] = option(
        (),
        "set one parameter, in SI units; can be repeated",
        flag="--set",
        action="append",
        metavar="NAME=VALUE",
    )

    def values(self) -> dict[str, Any]:
        """Return the given parameters by name: the file's, then --regime, then each --set."""
        from rpud_sim.simulation.configuration import parse_assignment, read_parameter_file

        values = read_parameter_file(self.config) if self.config else {}
        if self.regime:
            values["regime"] = self.regime
        values.update(parse_assignment(text) for text in self.assignments)
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


def add_options(parser: argparse.ArgumentParser, kind: type[Any]) -> None:
    """Declare the arguments of an options object, in the order of its fields."""
    groups: dict[str, argparse._ActionsContainer] = {"": parser}
    declared = [field for field in dataclasses.fields(kind) if field.metadata]
    for field in sorted(declared, key=lambda each: each.metadata.get("last", False)):
        words = {name: word for name, word in field.metadata.items() if name != "last"}
        group = words.pop("group", "")
        if group not in groups:
            groups[group] = (
                parser.add_mutually_exclusive_group(required=group == EXACTLY_ONE)
                if group in (AT_MOST_ONE, EXACTLY_ONE)
                else parser.add_argument_group(group)
            )
        if words.pop("positional", False):
            groups[group].add_argument(field.name, **words)
            continue
        flag = words.pop("flag", f"--{field.name.replace('_', '-')}")
        if isinstance(field.default, bool):
            words["action"] = "store_true"
        elif not words.get("required"):
            words["default"] = None if field.default == () else field.default
        if "quantity" in words:
            unit = words["quantity"].unit
            words = {"action": _Number, "metavar": _METAVARS.get(unit, unit.upper()), **words}
        groups[group].add_argument(flag, dest=field.name, **words)


def options_from(arguments: argparse.Namespace, kind: type[_Options]) -> _Options:
    """Return the options object of parsed arguments."""
    given = {name: value for name, value in vars(arguments).items() if value is not None}
    fields = dataclasses.fields(kind)  # type: ignore[arg-type]  # any dataclass
    return kind(**{field.name: given[field.name] for field in fields if field.name in given})


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
