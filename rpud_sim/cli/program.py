"""Start and end of a program: exit codes, errors in one line, signals and standard streams."""

from __future__ import annotations

import enum
import gc
import io
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, NoReturn

from rpud_sim.cli import ENDING
from rpud_sim.foundation.json_text import check_finite, json_text
from rpud_sim.foundation.quantities import ExpectedError, ExpectedWarning
from rpud_sim.foundation.terminal import print_error
from rpud_sim.foundation.user_files import named_errors

# Environment variable: where it is set, an unexpected error shows its traceback.
TRACEBACK = "RPUD_TRACEBACK"

_SIGNAL = 128  # exit code of a signal, without its number
_RETRY_DELAY = 0.01  # s
# What only some commands need comes with an extra: these have one each, the others share one.
_EXTRA_MODULES = ("matplotlib", "pandas", "pyarrow", "pytest", "scipy", "tornado")
_EXTRAS = {
    "rpud export": "export",
    "rpud report": "report",
    "rpud test": "test",
    "rpud compare": "web",
    "rpud watch": "web",
}
_STUDIES = "studies"
# Of pip alone, so that a ROS package cannot depend on them. Any other missing module is of ROS.
_BAG_MODULES = ("lz4", "mcap", "rosbags", "zstandard")

# What a signal ends as it should, whenever it comes.
_UNTIL_A_SIGNAL = (
    *("rpud run", "rpud record", "rpud replay", "rpud echo", "rpud watch"),
    *("drill_node", "recorder", "replayer"),
)


class ExitCode(enum.IntEnum):
    """Exit codes of all programs."""

    DONE = 0
    FAILED = 1
    USAGE = 2  # usage error: an argument, a parameter or a file of parameters cannot be used
    INCOMPLETE = 3  # done, but a part is damaged, lost, different or not met
    INTERRUPTED = 130  # ended by Ctrl-C, as shells count it


@contextmanager
def failing(kind: type[Exception]) -> Iterator[None]:
    """Let errors of a type that are not expected by themselves end a command in one line, too."""
    try:
        yield
    except ExpectedError:
        raise
    except kind as error:
        raise ExpectedError(error) from error


def report_errors(program: str, run: Callable[[], int]) -> int:
    """Run a command and return its exit code; print an expected error as one line."""
    with _expected_warnings(program):
        try:
            return run()
        except ExpectedError as error:
            print_error(program, error)
            return error.code


@contextmanager
def _expected_warnings(program: str) -> Iterator[None]:
    """Print each expected warning as one line, once."""
    said: set[str] = set()

    def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if not issubclass(category, ExpectedWarning):
            usual(message, category, *where, **more)
        elif (text := str(message)) not in said:
            said.add(text)
            print_error(program, text)

    with warnings.catch_warnings():
        usual, warnings.showwarning = warnings.showwarning, show
        warnings.simplefilter("always", ExpectedWarning)
        yield


def run_program(program: str, run: Callable[[], Any]) -> NoReturn:
    """Run a program and exit with its code; an unexpected error becomes one line as well."""
    # NumPy's linear algebra else starts threads for each core, which takes a third of a start.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _open_streams()
    interrupt = _Interrupt()
    try:
        try:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
            code = run()
        finally:
            interrupt.end()
    except SystemExit as end:
        code = end.code
    except BrokenPipeError:  # the reader of our output has gone, as `head` does
        code = ExitCode.DONE
    except KeyboardInterrupt:
        interrupt.end()  # which may have been interrupted itself
        code = _interrupted(program, interrupt.code)
    except Exception as error:
        # An import that is interrupted may end in any error.
        if interrupt.seen:
            code = _interrupted(program, interrupt.code)
        else:
            code = _report_unexpected(program, error)
    gc.freeze()  # Python else searches all that is left for cycles, which takes 0.1 s
    sys.exit(_flush(program, code))


def _interrupted(program: str, code: int) -> int:
    """Return the exit code after a signal that came while the program did not wait for one."""
    number = signal.Signals(code - _SIGNAL)
    of_terminal = program == "rpud watch" and number == signal.SIGHUP
    if program not in _UNTIL_A_SIGNAL or of_terminal:
        return code
    print_error(program, f"ended by {number.name}")
    return ExitCode.DONE


def _report_unexpected(program: str, error: Exception) -> ExitCode:
    if os.environ.get(TRACEBACK):
        import traceback  # only when it is needed, for it slows every start

        traceback.print_exception(error)
    missing = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    if missing in _EXTRA_MODULES:
        extra = _EXTRAS.get(program, _STUDIES)
        reason = f"needs {missing}: pip install 'rpud_sim[{extra}]', or in a clone make setup"
    elif missing in _BAG_MODULES:
        reason = f"needs {missing}: pip install {' '.join(_BAG_MODULES)}"
    elif missing and not missing.startswith("rpud_sim"):
        reason = (
            f"needs {missing}: pip install 'rpud_sim[ros]', or source ROS 2 Jazzy or env.bash first"
        )
    elif isinstance(error, OSError):
        reason = ": ".join(filter(None, (_place(error), error.strerror or str(error))))
    else:
        text = f"{type(error).__name__}: {error}"
        reason = f"unexpected {text:.500} ({TRACEBACK}=1 shows where)"
    print_error(program, reason)
    return ExitCode.FAILED


