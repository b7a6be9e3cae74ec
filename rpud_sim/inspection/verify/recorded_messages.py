"""Recorded messages of one topic, compared with computed ones block by block."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from rpud_sim.bag import Message
from rpud_sim.bag.messages import MessageBlock, gathered
from rpud_sim.inspection.verify.coverage import leading


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
