"""Comparison of one topic's recorded messages with the computed ones: in order, or by content."""

from __future__ import annotations

import dataclasses
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import groupby

from rpud_sim.bag import Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.inspection.verify.coverage import Coverage, JournalStretches, Position
from rpud_sim.inspection.verify.messages import (
    UNREADABLE,
    ComputedBlock,
    Key,
    computed_key,
    first_difference,
    recorded_key,
    without_padding,
)
from rpud_sim.inspection.verify.recorded_messages import RecordedMessages
from rpud_sim.simulation.topics import Fields

# Suspects kept of a topic: further ones show nothing that these do not.
_MOST_SUSPECTS = 10_000


@dataclasses.dataclass(frozen=True)
class MessageDifference:
    """Difference between a recorded message and the computed one."""

    topic: str  # name of its topic
    stamp: int  # its stamp [ns]
    log_time: int  # when it was recorded [ns]
    field: str  # that differs, as in ``wrench.force.z`` or ``position[3]``; empty for the whole
    recorded: str  # value in the bag
    computed: str | None  # value in the simulation; None if the simulation gives no such message


@dataclasses.dataclass(frozen=True)
class Counts:
    """Numbers of messages of a topic, by result of the comparison."""

    equal: int = 0  # bit for bit
    different: int = 0  # in at least one bit
    missing: int = 0  # computed between two recorded ones, and not in the bag
    unexpected: int = 0  # in the bag, and not computed
    tail: int = 0  # computed after the last recorded one, while the recording went on
    before: int = 0  # in the bag, of before the journal begins: not compared


@dataclasses.dataclass(frozen=True)
class Suspect:
    """Recorded message that its run does not give."""

    difference: MessageDifference  # how it differs
    key: Key  # stamp [ns] and sequence number
    data: bytes  # its bytes, zero between fields
    published: int  # when it was published [ns]


@dataclasses.dataclass(frozen=True)
class _Computed:
    key: Key
    fields: Fields
    position: Position
    last_stretch: int  # in which it was computed again, with nothing between


