"""Comparison of one topic's recorded messages with the computed ones: in order, or by content."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import NamedTuple

from rpud_sim.bag import Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.inspection.recorded_topics import RecordedMessages
from rpud_sim.inspection.verify.coverage import Coverage, JournalStretches, Position
from rpud_sim.inspection.verify.messages import (
    UNREADABLE,
    ComputedBlock,
    Key,
    first_difference,
    key_of,
    without_padding,
)

# Suspects kept of a topic: further ones show nothing that these do not.
_MOST_SUSPECTS = 10_000


@dataclass(frozen=True)
class MessageDifference:
    """Difference between a recorded message and the computed one."""

    topic: str  # name of its topic
    stamp: int  # its stamp [ns]
    log_time: int  # when it was recorded [ns]
    field: str  # that differs, as in ``wrench.force.z`` or ``position[3]``; empty for the whole
    recorded: str  # value in the bag
    computed: str | None  # value in the simulation; None if the simulation gives no such message


@dataclass(frozen=True)
class Counts:
    """Numbers of messages of a topic, by result of the comparison."""

    equal: int = 0  # bit for bit
    different: int = 0  # in at least one bit
    missing: int = 0  # computed between two recorded ones, and not in the bag
    unexpected: int = 0  # in the bag, and not computed
    tail: int = 0  # computed after the last recorded one, while the recording went on
    before: int = 0  # in the bag, of before the journal begins: not compared


class Suspect(NamedTuple):
    """Recorded message that its run does not give."""

    difference: MessageDifference  # how it differs
    data: bytes  # its bytes, zero between fields
    published: int  # when it was published [ns]


class _Computed(NamedTuple):
    key: Key
    data: bytes
    position: Position
    last_stretch: int  # in which it was computed again, with nothing between


class _Recorded(NamedTuple):
    key: Key
    message: Message
    data: bytes  # its bytes, zero between fields
    first_stretch: int  # to which it may belong
    last_stretch: int


class TopicComparison:
    """Comparison of one topic's computed messages with its recorded ones, both in order.

    Either side may lack messages: a recorder began late, ended early or lost some, or messages were
    inserted. Only the messages that follow show whether one is missing or altered, so the
    comparison always looks at two of each side. Messages of a latched topic may repeat. ``begins``
    is stamp and publishing time of the journal's first entry, if it is not the drill's first [ns].
    """

    def __init__(
        self,
        codec: Codec,
        recorded: RecordedMessages,
        stretches: JournalStretches,
        coverage: Coverage,
        latched: bool = False,
        begins: tuple[int, int] | None = None,
    ) -> None:
        self.older: Message | None = None  # the last one of before the journal begins
        self.suspects: list[Suspect] = []  # at most 10,000
        self._codec = codec
        self._source = recorded
        self._stretches = stretches
        self._coverage = coverage
        self._latched = latched
        self._begins = begins
        self._counts = Counter[str]()
        self._recorded: deque[_Recorded] = deque()
        self._computed: deque[_Computed] = deque()
        self._last_recorded = self._last_computed = b""
        self._missing = 0  # computed messages skipped since the last recorded one

    @property
    def counts(self) -> Counts:
        """Results so far."""
        return Counts(**self._counts)

    @property
    def exhausted(self) -> bool:
        """Whether all recorded messages are compared."""
        return not self._recorded and self._source.exhausted

    def add(self, block: ComputedBlock) -> None:
        """Add the next computed messages."""
        number = 0
        while number < len(block.messages):
            self._match_equal()
            if not (self._computed or self._recorded or self._latched):
                fitting = partial(self._stretches.fitting, block.stretch)
                if passed := self._source.pass_equal(block.messages, number, fitting):
                    self._begins = None
                    self._count("equal", passed)
                    number += passed
                    continue
            self._append(block, number)
            number += 1

    def finish(self) -> None:
        """Compare the remaining messages: no more are computed."""
        while self._computed:
            self._step()
        while (recorded := self._peek(0)) is not None:
            self._add_unexpected(recorded)

    def _append(self, block: ComputedBlock, number: int) -> None:
        data = block.messages.message(number)
        if self._latched and data == self._last_computed:
            # A repeated computed message adds nothing; repeats in the bag are skipped as well.
            if self._computed:
                self._computed[-1] = self._computed[-1]._replace(last_stretch=block.stretch)
            return
        self._last_computed = data
        position = block.stretch, int(block.ends[number])
        self._computed.append(_Computed(key_of(data, self._codec), data, position, block.stretch))
        while len(self._computed) > 1:
            self._step()

    def _peek(self, index: int) -> _Recorded | None:
        while len(self._recorded) <= index:
            message = self._source.pop()
            if message is None:
                return None
            if self._latched and message.data == self._last_recorded:
                continue
            self._last_recorded = message.data
            key = key_of(message.data, self._codec)
            if self._begins is not None:
                stamp, published = self._begins
                # Of the same stamp, a sample is of before the entry, and a waveform of after it.
                awaited = bool(self._computed) and self._computed[0].key == key
                older = key[0] < stamp or (key[0] == stamp and not awaited)
                if older or message.publish_time < published:
                    self.older = message
                    self._counts["before"] += 1
                    continue
                self._begins = None
            data = without_padding(message.data, self._codec)
            self._recorded.append(_Recorded(key, message, data, *self._stretches.of(message)))
        return self._recorded[index]

    def _match_equal(self) -> None:
        """Match the first messages of both sides while they are equal, whatever follows them."""
        while self._computed and (recorded := self._peek(0)) is not None:
            computed = self._computed[0]
            if (
                recorded.first_stretch > computed.last_stretch
                or computed.position[0] > recorded.last_stretch
                or recorded.message.data != computed.data
            ):
                return
            self._match(computed, recorded)

    def _step(self) -> None:
        """Decide about the first computed message, the first recorded one, or both."""
        computed = self._computed[0]
        recorded = self._peek(0)
        if recorded is None:
            self._add_tail(computed.position)  # the recording of this topic has ended
        elif computed.last_stretch < recorded.first_stretch:
            self._skip_computed()
        elif computed.position[0] > recorded.last_stretch:
            self._add_unexpected(recorded)
        else:
            self._compare_keys(computed, recorded)

    def _compare_keys(self, computed: _Computed, recorded: _Recorded) -> None:
        after_computed = self._computed[1].key if len(self._computed) > 1 else None
        after = self._peek(1)
        after_recorded = None if after is None else after.key
        may_follow = recorded.last_stretch > computed.last_stretch
        if recorded.key == computed.key:
            # A later computed message may have the same key, and be the one that was recorded.
            ambiguous = after_computed == computed.key or (
                after_computed not in (None, after_recorded) and may_follow
            )
            if ambiguous and recorded.data != computed.data:
                self._skip_computed()
            else:
                self._match(computed, recorded)
        elif after_computed == after_recorded:
            self._match(computed, recorded)  # its followers agree: an altered stamp
        elif recorded.key != after_computed and (
            after_recorded == computed.key
            or recorded.key == UNREADABLE
            or not (recorded.key > computed.key or may_follow)
        ):
            self._add_unexpected(recorded)
        else:
            self._skip_computed()

    def _match(self, computed: _Computed, recorded: _Recorded) -> None:
        self._computed.popleft()
        self._recorded.popleft()
        if recorded.data == computed.data:
            self._count("equal")
            return
        self._count("different")
        found = first_difference(self._codec, recorded.message.data, computed.data)
        self._add_suspect(computed.key[0], recorded, *found)

    def _count(self, result: str, more: int = 1) -> None:
        """Count matched messages, and the missing ones between them and those before."""
        # Messages before a topic's first one were published before the recorder subscribed.
        if self._matched:
            self._counts["missing"] += self._missing
        self._missing = 0
        self._counts[result] += more

    @property
    def _matched(self) -> bool:
        return self._counts["equal"] + self._counts["different"] > 0

    def _add_tail(self, position: Position) -> None:
        self._computed.popleft()
        if position <= self._coverage.reached and (
            self._matched or position > self._coverage.begun
        ):
            # Skipped ones lie before an unexpected message here, so they are missing at the end.
            self._counts["tail"] += self._missing * self._matched + 1
            self._missing = 0

    def _skip_computed(self) -> None:
        self._computed.popleft()
        self._missing += 1

    def _add_unexpected(self, recorded: _Recorded) -> None:
        self._recorded.popleft()
        self._counts["unexpected"] += 1
        self._add_suspect(recorded.key[0], recorded, "", "a message", None)

    def _add_suspect(
        self, stamp: int, recorded: _Recorded, field: str, value: str, computed: str | None
    ) -> None:
        if len(self.suspects) < _MOST_SUSPECTS:
            message = recorded.message
            difference = MessageDifference(
                message.topic, stamp, message.log_time, field, value, computed
            )
            self.suspects.append(Suspect(difference, recorded.data, message.publish_time))


class ContentComparison:
    """Second comparison of a topic with all runs together, if the one by run has failed.

    ``suspects`` are recorded messages that their run does not give, ``recorded`` are all of the
    topic.
    """

    def __init__(
        self, suspects: Iterable[Suspect], codec: Codec, recorded: Iterator[Message], latched: bool
    ) -> None:
        self.equal = 0  # number of recorded messages that were computed, in the recorded order
        self.unmatched = list(suspects)  # those that no run gives
        data = (without_padding(message.data, codec) for message in recorded)
        # Latched ones repeat where a bag's next file begins.
        self._recorded = (each for each, _ in groupby(data)) if latched else data
        self._next = next(self._recorded, None)
        self._suspected = {suspect.data for suspect in self.unmatched}

    @property
    def in_order(self) -> bool:
        """Whether every recorded message was computed, in the recorded order."""
        return self._next is None

    def add(self, computed: bytes) -> None:
        """Add the next computed message."""
        if computed == self._next:
            self.equal += 1
            self._next = next(self._recorded, None)
        if computed in self._suspected:
            self._suspected.remove(computed)
            self.unmatched = [each for each in self.unmatched if each.data != computed]
