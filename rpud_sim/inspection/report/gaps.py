"""Gaps of a topic: times in which messages are missing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

MOST_GAPS = 300  # number of gaps of a topic that are kept; further ones are counted


@dataclass(frozen=True)
class Gap:
    """Time in which messages are missing."""

    begin: float  # time of the last message before it [s]
    end: float  # time of the first message after it [s]
    missing: int | None = None  # number of messages by their sequence; None if the topic has none


class Gaps:
    """Gaps that a sequence shows, while messages are read."""

    def __init__(self) -> None:
        self.found: list[Gap] = []  # at most ``MOST_GAPS``
        self.unlisted = 0  # number of further ones
        self.missing = 0  # number of messages
        self._last: tuple[int, float] | None = None

    def add(self, numbers: np.ndarray, times: np.ndarray) -> None:
        """Add the sequence and the times of messages, in order [s]."""
        if not len(numbers):
            return
        number, time = self._last or (int(numbers[0]) - 1, float(times[0]))
        skipped = np.diff(numbers, prepend=number) - 1
        before = np.append(time, times[:-1])
        self._last = int(numbers[-1]), float(times[-1])
        for place in np.flatnonzero(skipped > 0):
            count = int(skipped[place])
            self.missing += count
            if len(self.found) < MOST_GAPS:
                self.found.append(Gap(float(before[place]), float(times[place]), count))
            else:
                self.unlisted += 1


def pauses(times: np.ndarray, values: np.ndarray) -> list[Gap]:
    """Return the gaps of a series whose value is NaN from a time [s] to the next; shapes (n,)."""
    starts = np.flatnonzero(np.isnan(values[:-1]))
    return [Gap(float(times[place]), float(times[place + 1])) for place in starts]


def merged(gaps: Iterable[tuple[str, Gap]]) -> Sequence[tuple[float, float, tuple[str, ...]]]:
    """Return gaps without overlap: begin, end [s], and the texts of what is missing meanwhile."""
    found: list[tuple[float, float, dict[str, None]]] = []
    for text, gap in sorted(gaps, key=lambda item: item[1].begin):
        if found and gap.begin <= found[-1][1]:
            begin, end, texts = found[-1]
            found[-1] = begin, max(end, gap.end), {**texts, text: None}
        else:
            found.append((gap.begin, gap.end, {text: None}))
    return [(begin, end, tuple(texts)) for begin, end, texts in found]
