"""Thread that writes the recorder's queue into its bag."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable

from rpud_sim.bag import BagWriter, Message
from rpud_sim.ros.record.disk_room import DiskRoom
from rpud_sim.ros.record.message_queue import Declaration, Item, MessageQueue, NamedRecord


class WritingThread(threading.Thread):
    """Writes the queue until its end, and flushes it to the disk in time.

    A message waits for others in its chunk for half of ``max_loss``; the rest is left for the disk.
    The bag itself is for others to close when the thread has ended. ``on_end`` is called once when
    there is an error or a refusal. Without ``room`` the disk is not checked.
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
        # why writing failed, None unless it did; the rest of the queue is left then
        self.error: Exception | None = None
        # why there was no room for a message, empty unless that happened; neither that
        # message nor a later one is written then
        self.refusal = ""
        # for how long a message was in memory alone at most, by its log time [s]: more
        # than ``max_loss`` if the disk was too slow
        self.exposure = 0.0
        self._messages = messages
        self._bag = bag
        self._on_end = on_end
        self._room = room
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
