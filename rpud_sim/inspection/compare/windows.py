"""Parts of the time that are compared: the common time, or the segments between common changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from rpud_sim.inspection.compare.changes import Event
from rpud_sim.inspection.compare.recorded_values import RecordedValues

_SHORTEST = 0.1  # s; shorter parts hold nothing to compare
_TOGETHER = 1e-3  # s; changes so close are one
MOST_WINDOWS = 20  # number of segments that are compared


@dataclass(frozen=True)
class Window:
    """Part of the time that is compared."""

    name: str
    begins: tuple[float, ...]  # begins, ends: in each run, simulation time [s]
    ends: tuple[float, ...]


@dataclass(frozen=True)
class Choice:
    """Choice of the part of the time that is compared."""

    begin: float = 0.0  # simulation time from which on it is compared [s]
    end: float | None = None  # up to which [s]; None for the end of the shortest run
    settle: float = 0.5  # time that is left out after the start and after each change [s]


def windows(
    runs: Sequence[RecordedValues],
    commands: Sequence[Event],
    faults: Sequence[Event],
    choice: Choice,
) -> tuple[tuple[Window, ...], list[str]]:
    """Return the windows, and warnings in one line each.

    Where all runs have the same commands, each part between them is compared for itself, and so
    with faults. Otherwise the common time is one window.
    """
    warnings = []
    changes: list[tuple[str, tuple[float, ...]]] = []
    if all(event.common for event in commands):
        changes += [(event.text, _times(event)) for event in commands]
    else:
        warnings.append(
            "the commands differ: a difference may come from them, so causes are mixed; "
            "--from and --to choose a time in which they agree"
        )
    if all(event.common for event in faults):
        changes += [(f"fault {event.text}", _times(event)) for event in faults]
        changes += [
            (f"end of fault {event.text}", tuple(end or 0.0 for end in event.ends))
            for event in faults
            if all(end is not None for end in event.ends)
        ]
    else:
        warnings.append("the faults differ: a difference may come from them, so causes are mixed")
    changes.sort(key=lambda change: change[1])
    if any(
        later < earlier
        for (_, before), (_, after) in pairwise(changes)
        for earlier, later in zip(before, after, strict=True)
    ):
        warnings.append("commands and faults come in another order in each run: causes are mixed")
        changes = []
    return _between(runs, changes, choice, warnings), warnings


def _times(event: Event) -> tuple[float, ...]:
    return tuple(time or 0.0 for time in event.times)


def _between(
    runs: Sequence[RecordedValues],
    changes: Sequence[tuple[str, tuple[float, ...]]],
    choice: Choice,
    warnings: list[str],
) -> tuple[Window, ...]:
    first = max([choice.begin, *(run.begin for run in runs)])
    last = min([math.inf if choice.end is None else choice.end, *(run.end for run in runs)])
    inside = [
        (text, tuple(min(max(time, first), last) for time in times))
        for text, times in changes
        if not _before(times, first + _TOGETHER) and min(times) < last
    ]
    # A change before the first moment, or at it, only has to settle.
    early = [times for _, times in changes if _before(times, first + _TOGETHER)]
    names = [""]
    places = [tuple(first for _ in runs)]
    settled = [
        tuple(
            max([first, choice.settle, *(times[run] + choice.settle for times in early)])
            for run in range(len(runs))
        )
    ]
    for text, times in inside:
        close = max(b - a for a, b in zip(places[-1], times, strict=True)) < _TOGETHER
        if close:
            names[-1] = f"{names[-1]}; {text}" if names[-1] else text
        else:
            names.append(text)
            places.append(times)
            settled.append(tuple(time + choice.settle for time in times))
    ends = [*places[1:], tuple(last for _ in runs)]
    found = []
    short = 0
    for name, begin, end in zip(names, settled, ends, strict=True):
        if min(b - a for a, b in zip(begin, end, strict=True)) < _SHORTEST:
            short += 1
            continue
        title = f"after {name}" if name else "from the start" if len(names) > 1 else "whole time"
        found.append(Window(title, begin, end))
    if short and found:
        warnings.append(f"{short} segments between changes are too short to compare")
    if len(found) > MOST_WINDOWS:
        warnings.append(f"only the first {MOST_WINDOWS} of {len(found)} segments are compared")
    return tuple(found[:MOST_WINDOWS])


def _before(times: Sequence[float], moment: float) -> bool:
    return all(time <= moment for time in times)
