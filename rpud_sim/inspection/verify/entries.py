"""The journal of a bag: its entries in order, none missing."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator

from rpud_sim.bag import BagFormatError, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.simulation.journal import JournalEntry


class UnverifiableError(Exception):
    """A bag can be neither proved nor disproved; the text says why, in one line."""


def entries(recorded: Iterable[Message], codec: Codec) -> Iterator[tuple[Message, JournalEntry]]:
    """Yield the journal's entries with their messages, in order.

    An entry that stands there again, as at the beginning of a bag's next file, is passed over.
    The number zero begins the journal of another start of the node. Both may say the same, where
    the node is its own clock; then they were published at different times.

    Raises:
        UnverifiableError: if entries are missing, or one cannot be understood.
    """
    expected = 0
    first = (0, b"")
    for message in recorded:
        entry = _entry(message, codec)
        published = (message.publish_time, message.data)
        if entry.sequence == 0 and published != first:
            first, expected = published, 0
        if entry.sequence < expected:
            continue
        if entry.sequence > expected:
            missing = f"entries {expected} to {entry.sequence - 1} of the journal are missing"
            late = "; its recorder came too late" if expected == 0 else ""
            raise UnverifiableError(f"{missing}{late}")
        expected += 1
        yield message, entry


def _entry(message: Message, codec: Codec) -> JournalEntry:
    try:
        fields = codec.decode(message.data)
        content = json.loads(fields.content)
        time = content.pop("time")
        if type(time) is not int or time < 0:
            raise ValueError(f"time = {time!r:.40}")
    except (BagFormatError, AttributeError, LookupError, RecursionError, ValueError) as error:
        reason = " ".join(f"{error!r:.120}".split())
        raise UnverifiableError(f"an entry of the journal cannot be understood: {reason}") from None
    return JournalEntry(int(fields.sequence), time, str(fields.kind), content)
