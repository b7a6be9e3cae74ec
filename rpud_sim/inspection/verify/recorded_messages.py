"""Recorded messages of one topic, compared with computed ones block by block."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from rpud_sim.bag import Message
from rpud_sim.bag.messages import MessageBlock, gathered

# Returns how many of some publishing times [ns], at least one, fit from the first on.
FittingTimes = Callable[[np.ndarray], int]

# Messages of at most this size are compared all at once. To put larger ones one behind the other
# takes longer than to compare them one by one [bytes].
_SMALL = 2048


class RecordedMessages:
    """Recorded messages of one topic in order; of a latched one without repeats."""

    def __init__(self, blocks: Iterator[MessageBlock], topic: str, latched: bool = False) -> None:
        self._blocks = blocks
        self._topic = topic
        self._latched = latched
        self._block: MessageBlock | None = None
        self._next = 0  # number in the block
        self._last: bytes | None = None

    @property
    def exhausted(self) -> bool:
        return self._first() is None

    def pop(self) -> Message | None:
        """Return the next message; None if there is none."""
        block = self._first()
        if block is None:
            return None
        number, self._next = self._next, self._next + 1
        self._last = data = block.message(number)
        log_time, publish_time = int(block.log_times[number]), int(block.publish_times[number])
        return Message(self._topic, log_time, publish_time, data)

    def pass_equal(self, computed: MessageBlock, first: int, fitting: FittingTimes) -> int:
        """Skip the messages that are computed, bit for bit, and return their number.

        The computed ones all differ from their neighbours; they count from number ``first`` on.
        ``fitting`` says how many may be these by their publishing times [ns].
        """
        passed = 0
        while first + passed < len(computed) and (block := self._first()) is not None:
            count = min(len(computed) - first - passed, len(block) - self._next)
            own = block.part(slice(self._next, self._next + count))
            others = computed.part(slice(first + passed, first + passed + count))
            equal = _equal_count(own, others)
            if equal:
                equal = fitting(own.publish_times[:equal])
            if not equal:
                break
            self._next += equal
            passed += equal
            self._last = own.message(equal - 1)
            if equal < count:
                break
        return passed

    def _first(self) -> MessageBlock | None:
        """Return the block of the next message, which is no repeat; None if there is none."""
        while True:
            if self._block is None or self._next >= len(self._block):
                self._block, self._next = next(self._blocks, None), 0
                if self._block is None:
                    return None
            last = self._last if self._latched else None
            if last is None or not self._repeats(self._block, last):
                return self._block
            self._next += 1

    def _repeats(self, block: MessageBlock, last: bytes) -> bool:
        if int(block.sizes[self._next]) != len(last):
            return False
        return block.message(self._next) == last


def _equal_count(first: MessageBlock, second: MessageBlock) -> int:
    """Return the number of messages, from the first on, that are equal bit for bit."""
    count = len(first)
    same = first.sizes == second.sizes
    if not same.all():
        count = int(np.argmin(same))
    sizes = first.sizes[:count]
    if count and int(sizes.max()) <= _SMALL:
        one, other = (
            gathered(block.data, block.starts[:count], sizes) for block in (first, second)
        )
        if np.array_equal(one, other):
            return count
        return int(np.searchsorted(np.cumsum(sizes), np.argmax(one != other), side="right"))
    for number in range(count):
        if not np.array_equal(_bytes(first, number), _bytes(second, number)):
            return number
    return count


def _bytes(block: MessageBlock, number: int) -> np.ndarray:
    start = int(block.starts[number])
    return block.data[start : start + int(block.sizes[number])]
