"""Intake of received messages: written, kept for a snapshot, or discarded in a pause."""

from __future__ import annotations

import time
from collections import Counter, deque

from rpud_sim.bag import Message
from rpud_sim.bag.latched import LatchedMessages
from rpud_sim.ros.record.message_queue import Declaration, MessageQueue


class Intake:
    """Filter before the queue of messages to write. For use by one thread.

    A pause discards messages. With ``snapshot_size`` the latest messages are kept until
    ``snapshot`` writes them. In both cases the last messages of latched topics are written too: as
    received at the end of the pause, or at the beginning of the snapshot. ``snapshot_size`` is in
    bytes; None to write everything.
    """

    def __init__(
        self, messages: MessageQueue, *, paused: bool = False, snapshot_size: int | None = None
    ) -> None:
        # messages of each topic that did not fit into the queue
        self.refused: Counter[str] = Counter()
        self.accepted = 0  # messages that the queue holds or held
        self._messages = messages
        self._paused = paused
        self._limit = snapshot_size
        self._kept: deque[Message] = deque()
        self._kept_size = 0
        self._discarded = LatchedMessages()

    @property
    def paused(self) -> bool:
        return self._paused

    @property
    def takes_snapshots(self) -> bool:
        return self._limit is not None

    def declare(self, declaration: Declaration) -> None:
        """Declare a topic, before its first message."""
        self._discarded.declare(declaration.topic)
        self._messages.declare(declaration)

    def put(self, message: Message) -> None:
        """Write, keep or discard a message."""
        if self._paused:
            self._discarded.note(message)
        elif self._limit is None:
            self._write(message)
        else:
            self._kept.append(message)
            self._kept_size += len(message.data)
            while self._kept_size > self._limit:
                oldest = self._kept.popleft()
                self._kept_size -= len(oldest.data)
                self._discarded.note(oldest)

    def pause(self) -> None:
        self._paused = True

    def resume(self) -> None:
        """Write messages again, first the last ones of latched topics."""
        if not self._paused:
            return
        self._paused = False
        if self._limit is None:
            for message in self._discarded.at(time.time_ns()):
                self._write(message)
            self._discarded.clear()

    def snapshot(self) -> int:
        """Write the kept messages; return how many."""
        if not self._kept:
            return 0
        messages = [*self._discarded.at(self._kept[0].log_time), *self._kept]
        self._discarded.clear()
        self._kept.clear()
        self._kept_size = 0
        for message in messages:
            self._write(message)
        return len(messages)

    def split(self) -> None:
        """Write the next message to a new file."""
        self._messages.split()

    def _write(self, message: Message) -> None:
        if self._messages.put(message):
            self.accepted += 1
        else:
            self.refused[message.topic] += 1