def _place(error: OSError) -> str:
    """Return where an error was; empty where that is unknown."""
    if not error.filename:
        try:
            os.getcwd()
        except OSError:
            return "the working folder"
    return str(error.filename or "")


def _flush(program: str, code: Any) -> Any:
    try:
        sys.stdout.flush()
    except OSError as error:
        # Python flushes once more when it ends; what is left must go somewhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if code or isinstance(error, BrokenPipeError):
            return code
        print_error(program, f"{error.filename}: {error.strerror}")
        return ExitCode.FAILED
    return code


def _open_streams() -> None:
    """Open the standard streams that are closed, and let all of them accept every text.

    Otherwise the next file that is opened would get the number of a closed stream.
    """
    for number, mode in ((0, os.O_RDONLY), (1, os.O_RDONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)  # standard output is not writable, and fails when used
    if sys.stdout is sys.__stdout__:  # tests replace it
        like = sys.stdout or open(1, "w", closefd=False)  # noqa: SIM115 - until the process ends
        raw, through = _Output(like.fileno(), "w", closefd=False), like.write_through
        sys.stdout = io.TextIOWrapper(
            raw if through else io.BufferedWriter(raw),
            encoding=like.encoding,
            line_buffering=like.line_buffering,
            write_through=through,
        )
    if sys.stderr is None:
        sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


class _Output(io.FileIO):
    """Standard output whose errors have a name, as errors of files have."""

    def write(self, data: Any) -> int:
        with named_errors("standard output"):
            return super().write(data)


class _Interrupt:
    """SIGINT, SIGTERM and SIGHUP as a KeyboardInterrupt, raised until something handles it.

    So each ends a command as an error does: a result is whole, or there is none.
    Destructors and the imports of compiled modules drop exceptions.
    """

    def __init__(self) -> None:
        self.seen = False  # whether there was one of them
        self.code = _SIGNAL + signal.SIGINT  # exit code of the program after it
        for number in ENDING:
            if signal.getsignal(number) is not signal.SIG_IGN:  # nohup and a shell's & set SIG_IGN
                signal.signal(number, self._handle)
        signal.signal(signal.SIGALRM, self._handle)
        sys.unraisablehook = self._report

    def end(self) -> None:
        """Raise no exception again: Python is about to end."""
        signal.signal(signal.SIGALRM, signal.SIG_IGN)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.seen = True
        if number != signal.SIGALRM:
            self.code = _SIGNAL + number
        signal.setitimer(signal.ITIMER_REAL, _RETRY_DELAY)
        error = sys.exc_info()[1]
        while error is not None:
            if isinstance(error, KeyboardInterrupt):  # what it interrupted is being cleaned up
                return
            error = error.__context__
        raise KeyboardInterrupt

    def _report(self, unraisable: Any) -> None:
        if not isinstance(unraisable.exc_value, KeyboardInterrupt):
            sys.__unraisablehook__(unraisable)


_DELAY = 2.0  # s, until a terminal shows a bar
_LINE_PERIOD = 10.0  # s between two lines where there is no terminal


def print_result(options: Any, content: Any, lines: Callable[[], Iterable[str]]) -> None:
    """Print the result of a command: with --json its content, otherwise some lines.

    A number in the content that is not finite is an error in both cases, and nothing is printed.
    """
    check_finite(content)
    print(json_text(content, indent=2) if options.json else "\n".join(lines()))


class _Lines:
    def write(self, text: str) -> None:
        line = text.strip("\r\n ")
        if line:
            with suppress(BrokenPipeError):  # the work continues even if nobody reads its output
                print(line, file=sys.stderr, flush=True)

    def flush(self) -> None:
        """Do nothing: each line is flushed."""


def progress_bar(
    unit: str,
    total: float | None = None,
    *,
    scaled: bool = False,
    title: str = "",
    delay: float = _DELAY,
    layout: str | None = None,
) -> Any:
    """Return a ``tqdm`` bar, to be entered and updated.

    ``scaled`` writes large counts with k, M and so on. A terminal shows it after ``delay`` [s].
    ``layout`` is ``bar_format`` of tqdm.
    """
    from tqdm import tqdm  # only when it is needed, for it slows every start

    terminal = sys.stderr.isatty()
    return tqdm(
        desc=title or None,
        unit=unit,
        total=total,
        unit_scale=scaled,
        delay=delay if terminal else _LINE_PERIOD,
        mininterval=0.1 if terminal else _LINE_PERIOD,
        miniters=0,  # time alone decides: a bar at the same place may have a new text
        leave=False,
        file=sys.stderr if terminal else _Lines(),
        ncols=None if terminal else 0,
        bar_format=layout,
    )


@contextmanager
def status_line(title: str) -> Iterator[Callable[[str], None]]:
    """Show the latest text of a task without an end, after its title.

    The function that it yields takes the next text; how often it is shown is decided here.
    """
    with progress_bar("", delay=0.0, layout="{desc}") as bar:

        def show(text: str) -> None:
            bar.set_description_str(f"{title}: {text}", refresh=False)
            bar.update(0)

        yield show
