"""Way of received messages into the bag: a filter, a queue in bounded memory, a writing thread."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

from rpud_sim.bag import BagError, BagWriter, Message, Topic
from rpud_sim.bag.messages import LatchedMessages
from rpud_sim.ros.record.record_options import RecordOptions

_RESERVE = 32 * 2**20  # bytes to leave free: also for data in memory at the time of a check
_CHECK_PERIOD = 0.1  # of the free space [s]

Item = Message | Callable[[BagWriter], object]


class Intake:
    """Messages on their way from the one thread that receives them to the one that writes.

    At most ``capacity`` bytes of messages wait; a message that does not fit is dropped. Each
    counter belongs to one of the two threads, so that neither waits for the other. A pause discards
    messages; at its end the last ones of latched topics are written, as received then.
    """

    def __init__(
        self, capacity: int = RecordOptions.max_cache_size, *, paused: bool = False
    ) -> None:
        self.refused: Counter[str] = Counter()  # messages of each topic that did not fit
        self.accepted = 0  # messages that the queue holds or held
        self.paused = paused
        self._capacity = capacity
        self._items: queue.SimpleQueue[Item | None] = queue.SimpleQueue()
        self._put_bytes = 0
        self._got_bytes = 0
        self._discarded = LatchedMessages()

    def declare(self, topic: Topic, definition: str | None) -> None:
        """Declare a topic before its first message; the definition of its type may be unknown."""
        self._discarded.declare(topic)
        self.do(lambda bag: bag.add_topic(topic, definition))

    def put(self, message: Message) -> None:
        """Queue or discard a message."""
        if self.paused:
            self._discarded.note(message)
            return
        size = len(message.data)
        if self._put_bytes - self._got_bytes + size > self._capacity:
            self.refused[message.topic] += 1
            return
        self._put_bytes += size
        self.accepted += 1
        self._items.put(message)

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        """Queue a metadata record of the bag."""
        self.do(lambda bag: bag.add_record(name, content))

    def do(self, action: Callable[[BagWriter], object]) -> None:
        """Queue what else to do with the bag; there is always room for it."""
        self._items.put(action)

    def pause(self) -> None:
        self.paused = True

    def resume(self) -> None:
        """Write messages again, first the last ones of latched topics."""
        if not self.paused:
            return
        self.paused = False
        for message in self._discarded.at(time.time_ns()):
            self.put(message)
        self._discarded.clear()

    def close(self) -> None:
        self._items.put(None)

    def get(self, timeout: float) -> Item | None:
        """Return the next item, None at the end; ``queue.Empty`` if none in the timeout [s]."""
        item = self._items.get(timeout=max(0.0, timeout))
        if isinstance(item, Message):
            self._got_bytes += len(item.data)
        return item


class DiskRoom:
    """Limit of a bag: by its size [bytes], None for none, and by the free space of its disk."""

    def __init__(self, path: Path, limit: int | None) -> None:
        self._path = path
        self._limit = limit
        self._checked = float("-inf")
        self._free = 0  # bytes, at the last check
        self._size = 0  # the bag's at that time

    def refusal(self, closed_size: int, size: int) -> str:
        """Return why there is no room for a message in a bag of this closed size [bytes], or ""."""
        if self._limit is not None and closed_size + size > self._limit:
            return f"it has reached --max-disk {self._limit} bytes"
        now = time.monotonic()
        if now >= self._checked + _CHECK_PERIOD:
            self._checked = now
            try:
                disk = os.statvfs(self._path)
            except OSError as error:
                raise BagError(f"cannot look at {self._path}: {error.strerror}") from error
            self._free = disk.f_bavail * disk.f_frsize
            self._size = closed_size
        if closed_size - self._size + size + _RESERVE > self._free:
            return f"the disk of {self._path} has {self._free} bytes left"
        return ""


class WritingThread(threading.Thread):
    """Writes what the intake has until its end, and flushes it to the disk in time.

    A message waits for others in its chunk for half of ``max_loss``; the rest is left for the disk.
    The bag itself is for others to close when the thread has ended. ``on_end`` is called once when
    there is an error or a refusal.
    """

    def __init__(
        self,
        intake: Intake,
        bag: BagWriter,
        max_loss: float,
        on_end: Callable[[], None],
        max_disk: int | None = None,
    ) -> None:
        super().__init__(name="bag writer")
        # why writing failed, None unless it did; the rest of the queue is left then
        self.error: Exception | None = None
        # why there was no room for a message, empty unless that happened; neither that
        # message nor a later one is written then
        self.refusal = ""
        # for how long a message was in memory alone at most, by its log time [s]: more
        # than ``max_loss`` if the disk was too slow
        self.exposure = 0.0
        self._intake = intake
        self._bag = bag
        self._on_end = on_end
        self._room = DiskRoom(bag.path, max_disk)
        self._period = 0.5 * max_loss
        self._oldest: int | None = None  # log time of a message that may not be on the disk [ns]

    def run(self) -> None:
        """Write until the queue ends or an error occurs."""
        try:
            self._write()
        except Exception as error:  # or the recorder would go on without a bag
            self.error = error
            self._on_end()

    def _write(self) -> None:
        flush_at = time.monotonic() + self._period
        while True:
            try:
                item = self._intake.get(flush_at - time.monotonic())
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
        if not isinstance(item, Message):
            if not (self.refusal and item is BagWriter.split):  # a new file would need room, too
                item(self._bag)
        elif self._has_room(len(item.data)):
            if self._oldest is None:
                self._oldest = item.log_time
            self._bag.write(item.topic, item.data, item.log_time, item.publish_time)

    def _has_room(self, size: int) -> bool:
        if self.refusal:
            return False
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
