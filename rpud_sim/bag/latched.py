"""Last messages of latched topics, for a part of a recording that begins later."""

from __future__ import annotations

from collections import deque

from rpud_sim.bag.messages import Message
from rpud_sim.bag.metadata import Topic

# Channel metadata of messages that a file repeats of the previous one.
REPEATED_KEY = "rpud_repeated"


class LatchedMessages:
    """Last messages of each topic with a transient local publisher, one for each publisher."""

    def __init__(self) -> None:
        self._messages: dict[str, deque[Message]] = {}

    def declare(self, topic: Topic) -> None:
        """Add a topic; it is ignored if it is not latched."""
        if any(offer.durability == "transient_local" for offer in topic.offered_qos):
            self._messages.setdefault(topic.name, deque(maxlen=len(topic.offered_qos)))

    def __contains__(self, topic: str) -> bool:
        """Return whether a topic is latched."""
        return topic in self._messages

    @property
    def size(self) -> int:
        """Size of the messages, with an overhead for each [bytes]."""
        return sum(
            len(message.data) + 64 for messages in self._messages.values() for message in messages
        )

    def note(self, message: Message) -> None:
        if message.topic in self._messages:
            self._messages[message.topic].append(message)

    def at(self, log_time: int) -> list[Message]:
        """Return the messages in their order, as if they were received at ``log_time`` [ns]."""
        kept = [message for messages in self._messages.values() for message in messages]
        kept.sort(key=lambda message: message.log_time)
        return [message._replace(log_time=log_time) for message in kept]

    def clear(self) -> None:
        for messages in self._messages.values():
            messages.clear()
