"""Errors of bags. Every message is one line that names the file or the value."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager

from rpud_sim.foundation.quantities import ExpectedError, ExpectedWarning
from rpud_sim.foundation.terminal import error_text

# Errors that Python raises where a value is not of the expected form.
MALFORMED = (AttributeError, LookupError, OverflowError, RecursionError, TypeError, ValueError)

# Errors that Python and ``rosbags`` raise when they read damaged bytes.
DAMAGED = (*MALFORMED, EOFError, MemoryError, RuntimeError, StopIteration, struct.error)


class BagError(ExpectedError):
    """Error of a bag that cannot be read or written.

    Characters of the text that cannot be printed, such as some in names of a bag, are escaped.
    """

    def __init__(self, text: str = "") -> None:
        super().__init__(_escaped(text))


def _escaped(text: str) -> str:
    return "".join(
        each if each.isprintable() else ascii(each)[1:-1]  # as in Python: \n, \x1b
        for each in text
    )


class BagWarning(ExpectedWarning):
    """Warning of a bag that is read as a whole, and is not as rosbag2 writes it."""

    def __init__(self, text: str = "") -> None:
        super().__init__(_escaped(text))


class BagExistsError(BagError):
    """Error of a new bag whose path exists already."""


class BagNotFoundError(BagError):
    """Error of a path without a bag."""


class BagFormatError(BagError):
    """Error of a file that is not a complete bag in a known format."""


class OtherStorageError(BagFormatError):
    """Error of a bag that rosbag2 can read, and that must be converted to be read here."""


@contextmanager
def parsing(what: str) -> Iterator[None]:
    """Replace the errors of a value of the wrong form by a BagFormatError that names the value."""
    try:
        yield
    except MALFORMED as error:
        raise BagFormatError(f"{what} is unreadable: {error_text(error)}") from error
