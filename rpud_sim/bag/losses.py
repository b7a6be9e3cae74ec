"""Messages that never arrived: a recorder's account, and gaps in numbered messages."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass

from rpud_sim.bag.errors import parsing

LOSSES_RECORD = "rpud_losses"  # metadata record with the ``Losses`` of each topic

# Metadata record with the duration that a recorder loses at most if it is killed: ``max_loss`` [s].
RECORDING_RECORD = "rpud_recording"

_SEQUENCES = 64  # of one topic at most; the oldest, of publishers that left, are discarded


@dataclass(frozen=True)
class Losses:
    """Numbers of lost messages of one topic."""

    # lost on the way to the recorder; None if the middleware does not number messages
    transport: int | None = 0
    queue: int = 0  # dropped because the recorder's queue was full
    damaged: int = 0  # arrived with unreadable data or an impossible time

    @property
    def total(self) -> int | None:
        """All lost messages; None if that is unknown."""
        return None if self.transport is None else self.transport + self.queue + self.damaged


def losses_to_record(losses: Mapping[str, Losses]) -> dict[str, str]:
    """Return the content of the metadata record, with one key for each topic."""
    return {topic: json.dumps(asdict(item)) for topic, item in losses.items()}


def losses_from_record(record: Mapping[str, str]) -> dict[str, Losses]:
    with parsing(f"the record {LOSSES_RECORD}"):
        return {topic: _losses(json.loads(text)) for topic, text in record.items()}


def _losses(value: Mapping[str, int | None]) -> Losses:
    transport = value["transport"]
    losses = Losses(
        None if transport is None else int(transport),
        int(value["queue"] or 0),
        int(value.get("damaged") or 0),
    )
    for count in (losses.transport or 0, losses.queue, losses.damaged):
        if not 0 <= count < 2**63:
            raise ValueError(f"{count:g} is no number of messages")
    return losses


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
