"""Options of commands: fields of frozen dataclasses, from which the command line is generated.

    max_loss: float = option(1.0, "seconds of messages that a crash may cost", POSITIVE_SECONDS)

A number has a ``Quantity``, whose unit is the default of its ``metavar``. Further keywords go to
``argparse``; ``flag`` is the name of an option that differs from its field.
"""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from rpud_sim.foundation.quantities import Quantity

NAMESPACE = "/rpud"  # namespace of a drill without another one
LONGEST = 1e9  # greatest number of seconds that an option accepts: thirty years

POSITIVE_SECONDS = Quantity("s", "a duration", 1e-9, LONGEST)  # times are whole nanoseconds
SECONDS = Quantity("s", "a duration or an offset", 0.0, LONGEST)
BYTES = Quantity("bytes", "a size", 1.0, 1e18, whole=True)
DOMAIN = Quantity("", "a ROS domain", 0, 232, whole=True)
SEED = Quantity("", "a seed", 0, 2**32 - 1, whole=True)
NO_SEED = -1  # instead of a seed: the initial phase is zero
SEED_OR_NONE = Quantity("", "a seed, or -1 for none", NO_SEED, SEED.maximum, whole=True)

Value = TypeVar("Value")


def option(default: Value, text: str, quantity: Quantity | None = None, **words: Any) -> Value:
    """Declare an option; one that is False by default is a flag."""
    if quantity is not None:
        words["quantity"] = quantity
    return dataclasses.field(default=default, metadata={"help": text, **words})


def required(text: str, **words: Any) -> Any:
    """Declare an option that must be given."""
    return dataclasses.field(metadata={"help": text, "required": True, **words})


def positional(metavar: str, text: str, **words: Any) -> Any:
    """Declare a positional argument; with ``nargs="?"`` it may be None."""
    words |= {"help": text, "metavar": metavar, "positional": True}
    if words.get("nargs") == "?":
        return dataclasses.field(default=None, metadata=words)
    return dataclasses.field(metadata=words)


# Options that several commands have.


def bag_argument() -> Any:
    return positional("BAG", "a bag's folder or one MCAP file")


def start_option() -> float:
    return option(0.0, "skip that many seconds of the bag", SECONDS)


def duration_option(verb: str) -> float | None:
    text = f"{verb} at most that many seconds (default: to the end)"
    return option(None, text, POSITIVE_SECONDS)


def run_time_option() -> float | None:
    text = "stop after that many seconds (default: at SIGINT or SIGTERM)"
    return option(None, text, POSITIVE_SECONDS)


def namespace_option(text: str) -> str:
    return option(NAMESPACE, text)


def parent_flag() -> bool:
    text = "stop also when the process that started it has ended, as under ros2 launch"
    return option(False, text)
