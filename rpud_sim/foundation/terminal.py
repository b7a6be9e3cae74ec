"""Text on a terminal: tables, errors in one line, and no name from outside that steers it."""

from __future__ import annotations

import os
import re
import struct
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from json import JSONDecodeError
from typing import Any, TextIO

# What moves a cursor, changes the direction of writing, or has no encoding.
_STEERING = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")

_USUAL_WIDTH = 80

# Greatest lengths of what is printed: a file from outside may have names of any length.
LONGEST_NAME = 200
LONGEST_LINE = 1000

# What errors of Python mean where a file from outside raises them.
_MEANINGS: tuple[tuple[type[Exception] | tuple[type[Exception], ...], str], ...] = (
    (UnicodeDecodeError, "a text is not UTF-8"),
    (JSONDecodeError, "it is not JSON"),
    ((struct.error, EOFError, IndexError), "it ends too early"),
    (RecursionError, "it is nested too deep, or contains itself"),
    (OverflowError, "a number is too large"),
    (MemoryError, "it needs more memory than there is"),
    ((AttributeError, TypeError), "a value is of another kind than it must be"),
)

# Of int and float.
_NO_NUMBER = re.compile(r"(?:invalid literal|could not convert) .*?: (.*)|Exceeds the limit")


def printable(text: object, longest: int | None = None) -> str:
    r"""Return a text with escapes such as ``\x1b`` for what a terminal would obey.

    A text of more than ``longest`` characters has ``...`` instead of its middle.
    """
    shown = _STEERING.sub(lambda found: found[0].encode("unicode_escape").decode(), str(text))
    if longest is None or len(shown) <= longest:
        return shown
    kept = (longest - 3) // 2
    return f"{shown[:kept]}...{shown[-kept:]}"


def error_text(error: BaseException) -> str:
    """Return in words, on one line, what an error means that a file from outside has raised."""
    if isinstance(error, KeyError):
        return f"it has no {error.args[0]!r:.80}" if error.args else "it lacks a part"
    if (mark := getattr(error, "problem_mark", None)) is not None:  # an error of YAML
        said = (getattr(error, name, None) for name in ("context", "problem"))
        return f"line {mark.line + 1}: {', '.join(filter(None, said))}"
    for kinds, meaning in _MEANINGS:
        if isinstance(error, kinds):
            return meaning
    if number := _NO_NUMBER.match(str(error)):
        return f"{number[1]:.80} is not a number" if number[1] else "a number has too many digits"
    text = f"{error!s:.500}".partition('in "<unicode string>"')[0]  # an error of YAML
    return " ".join(text.split()) or "it is damaged"


def columns(stream: TextIO) -> int:
    """Return the width of the terminal of a stream in columns; 80 where it is unknown."""
    try:
        return os.get_terminal_size(stream.fileno()).columns or _USUAL_WIDTH
    except (OSError, ValueError):  # a serial console may know no size, a test may have no file
        return _USUAL_WIDTH


def print_error(program: str, reason: object) -> None:
    """Print an error on standard error, as one line; the exit code shows it where nobody reads."""
    with suppress(BrokenPipeError):
        print(f"{program}: {printable(reason, LONGEST_LINE)}", file=sys.stderr)


def cell(value: Any, form: str = "", none: str = "-") -> str:
    """Return a value of a table, in a format; a dash for None."""
    return none if value is None else f"{value:{form}}"


def table(head: Sequence[str], rows: Iterable[Sequence[Any]], left: int) -> list[str]:
    """Return the lines of a table, aligned and printable, ``left`` columns to the left."""
    cells = [[printable(cell(value), LONGEST_NAME) for value in row] for row in (head, *rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    forms = ["<" if number < left else ">" for number in range(len(widths))]
    return ["  ".join(map("{:{}{}}".format, row, forms, widths)).rstrip() for row in cells]
