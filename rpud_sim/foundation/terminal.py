"""How a program of ours prints and ends: errors in one line, and no name that steers a terminal."""

from __future__ import annotations

import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any, NoReturn

TRACEBACK = "RPUD_TRACEBACK"
"""Environment variable: where it is set, an unexpected error shows where it came from."""

INTERRUPTED = 130
"""Exit code after Ctrl-C."""

_AGAIN = 0.01  # s

# What moves a cursor, changes the direction of writing, or has no encoding.
_STEERING = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def printable(text: object) -> str:
    r"""Return a text with escapes such as ``\x1b`` for what a terminal would obey."""
    return _STEERING.sub(lambda found: found[0].encode("unicode_escape").decode(), str(text))


def complain(program: str, reason: object) -> None:
    """Print an error on standard error, as one line."""
    print(f"{program}: {printable(reason)}", file=sys.stderr)


def table(rows: Sequence[Sequence[str]], left: int) -> list[str]:
    """Return the lines of a table; the first ``left`` columns are aligned to the left."""
    rows = [[printable(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if number < left else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]


def end_with(program: str, run: Callable[[], Any]) -> NoReturn:
    """Run a program and exit with its code; whatever it raises becomes one line.

    Args:
        program: as its errors name it.
        run: returns the exit code, or raises SystemExit.
    """
    _open_streams()
    interrupt = _Interrupt()
    try:
        code = run()
    except SystemExit as end:
        code = end.code
    except BrokenPipeError:  # the reader of our output has gone, as `head` does
        code = 0
    except KeyboardInterrupt:
        code = INTERRUPTED
    except Exception as error:
        # An import that is interrupted may end in any error.
        code = INTERRUPTED if interrupt.seen else _fail(program, error)
    sys.exit(_flush(program, code))


def _fail(program: str, error: Exception) -> int:
    if os.environ.get(TRACEBACK):
        import traceback  # only when it is needed, for it slows every start

        traceback.print_exception(error)
    missing = (error.name or "") if isinstance(error, ModuleNotFoundError) else ""
    if missing and not missing.startswith("rpud_sim"):
        reason = f"needs the Python module {missing}; source ROS 2 Jazzy or env.bash first"
    elif isinstance(error, OSError) and error.strerror:
        reason = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    else:
        text = f"{type(error).__name__}: {error}"
        reason = f"unexpected {text:.500} ({TRACEBACK}=1 shows where)"
    complain(program, reason)
    return 1


def _flush(program: str, code: Any) -> Any:
    try:
        sys.stdout.flush()
    except OSError as error:
        # Python flushes once more when it ends; what is left must go somewhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if code or isinstance(error, BrokenPipeError):
            return code
        complain(program, error.strerror)
        return 1
    return code


def _open_streams() -> None:
    """See to it that there are standard streams, and that they take every text.

    Where one is closed, the next file that is opened would get its number.
    """
    for number, mode in ((0, os.O_RDONLY), (1, os.O_RDONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)  # standard output is not writable, and says so when used
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115 - until the process ends
    if sys.stderr is None:
        sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # tests replace them
            stream.reconfigure(errors="backslashreplace")


class _Interrupt:
    """Raises KeyboardInterrupt at SIGINT, and remembers that it did.

    Attributes:
        seen: whether there was a SIGINT.
    """

    def __init__(self) -> None:
        self.seen = False
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, self._handle)
            signal.signal(signal.SIGALRM, self._handle)
            sys.unraisablehook = self._again

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.seen = True
        raise KeyboardInterrupt

    def _again(self, unraisable: Any) -> None:
        """Raise it once more where it came in a place that nothing can be raised from."""
        if isinstance(unraisable.exc_value, KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN)  # not at once: it would come in here
        else:
            sys.__unraisablehook__(unraisable)
