"""The last messages of latched topics, for a part of a recording that begins later."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from rpud_sim.bag.messages import Message
from rpud_sim.bag.metadata import Topic

REPEATED_KEY = "rpud_repeated"
"""Channel metadata of messages that a file repeats of the one before."""


class LatchedMessages:
    """Remembers as many messages of each latched topic as it has publishers.

    A topic is latched where one of its publishers is transient local.
    """

    def __init__(self) -> None:
        self._messages: dict[str, deque[Message]] = {}

    def declare(self, topic: Topic) -> None:
        """Make a topic known; what is not latched is not remembered."""
        if any(offer.durability == "transient_local" for offer in topic.offered_qos):
            self._messages.setdefault(topic.name, deque(maxlen=len(topic.offered_qos)))

    def __contains__(self, topic: str) -> bool:
        """Tell whether a topic is latched."""
        return topic in self._messages

    @property
    def size(self) -> int:
        """Bytes of all that is remembered, with some for each message."""
        return sum(
            len(message.data) + 64 for messages in self._messages.values() for message in messages
        )

    def note(self, message: Message) -> None:
        """Remember a message."""
        if message.topic in self._messages:
            self._messages[message.topic].append(message)

    def at(self, log_time: int) -> list[Message]:
        """Give what is remembered as if it were received at `log_time` [ns]."""
        remembered = [message for messages in self._messages.values() for message in messages]
        remembered.sort(key=lambda message: message.log_time)
        return [replace(message, log_time=log_time) for message in remembered]

    def clear(self) -> None:
        """Forget the messages."""
        for messages in self._messages.values():
            messages.clear()
