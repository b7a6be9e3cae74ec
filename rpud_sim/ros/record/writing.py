"""Way of received messages into the bag: a filter, a queue in bounded memory, a writing thread."""

from __future__ import annotations

import queue
import shutil
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import suppress

from rpud_sim.bag import BagWriter, Message, Topic
from rpud_sim.ros.options import RecordOptions
from rpud_sim.ros.record.log_clock import LogClock

Item = Message | Callable[[BagWriter], object]

_CHECKED_SIZE = 1 << 20  # messages between two looks at the free space [bytes]


class WriteQueue:
    """Messages on their way from the thread that receives them to the one that writes.

    At most ``capacity`` bytes wait; what does not fit is dropped. A pause discards messages; at
    its end the last ones of latched topics are written, as received then.
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
        # last messages of latched topics in a pause, one for each publisher
        self._discarded: dict[str, deque[Message]] = {}
        self._observer: Callable[[Message], object] = lambda message: None

    def observe(self, observer: Callable[[Message], object]) -> None:
        """Call a function with each message that is queued from now on."""
        self._observer = observer

    def declare(self, topic: Topic, definition: str | None) -> None:
        """Declare a topic before its first message; the definition of its type may be unknown."""
        if any(offer.durability == "transient_local" for offer in topic.offered_qos):
            self._discarded[topic.name] = deque(maxlen=len(topic.offered_qos))
        self.do(lambda bag: bag.add_topic(topic, definition))

    def put(self, message: Message, *, observed: bool = True) -> None:
        """Queue or discard a message."""
        if self.paused:
            if message.topic in self._discarded:
                self._discarded[message.topic].append(message)
            return
        size = len(message.data)
        if self._put_bytes - self._got_bytes + size > self._capacity:
            self.refused[message.topic] += 1
            return
        self._put_bytes += size
        self.accepted += 1
        self._items.put(message)
        if observed:
            self._observer(message)

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        """Queue a metadata record of the bag."""
        self.do(lambda bag: bag.add_record(name, content))

    def do(self, action: Callable[[BagWriter], object]) -> None:
        """Queue what else to do with the bag; there is always space for it."""
        self._items.put(action)

    def pause(self, paused: bool = True) -> None:
        """Discard messages from now on, or write them again, first the last latched ones."""
        if self.paused and not paused:
            self.paused = False
            now = time.time_ns()
            latest = [each for messages in self._discarded.values() for each in messages]
            for message in sorted(latest, key=lambda each: each.log_time):
                self.put(message._replace(log_time=now))
            for messages in self._discarded.values():
                messages.clear()
        self.paused = paused

    def close(self) -> None:
        self._items.put(None)

    def get(self, timeout: float) -> Item | None:
        """Return the next item, None at the end; ``queue.Empty`` if none in the timeout [s]."""
        item = self._items.get(timeout=max(0.0, timeout))
        if isinstance(item, Message):
            self._got_bytes += len(item.data)
        return item


class WritingThread(threading.Thread):
    """Writes what the intake has until its end, and flushes it to the disk in time.

    ``on_end`` is called once at an error or a rejection.
    """

    def __init__(
        self,
        intake: WriteQueue,
        bag: BagWriter,
        max_loss: float,
        on_end: Callable[[], None],
        max_disk: int | None = None,
        min_free: int = RecordOptions.min_free,
        clock: LogClock | None = None,
    ) -> None:
        super().__init__(name="bag writer")
        self._clock = clock  # of the log times; None for the machine's
        # why writing failed, None unless it did; the rest of the queue is left then
        self.error: Exception | None = None
        # why there was no space for a message, empty unless that happened; neither that
        # message nor a later one is written then
        self.refusal = ""
        # for how long a message was in memory alone at most, by its log time [s]: more
        # than ``max_loss`` if the disk was too slow
        self.exposure = 0.0
        self._intake = intake
        self._bag = bag
        self._on_end = on_end
        self._max_disk, self._min_free = max_disk, min_free
        self._until_check = 0  # bytes of messages until the next look at the free space
        self._period = 0.5 * max_loss
        self._oldest: int | None = None  # log time of a message that may not be on the disk [ns]

    def run(self) -> None:
        """Write until the queue ends or an error occurs."""
        try:
            self._write()
        except Exception as error:  # or the recorder would continue without a bag
            self.error = error
            self._on_end()

    def _write(self) -> None:
        if self._clock is not None:
            self._clock.wait()
        flush_at = time.monotonic() + self._period
        while True:
            with suppress(queue.Empty):
                item = self._intake.get(flush_at - time.monotonic())
                if item is None:
                    return
                self._add(item)
            if time.monotonic() >= flush_at:
                self._flush()
                flush_at = time.monotonic() + self._period

    def _add(self, item: Item) -> None:
        if not isinstance(item, Message):
            if not (self.refusal and item is BagWriter.split):  # a new file would need space, too
                item(self._bag)
            return
        if not self.refusal:
            self.refusal = self._refuse(len(item.data))
            if self.refusal:
                self._on_end()
                return
            if self._oldest is None:
                self._oldest = item.log_time
            logged = item.log_time if self._clock is None else self._clock.at(item.log_time)
            self._bag.write(item.topic, item.data, logged, item.publish_time)

    def _refuse(self, size: int) -> str:
        """Return why a message of this size [bytes] has no space, or ""."""
        if self._max_disk is not None and self._bag.closed_size + size > self._max_disk:
            return f"it has reached --max-disk {self._max_disk} bytes"
        self._until_check -= size
        if self._until_check <= 0:
            self._until_check = _CHECKED_SIZE
            # What waits in memory, and all until the next look, will take space, too.
            ahead = self._bag.closed_size - self._bag.size + _CHECKED_SIZE
            if shutil.disk_usage(self._bag.path).free - ahead < self._min_free:
                return (
                    f"the disk of {self._bag.path} has less than --min-free {self._min_free} bytes"
                )
        return ""

    def _flush(self) -> None:
        self._until_check = 0
        self._bag.flush()
        if self._oldest is not None:
            self.exposure = max(self.exposure, 1e-9 * (time.time_ns() - self._oldest))
            self._oldest = None