@dataclasses.dataclass(frozen=True)
class _Recorded:
    key: Key
    message: Message
    first_stretch: int
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
        topic: str,
        codec: Codec,
        recorded: RecordedMessages,
        stretches: JournalStretches,
        coverage: Coverage,
        latched: bool = False,
        begins: tuple[int, int] | None = None,
    ) -> None:
        self.older: Message | None = None  # the last one of before the journal begins
        self._latched = latched
        self._begins = begins
        self._counts = Counter[str]()  # results so far
        # messages so far that are not as computed, at most 10,000
        self.suspects: list[Suspect] = []
        self._topic = topic
        self._codec = codec
        self._stretches = stretches
        self._coverage = coverage
        self._source = recorded
        self._recorded: deque[_Recorded] = deque()
        self._computed: deque[_Computed] = deque()
        self._last: tuple[Key, Callable[[], Fields]] = (UNREADABLE, dict)
        self._missing = 0  # computed messages skipped since the last recorded one

    @property
    def counts(self) -> Counts:
        """Results so far."""
        return Counts(**self._counts)

    @property
    def exhausted(self) -> bool:
        """Whether all recorded messages are compared."""
        return not self._recorded and self._source.exhausted

    def add(self, computed: Fields, position: Position) -> None:
        """Add the next computed message, and the progress of the drill at it."""
        key = computed_key(computed)
        if self._latched and key == self._last[0] and computed == self._last[1]():
            # A repeated computed message adds nothing; repeats in the bag are skipped as well.
            if self._computed:
                again = dataclasses.replace(self._computed[-1], last_stretch=position[0])
                self._computed[-1] = again
            return
        self._last = (key, lambda: computed)
        self._computed.append(_Computed(key, computed, position, position[0]))
        while len(self._computed) > 1:
            self._step()

    def add_block(self, computed: ComputedBlock) -> None:
        """Add the next computed messages; what they equal bit for bit is compared at once.

        A message and its follower need not be looked at where the bytes are equal and the times
        fit: they match whatever follows.
        """
        number = 0
        count = len(computed.messages)
        if self._latched and computed.key(0) == self._last[0]:
            self.add(computed.fields(0), computed.position(0))
            number = 1
        while number < count:
            self._match_equal()
            if self._computed or self._recorded:
                self.add(computed.fields(number), computed.position(number))
                number += 1
                continue
            passed = self._source.pass_equal(
                computed.messages, number, partial(self._stretches.fitting, computed.stretch)
            )
            if passed:
                self._begins = None
                self._count("equal", passed)
                number += passed
            elif self._source.exhausted:
                for rest in range(number, count):
                    self._add_tail(computed.position(rest))
                number = count
            else:
                self.add(computed.fields(number), computed.position(number))
                number += 1
                continue
            self._last = (computed.key(number - 1), partial(computed.fields, number - 1))

    def _match_equal(self) -> None:
        """Match the first messages of both sides while they are equal bit for bit."""
        while self._computed and (recorded := self._peek(0)) is not None:
            computed = self._computed[0]
            if not (
                recorded.first_stretch <= computed.last_stretch
                and computed.position[0] <= recorded.last_stretch
                and recorded.message.data == self._codec.encode(computed.fields)
            ):
                return
            self._match(computed, recorded)

    def _count(self, result: str, more: int = 1) -> None:
        """Count matched messages, and the missing ones between them and those before."""
        # Messages before a topic's first one were published before the recorder subscribed.
        if self._matched:
            self._counts["missing"] += self._missing
        self._missing = 0
        self._counts[result] += more

    @property
    def _matched(self) -> int:
        return self._counts["equal"] + self._counts["different"]

    def finish(self) -> None:
        """Compare the remaining messages: no more are computed."""
        while self._computed:
            self._step()
        while (recorded := self._peek(0)) is not None:
            self._add_unexpected(recorded)

    def _peek(self, index: int) -> _Recorded | None:
        while len(self._recorded) <= index:
            message = self._source.pop()
            if message is None:
                return None
            key = recorded_key(message, self._codec)
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
            self._recorded.append(_Recorded(key, message, *self._stretches.of(message)))
        return self._recorded[index]

    def _step(self) -> None:
        """Decide about the first computed message, the first recorded one, or both."""
        computed = self._computed[0]
        recorded = self._peek(0)
        if recorded is None:
            self._computed.popleft()  # the recording of this topic has ended
            self._add_tail(computed.position)
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
        if recorded.key == computed.key:
            # A later computed message may have the same key, and be the one that was recorded.
            ambiguous = after_computed == computed.key or (
                after_computed not in (None, after_recorded)
                and self._may_follow(recorded, computed)
            )
            if ambiguous and not self._is_equal(recorded, self._codec.encode(computed.fields)):
                self._skip_computed()
            else:
                self._match(computed, recorded)
        elif after_computed == after_recorded:
            self._match(computed, recorded)  # its followers agree: an altered stamp
        elif recorded.key != after_computed and (
            after_recorded == computed.key or not self._is_later(recorded, computed)
        ):
            self._add_unexpected(recorded)
        else:
            self._skip_computed()

    def _match(self, computed: _Computed, recorded: _Recorded) -> None:
        self._computed.popleft()
        self._recorded.popleft()
        expected = self._codec.encode(computed.fields)
        equal = self._is_equal(recorded, expected)
        self._count("equal" if equal else "different")
        if not equal:
            found = first_difference(self._codec, recorded.message.data, expected)
            self._add_suspect(computed.key[0], recorded, *found)

    def _add_tail(self, position: Position) -> None:
        matched = bool(self._matched)
        if position <= self._coverage.reached and (matched or position > self._coverage.begun):
            # Skipped ones lie before an unexpected message here, so they are missing at the end.
            self._counts["tail"] += self._missing * matched + 1
            self._missing = 0

    def _skip_computed(self) -> None:
        self._computed.popleft()
        self._missing += 1

    def _add_unexpected(self, recorded: _Recorded) -> None:
        self._recorded.popleft()
        self._counts["unexpected"] += 1
        self._add_suspect(recorded.key[0], recorded, "", "a message", None)

    def _is_later(self, recorded: _Recorded, computed: _Computed) -> bool:
        if recorded.key == UNREADABLE:
            return False
        return recorded.key > computed.key or self._may_follow(recorded, computed)

    def _may_follow(self, recorded: _Recorded, computed: _Computed) -> bool:
        return recorded.last_stretch > computed.last_stretch

    def _add_suspect(
        self, stamp: int, recorded: _Recorded, field: str, value: str, computed: str | None
    ) -> None:
        if len(self.suspects) < _MOST_SUSPECTS:
            message = recorded.message
            difference = MessageDifference(
                self._topic, stamp, message.log_time, field, value, computed
            )
            data = without_padding(message, self._codec)
            suspect = Suspect(difference, recorded.key, data, message.publish_time)
            self.suspects.append(suspect)

    def _is_equal(self, recorded: _Recorded, expected: bytes) -> bool:
        """Whether all fields are equal bit for bit; padding between fields is ignored."""
        message = recorded.message
        return message.data == expected or without_padding(message, self._codec) == expected


class ContentComparison:
    """Second comparison of a topic with all runs together, if the one by run has failed.

    ``suspects`` are recorded messages that their run does not give, ``recorded`` are all of the
    topic.
    """

    def __init__(
        self, suspects: Sequence[Suspect], codec: Codec, recorded: Iterator[Message], latched: bool
    ) -> None:
        self.equal = 0  # number of recorded messages that were computed, in the recorded order
        self._codec = codec
        self._recorded = recorded
        if latched:  # they repeat where a bag's next file begins
            self._recorded = (next(group) for _, group in groupby(recorded, lambda each: each.data))
        self._suspects: dict[Key, list[Suspect]] = {}
        for suspect in suspects:
            self._suspects.setdefault(suspect.key, []).append(suspect)
        self._next = self._read_next()

    @property
    def in_order(self) -> bool:
        """Whether every recorded message was computed, in the recorded order."""
        return self._next is None

    @property
    def unmatched(self) -> list[Suspect]:
        """Suspects that no run gives."""
        return [suspect for group in self._suspects.values() for suspect in group]

    def add(self, computed: Fields) -> None:
        """Add the next computed message."""
        key = computed_key(computed)
        awaited = self._next is not None and self._next[0] == key
        if not awaited and key not in self._suspects:
            return
        expected = self._codec.encode(computed)
        if awaited and self._next == (key, expected):
            self.equal += 1
            self._next = self._read_next()
        if key in self._suspects:
            left = [suspect for suspect in self._suspects.pop(key) if suspect.data != expected]
            if left:
                self._suspects[key] = left

    def _read_next(self) -> tuple[Key, bytes] | None:
        message = next(self._recorded, None)
        if message is None:
            return None
        return recorded_key(message, self._codec), without_padding(message, self._codec)
