"""Recorded messages of several topics, each in its order, read from the bag together."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Generator

from rpud_sim.bag import BagReader
from rpud_sim.bag.messages import MessageBlock, joined

_MOST_WAITING = 64 * 2**20  # greatest size of messages that wait [bytes]
_FEW = 2**16  # size of messages that are better given together [bytes]


class RecordedTopics:
    """Reader of several topics at once, so that each chunk is uncompressed once.

    A topic that is too far behind or ahead of the others gets a reader of its own. So memory is
    bounded whatever the order of the messages.
    """

    def __init__(self, bag: BagReader, topics: Collection[str]) -> None:
        self._bag = bag
        # Of each topic without a reader of its own.
        self._waiting: dict[str, deque[MessageBlock]] = {topic: deque() for topic in topics}
        self._size = 0  # of waiting messages [bytes]
        self._together = bag.blocks(topics)

    def blocks(self, topic: str) -> Generator[MessageBlock, None, None]:
        """Yield the messages of a topic in their order, at least one at once.

        An iterator that is closed before its end lets no further messages wait.
        """
        passed = 0  # messages so far
        waiting = self._waiting[topic]
        try:
            while waiting or self._size <= _MOST_WAITING:
                if waiting:
                    # Together, as each block costs more than a few small messages.
                    parts = [waiting.popleft()]
                    size = len(parts[0].data)
                    while waiting and size < _FEW:
                        parts.append(waiting.popleft())
                        size += len(parts[-1].data)
                    self._size -= size
                    found = joined(parts)
                    passed += len(found)
                    yield found
                elif (block := next(self._together, None)) is None:
                    return
                elif block.topic in self._waiting:
                    kept = block.packed()  # a few messages must not keep a whole chunk
                    self._waiting[block.topic].append(kept)
                    self._size += len(kept.data)
        finally:
            self._size -= sum(len(block.data) for block in self._waiting.pop(topic))
        for block in self._bag.blocks({topic}):
            rest = block.part(slice(min(passed, len(block)), None))
            passed -= len(block) - len(rest)
            if len(rest):
                yield rest
