"""Intake of received messages: written, or discarded in a pause."""

from __future__ import annotations

import time
from collections import Counter

from rpud_sim.bag import Message
from rpud_sim.bag.messages import LatchedMessages
from rpud_sim.ros.record.message_queue import Declaration, MessageQueue


class Intake:
    """Filter before the queue of messages to write. For use by one thread.

    A pause discards messages. At its end the last messages of latched topics are written, as
    received then.

    Args:
        paused: whether it begins with a pause.
    """

    def __init__(self, messages: MessageQueue, *, paused: bool = False) -> None:
        # messages of each topic that did not fit into the queue
        self.refused: Counter[str] = Counter()
        self.accepted = 0  # messages that the queue holds or held
        self._messages = messages
        self._paused = paused
        self._discarded = LatchedMessages()

    @property
    def paused(self) -> bool:
        return self._paused

    def declare(self, declaration: Declaration) -> None:
        """Declare a topic, before its first message."""
        self._discarded.declare(declaration.topic)
        self._messages.declare(declaration)

    def put(self, message: Message) -> None:
        """Write or discard a message."""
        if self._paused:
            self._discarded.note(message)
        else:
            self._write(message)

    def pause(self) -> None:
        self._paused = True

    def resume(self) -> None:
        """Write messages again, first the last ones of latched topics."""
        if not self._paused:
            return
        self._paused = False
        for message in self._discarded.at(time.time_ns()):
            self._write(message)
        self._discarded.clear()

    def split(self) -> None:
        """Write the next message to a new file."""
        self._messages.split()

    def _write(self, message: Message) -> None:
        if self._messages.put(message):
            self.accepted += 1
        else:
            self.refused[message.topic] += 1
