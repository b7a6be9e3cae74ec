"""Queue of the recorder: messages and what else goes into the bag, in bounded memory."""

from __future__ import annotations

import queue
from collections.abc import Mapping
from dataclasses import dataclass

from rpud_sim.bag import Message, Topic
from rpud_sim.ros.record.record_options import RecordOptions


@dataclass(frozen=True)
class Declaration:
    """Topic, ahead of its first message, and the definition of its type, None if unknown."""

    topic: Topic
    definition: str | None


@dataclass(frozen=True)
class NamedRecord:
    """Metadata record of the bag."""

    name: str
    content: Mapping[str, str]


@dataclass(frozen=True)
class Split:
    """End of a file of the bag."""


Item = Message | Declaration | NamedRecord | Split


class MessageQueue:
    """Queue from the one thread that receives messages to the one that writes them.

    Each counter belongs to one of the two threads, so that neither waits for the other. At most
    ``capacity`` bytes of messages wait; a message that does not fit is dropped.
    """

    def __init__(self, capacity: int = RecordOptions.max_cache_size) -> None:
        self._capacity = capacity
        self._items: queue.SimpleQueue[Item | None] = queue.SimpleQueue()
        self._put_bytes = 0
        self._got_bytes = 0

    def put(self, message: Message) -> bool:
        """Append a message; return whether there was room for it."""
        size = len(message.data)
        if self._put_bytes - self._got_bytes + size > self._capacity:
            return False
        self._put_bytes += size
        self._items.put(message)
        return True

    def declare(self, declaration: Declaration) -> None:
        """Append a topic's declaration; there is always room for it."""
        self._items.put(declaration)

    def keep(self, record: NamedRecord) -> None:
        """Append a record; there is always room for it."""
        self._items.put(record)

    def split(self) -> None:
        self._items.put(Split())

    def close(self) -> None:
        self._items.put(None)

    def get(self, timeout: float) -> Item | None:
        """Return the next item, None at the end; ``queue.Empty`` if none in the timeout [s]."""
        item = self._items.get(timeout=max(0.0, timeout))
        if isinstance(item, Message):
            self._got_bytes += len(item.data)
        return item
