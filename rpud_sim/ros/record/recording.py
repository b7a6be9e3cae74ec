"""The recorder's parts that need no ROS: its queue and its writing thread."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rpud_sim.bag import BagWriter, Message, Topic
from rpud_sim.ros.record.disk_room import DiskRoom
from rpud_sim.ros.record.record_options import RecordOptions


@dataclass(frozen=True)
class Declaration:
    """A topic, ahead of its first message, and the definition of its type, None if unknown."""

    topic: Topic
    definition: str | None


@dataclass(frozen=True)
class NamedRecord:
    """Named text to keep in the bag."""

    name: str
    content: Mapping[str, str]


@dataclass(frozen=True)
class Split:
    """The end of a file of the bag."""


Item = Message | Declaration | NamedRecord | Split


class MessageQueue:
    """Carries messages from the one thread that takes them to the one that writes them.

    It holds at most `capacity` bytes; a message that does not fit is refused. Each counter belongs
    to one of the two threads, so that neither waits for the other.
    """

    def __init__(self, capacity: int = RecordOptions.max_cache_size) -> None:
        self._capacity = capacity
        self._items: queue.SimpleQueue[Item | None] = queue.SimpleQueue()
        self._put_bytes = 0
        self._got_bytes = 0

    def put(self, message: Message) -> bool:
        """Append a message; tell whether there was room for it."""
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
        """Append the end of a file."""
        self._items.put(Split())

    def close(self) -> None:
        """Append the end."""
        self._items.put(None)

    def get(self, timeout: float) -> Item | None:
        """Give the next item, or None at the end. Raises queue.Empty after `timeout` seconds."""
        item = self._items.get(timeout=max(0.0, timeout))
        if isinstance(item, Message):
            self._got_bytes += len(item.data)
        return item


class WritingThread(threading.Thread):
    """Writes what is in the queue until its end, and has it on the disk within `max_loss` seconds.

    Half of that time a message waits for others in its chunk; the rest is left for the disk.
    `exposure` is how long a message was in memory alone at most [s], by its log time: more than
    `max_loss` where that is not held. Where writing fails, `error` holds why, `on_end` is
    called once, and the rest of the queue is left. Where `room` has none for a message, `refusal`
    holds why, `on_end` is called once, and neither that message nor any later one is written. The
    bag itself is for others to close when the thread has ended.
    """

    def __init__(
        self,
        messages: MessageQueue,
        bag: BagWriter,
        max_loss: float,
        on_end: Callable[[], None],
        room: DiskRoom | None = None,
    ) -> None:
        super().__init__(name="bag writer")
        self.error: Exception | None = None
        self.refusal = ""
        self.exposure = 0.0
        self._messages = messages
        self._bag = bag
        self._on_end = on_end
        self._room = room
        self._period = 0.5 * max_loss
        self._oldest: int | None = None  # log time of a message that may not be on the disk [ns]

    def run(self) -> None:
        """Write until the queue ends or something fails."""
        try:
            self._write()
        except Exception as error:  # nobody else would hear of it, and the bag would go on empty
            self.error = error
            self._on_end()

    def _write(self) -> None:
        flush_at = time.monotonic() + self._period
        while True:
            try:
                item = self._messages.get(flush_at - time.monotonic())
            except queue.Empty:
                pass
            else:
                if item is None:
                    return
                self._add(item)
            now = time.monotonic()
            if now >= flush_at:
                self._flush()
                flush_at = now + self._period

    def _add(self, item: Item) -> None:
        if isinstance(item, Message):
            if not self._has_room(item):
                return
            if self._oldest is None:
                self._oldest = item.log_time
            self._bag.write(item.topic, item.data, item.log_time, item.publish_time)
        elif isinstance(item, Declaration):
            self._bag.add_topic(item.topic, item.definition)
        elif isinstance(item, NamedRecord):
            self._bag.add_record(item.name, item.content)
        elif not self.refusal:
            self._bag.split()

    def _has_room(self, message: Message) -> bool:
        if self._room is not None and not self.refusal:
            size = len(message.data)
            self.refusal = self._room.refusal(self._bag.closed_size, size)
            if not self.refusal and not self._bag.reserve(size):
                self.refusal = f"the disk of {self._bag.path} is full"
            if self.refusal:
                self._on_end()
        return not self.refusal

    def _flush(self) -> None:
        self._bag.flush()
        if self._oldest is not None:
            self.exposure = max(self.exposure, 1e-9 * (time.time_ns() - self._oldest))
            self._oldest = None
