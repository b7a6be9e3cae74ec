"""Recorded messages of several topics, read from the bag together, and those of one in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator
from functools import cached_property

import numpy as np

from rpud_sim.bag import BagReader, Message
from rpud_sim.bag.messages import MessageBlock, gathered, joined

_MOST_WAITING = 64 * 2**20  # greatest size of messages that wait [bytes]
_FEW = 2**16  # size of messages that are better given together [bytes]


class RecordedTopics:
    """Several readers of topics in one pass of a bag, so that each chunk is uncompressed once.

    A reader that is too far behind or ahead of the others gets a pass of its own. So memory is
    bounded whatever the order of the messages.
    """

    def __init__(self, bag: BagReader) -> None:
        self._bag = bag
        # Of each reader without a pass of its own, by its topic.
        self._waiting: dict[str, list[deque[MessageBlock]]] = {}
        self._size = 0  # of waiting messages [bytes]

    @cached_property
    def _together(self) -> Iterator[MessageBlock]:
        return self._bag.blocks(set(self._waiting))

    def blocks(self, topic: str) -> Generator[MessageBlock, None, None]:
        """Return the messages of a topic in their order, at least one at once, for one reader.

        Nothing is read before all readers have theirs. One that is closed before its end lets no
        further messages wait.
        """
        waiting: deque[MessageBlock] = deque()
        self._waiting.setdefault(topic, []).append(waiting)
        return self._blocks(topic, waiting)

    def _blocks(
        self, topic: str, waiting: deque[MessageBlock]
    ) -> Generator[MessageBlock, None, None]:
        passed = 0  # messages so far
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
                elif readers := self._waiting[block.topic]:
                    kept = block.packed()  # a few messages must not keep a whole chunk
                    for each in readers:
                        each.append(kept)
                        self._size += len(kept.data)
        finally:
            self._size -= sum(len(block.data) for block in waiting)
            readers = self._waiting[topic]
            readers[:] = [each for each in readers if each is not waiting]
        for block in self._bag.blocks({topic}):
            rest = block.part(slice(min(passed, len(block)), None))
            passed -= len(block) - len(rest)
            if len(rest):
                yield rest


class RecordedMessages:
    """Recorded messages of one topic, in order."""

    def __init__(self, blocks: Iterator[MessageBlock]) -> None:
        self._blocks = blocks
        self._rest: MessageBlock | None = next(blocks, None)  # at least one message

    @property
    def exhausted(self) -> bool:
        return self._rest is None

    def pop(self) -> Message | None:
        """Return the next message; None if there is none."""
        if (block := self._rest) is None:
            return None
        times = int(block.log_times[0]), int(block.publish_times[0])
        message = Message(block.topic, *times, block.message(0))
        self._skip(1)
        return message

    def pass_equal(
        self, computed: MessageBlock, first: int, fitting: Callable[[np.ndarray], int]
    ) -> int:
        """Skip the messages that are computed, bit for bit, and return their number.

        The computed ones count from number ``first`` on. ``fitting`` says how many may be these
        by their publishing times [ns].
        """
        passed = 0
        while first + passed < len(computed) and (block := self._rest) is not None:
            count = min(len(computed) - first - passed, len(block))
            own = block.part(slice(count))
            others = computed.part(slice(first + passed, first + passed + count))
            equal = fitting(own.publish_times[: _equal_count(own, others)])
            self._skip(equal)
            passed += equal
            if equal < count:
                break
        return passed

    def _skip(self, count: int) -> None:
        assert self._rest is not None
        rest = self._rest.part(slice(count, None))
        self._rest = rest if len(rest) else next(self._blocks, None)


def _equal_count(first: MessageBlock, second: MessageBlock) -> int:
    """Return the number of messages, from the first on, that are equal bit for bit."""
    count = leading(first.sizes == second.sizes)
    sizes = first.sizes[:count]
    one, other = (gathered(each.data, each.starts[:count], sizes) for each in (first, second))
    if np.array_equal(one, other):
        return count
    return int(np.searchsorted(np.cumsum(sizes), np.argmax(one != other), side="right"))


def leading(holds: np.ndarray) -> int:
    """Return how many values, from the first on, are true."""
    return len(holds) if holds.all() else int(np.argmin(holds))
