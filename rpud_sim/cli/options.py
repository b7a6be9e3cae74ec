"""Arguments of all programs: one parser, checked numbers, and arguments that commands share."""

from __future__ import annotations

import argparse
import dataclasses
import os
import re
from typing import Any, NoReturn, TypeVar

from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import printable

LONGEST = 1e9  # greatest number of seconds that an option accepts: thirty years

POSITIVE_SECONDS = Quantity("s", "a duration", 0.0, LONGEST, exclusive=True)
SECONDS = Quantity("s", "a duration or an offset", 0.0, LONGEST)
BYTES = Quantity("bytes", "a size", 1.0, 1e18, whole=True)
RUN = Quantity("", "number of a run", 1, 1e9, whole=True)

_PROCESSES = Quantity("", "processes", 1, 1024, whole=True)

_Options = TypeVar("_Options")


class Parser(argparse.ArgumentParser):
    """Parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Exit with 2."""
        self.exit(2, f"{self.prog}: {printable(message)}; see {self.prog} --help\n")


class Number(argparse.Action):
    """Argument that is a number in a range; outside, a ParameterError names the option."""

    def __init__(self, *arguments: Any, quantity: Quantity, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._quantity = quantity

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        name = self.option_strings[-1]
        setattr(namespace, self.dest, self._quantity.check(name, _parse_number(values)))


def _parse_number(text: Any) -> Any:
    """Return the number that a text says; the text itself where it says none."""
    for kind in (int, float):  # integers first: a float would round a long seed
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def pattern(text: str) -> re.Pattern[str]:
    """Return a regular expression; a type for argparse."""
    try:
        return re.compile(text)
    except (re.error, RecursionError, OverflowError) as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no regular expression: {error}") from error


def options_from(arguments: argparse.Namespace, kind: type[_Options]) -> _Options:
    fields = dataclasses.fields(kind)  # type: ignore[arg-type]
    return kind(**{field.name: getattr(arguments, field.name) for field in fields})


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


def add_bag_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("bag", metavar="BAG", help="a bag's folder or one MCAP file")


def add_json_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def add_run_argument(parser: argparse.ArgumentParser, condition: str = "") -> None:
    """Declare --run, ``number`` of the arguments; the condition begins its help."""
    parser.add_argument(
        "--run",
        action=Number,
        quantity=RUN,
        default=1,
        metavar="N",
        dest="number",
        help=f"{condition}number of the simulation, if resets or restored checkpoints began "
        "several (default: the first)",
    )


def add_with_parent(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--with-parent",
        action="store_true",
        help="stop also when the process that started it has ended, as under ros2 launch",
    )


def add_workers_argument(parser: argparse._ActionsContainer) -> None:
    """Declare --workers of a study; ``worker_count`` reads it."""
    parser.add_argument(
        "--workers",
        action=Number,
        quantity=_PROCESSES,
        metavar="N",
        help="processes on this machine (default: one for each of its cores)",
    )


def add_scheduler_argument(parser: argparse._ActionsContainer) -> None:
    parser.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="run on the Dask cluster of this scheduler",
    )


def worker_count(arguments: argparse.Namespace) -> int:
    """Return the number of --workers; by default one for each core that this process may use."""
    return arguments.workers or len(os.sched_getaffinity(0))


def add_range_arguments(parser: argparse.ArgumentParser, verb: str, longest: float) -> None:
    """Declare --start and --duration of a part of a bag, both of at most ``longest`` seconds."""
    parser.add_argument(
        "--start",
        action=Number,
        quantity=dataclasses.replace(SECONDS, maximum=longest),
        default=0.0,
        metavar="S",
        help="skip that many seconds of the bag (default: 0)",
    )
    parser.add_argument(
        "--duration",
        action=Number,
        quantity=dataclasses.replace(POSITIVE_SECONDS, maximum=longest),
        metavar="S",
        help=f"{verb} at most that many seconds (default: to the end)",
    )


def add_parameter_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare --regime, --config and --set."""
    parser.add_argument(
        "--regime",
        choices=("free", "drilling"),
        help="free is before drilling, drilling is in the rock (default: drilling)",
    )
    parser.add_argument(
        "--config", metavar="FILE", help="a ROS parameter file, such as config/drilling.yaml"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="assignments",
        help="set one parameter, in SI units; can be repeated",
    )


def chosen_parameters(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the given parameters by name: the file's, then --regime, then each --set."""
    from rpud_sim.simulation.parameter_files import parse_assignment, read_parameter_file

    values = read_parameter_file(arguments.config) if arguments.config else {}
    if arguments.regime:
        values["regime"] = arguments.regime
    values.update(parse_assignment(text) for text in arguments.assignments)
    return values
