"""Messages that never arrived, counted by the gaps in the numbers of those that did."""

from __future__ import annotations

from collections.abc import Callable

_SEQUENCES = 64  # of one topic at most; the oldest, of publishers that left, are discarded


class SequenceGaps:
    """Count of messages that never arrived, from the numbers that publishers give to messages.

    Messages do not name their publisher. With one publisher the count is exact. With several, a
    number that continues no known sequence is a gap in the sequence just below it. If there are
    more publishers than known sequences, it begins a new sequence instead. ``publisher_count`` is
    called at gaps only. What a sequence lacks before its first number counts where ``from_first``.
    """

    def __init__(self, publisher_count: Callable[[], int]) -> None:
        self.missing = 0  # messages that never arrived
        self.from_first = False  # whether all publishers of new sequences began with number 1
        self._publisher_count = publisher_count
        self._last: list[int] = []  # number of each sequence, the most recent at the end

    def note(self, number: int | None) -> None:
        """Note the number of a message that came; None where the middleware gives none."""
        if number is None:
            return
        last = self._last
        if number - 1 in last:
            last.remove(number - 1)
        else:
            below = max((before for before in last if before < number), default=None)
            if below is None:
                self.missing += self.from_first * (number - 1)
            elif len(last) >= self._publisher_count():
                self.missing += number - below - 1
                last.remove(below)
        last.append(number)
        if len(last) > _SEQUENCES:
            del last[0]
