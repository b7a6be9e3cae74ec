"""Output of commands: their results on standard output, progress on standard error.

A terminal shows progress as one line that is rewritten. Where standard error is no terminal, such
as a log, one line is written every ten seconds.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

_DELAY = 2.0  # s, until a terminal shows a bar
_LINE_PERIOD = 10.0  # s between two lines where there is no terminal


def print_result(options: Any, content: Any, lines: Callable[[], Iterable[str]]) -> None:
    """Print the result of a command: with --json its content, otherwise some lines."""
    print(json.dumps(content, indent=2) if options.json else "\n".join(lines()))


class _Lines:
    def write(self, text: str) -> None:
        line = text.strip("\r\n ")
        if line:
            with suppress(BrokenPipeError):  # the work goes on, whoever has stopped reading
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
        miniters=0,  # time alone decides: a bar that stands still may have a new text
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
