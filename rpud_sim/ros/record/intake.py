"""What becomes of messages that are taken: written, kept for a snapshot, or left out in a pause."""

from __future__ import annotations

import time
from collections import Counter, deque

from rpud_sim.bag import Message
from rpud_sim.bag.latched import LatchedMessages
from rpud_sim.ros.record.message_queue import Declaration, MessageQueue


class Intake:
    """Stands before the queue of messages to write. For use by one thread.

    In a pause messages are left out. With `snapshot_size` the latest are kept, of as many bytes,
    and `snapshot` has them written. Either way what latched topics say last is written too, as if
    received when the recording goes on, or as the first of a snapshot.

    Args:
        messages: the queue.
        paused: whether it begins with a pause.
        snapshot_size: bytes that a snapshot has at most; None to write everything.
    """

    def __init__(
        self, messages: MessageQueue, *, paused: bool = False, snapshot_size: int | None = None
    ) -> None:
        self.refused: Counter[str] = Counter()
        """Messages of each topic for which the queue had no room."""
        self.accepted = 0
        """Messages that the queue took."""
        self._messages = messages
        self._paused = paused
        self._limit = snapshot_size
        self._kept: deque[Message] = deque()
        self._kept_size = 0
        self._left_out = LatchedMessages()

    @property
    def paused(self) -> bool:
        """Whether messages are left out."""
        return self._paused

    @property
    def takes_snapshots(self) -> bool:
        """Whether messages wait for a snapshot."""
        return self._limit is not None

    def declare(self, declaration: Declaration) -> None:
        """Make a topic known before its first message."""
        self._left_out.declare(declaration.topic)
        self._messages.declare(declaration)

    def put(self, message: Message) -> None:
        """Take a message."""
        if self._paused:
            self._left_out.note(message)
        elif self._limit is None:
            self._write(message)
        else:
            self._kept.append(message)
            self._kept_size += len(message.data)
            while self._kept_size > self._limit:
                oldest = self._kept.popleft()
                self._kept_size -= len(oldest.data)
                self._left_out.note(oldest)

    def pause(self) -> None:
        """Leave out what comes from now on."""
        self._paused = True

    def resume(self) -> None:
        """Go on."""
        if not self._paused:
            return
        self._paused = False
        if self._limit is None:
            for message in self._left_out.at(time.time_ns()):
                self._write(message)
            self._left_out.clear()

    def snapshot(self) -> int:
        """Have what is kept written; give the number of messages."""
        if not self._kept:
            return 0
        messages = [*self._left_out.at(self._kept[0].log_time), *self._kept]
        self._left_out.clear()
        self._kept.clear()
        self._kept_size = 0
        for message in messages:
            self._write(message)
        return len(messages)

    def split(self) -> None:
        """Have the next message written to a new file."""
        self._messages.split()

    def _write(self, message: Message) -> None:
        if self._messages.put(message):
            self.accepted += 1
        else:
            self.refused[message.topic] += 1
