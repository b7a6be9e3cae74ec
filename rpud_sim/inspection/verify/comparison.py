"""One topic as it was recorded beside the same topic as it is computed, message by message."""

from __future__ import annotations

import dataclasses
from array import array
from collections import deque
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np

from rpud_sim.bag import BagFormatError, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.time import join_seconds
from rpud_sim.inspection.verify.runs import Position, Span, Stretches
from rpud_sim.simulation.fields import Fields, stamp_of

# What a message has that no other of its topic should: stamp [ns] and number.
Key = tuple[int, int]

_UNREADABLE: Key = (-1, -1)


@dataclasses.dataclass(frozen=True)
class Difference:
    """A message that is not what it should be.

    Args:
        topic: on which it is.
        stamp: its stamp [ns].
        log_time: when it was recorded [ns].
        field: that differs, as in ``wrench.force.z`` or ``position[3]``; empty for the whole.
        recorded: what it says.
        computed: what it should say; None if it should not be there.
    """

    topic: str
    stamp: int
    log_time: int
    field: str
    recorded: str
    computed: str | None


@dataclasses.dataclass(frozen=True)
class Counts:
    """How many messages of a topic are what.

    Args:
        equal: bit for bit.
        different: in at least one bit.
        missing: computed between two recorded ones, and not in the bag.
        unexpected: in the bag, and not computed.
        tail: computed after the last recorded one, while the recording went on.
    """

    equal: int = 0
    different: int = 0
    missing: int = 0
    unexpected: int = 0
    tail: int = 0


@dataclasses.dataclass(frozen=True)
class Suspect:
    """A recorded message that is not what its run gives.

    Args:
        difference: how it differs.
        key: stamp [ns] and number.
        data: its bytes, zero between fields.
    """

    difference: Difference
    key: Key
    data: bytes


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
    """Puts the computed messages of one topic beside the recorded ones, both in order.

    Either may lack some: where a recorder began late, ended early or lost some, and where messages
    were put in. Whether a message is missing or was altered shows in the ones after it, so that it
    always looks at two of each.

    Args:
        topic: name of the topic.
        codec: of its type.
        recorded: its messages in the bag.
        stretches: of the journal; stamps may repeat in the next one.
        span: what the bag covers.
    """

    def __init__(
        self,
        topic: str,
        codec: Codec,
        recorded: Iterator[Message],
        stretches: Stretches,
        span: Span,
    ) -> None:
        self._topic = topic
        self._codec = codec
        self._recorded = without_repeats(recorded)
        self._stretches = stretches
        self._span = span
        self._ahead: deque[_Recorded] = deque()
        self._computed: deque[_Computed] = deque()
        self._last: tuple[Key, Fields] = (_UNREADABLE, {})
        self._counts = Counts()
        self._missing = 0  # since the last one that is there
        self.suspects: list[Suspect] = []

    @property
    def counts(self) -> Counts:
        """What was found so far."""
        return self._counts

    @property
    def exhausted(self) -> bool:
        """Whether there is no recorded message any more."""
        return self._peek(0) is None

    def add(self, computed: Fields, position: Position) -> None:
        """Add the next computed message, and where the drill stands when it gives it."""
        key = computed_key(computed)
        if key == self._last[0] and computed == self._last[1]:
            # It says nothing new, and neither does a repeated one in the bag.
            self._computed[-1] = dataclasses.replace(self._computed[-1], last_stretch=position[0])
            return
        self._last = (key, computed)
        self._computed.append(_Computed(key, computed, position, position[0]))
        while len(self._computed) > 1:
            self._settle()

    def finish(self) -> None:
        """Settle what is left: nothing more is computed."""
        while self._computed:
            self._settle()
        while (recorded := self._peek(0)) is not None:
            self._unexpected(recorded)

    def _peek(self, index: int) -> _Recorded | None:
        while len(self._ahead) <= index:
            message = next(self._recorded, None)
            if message is None:
                return None
            key = recorded_key(message, self._codec)
            self._ahead.append(_Recorded(key, message, *self._stretches.of(message)))
        return self._ahead[index]

    def _settle(self) -> None:
        """Find out about the first computed or the first recorded message, or both."""
        computed = self._computed[0]
        recorded = self._peek(0)
        if recorded is None:
            self._computed.popleft()  # the recording of this topic has ended
            self._count_tail(computed)
            return
        if computed.last_stretch < recorded.first_stretch:
            self._pass_over()
            return
        if computed.position[0] > recorded.last_stretch:
            self._unexpected(recorded)
            return
        after = self._computed[1].key if len(self._computed) > 1 else None
        follower = self._peek(1)
        follower_key = None if follower is None else follower.key
        if recorded.key == computed.key:
            expected = self._codec.encode(computed.fields)
            namesake = after == computed.key or (
                after is not None and after != follower_key and self._may_follow(recorded, computed)
            )
            if namesake and not self._same(recorded, expected):
                self._pass_over()  # a later computed one may be it
            else:
                self._there(computed, recorded, expected)
        elif after == follower_key:
            self._there(computed, recorded, self._codec.encode(computed.fields))
        elif recorded.key != after and (
            follower_key == computed.key or not self._is_later(recorded, computed)
        ):
            self._unexpected(recorded)
        else:
            self._pass_over()

    def _there(self, computed: _Computed, recorded: _Recorded, expected: bytes) -> None:
        self._computed.popleft()
        self._ahead.popleft()
        counts = self._counts
        missing = self._missing if counts.equal + counts.different else 0
        self._missing = 0
        same = self._same(recorded, expected)
        self._counts = dataclasses.replace(
            counts,
            equal=counts.equal + same,
            different=counts.different + (not same),
            missing=counts.missing + missing,
        )
        if not same:
            self._note(computed.key[0], recorded, *self._first_field(recorded, expected))

    def _count_tail(self, computed: _Computed) -> None:
        heard = self._counts.equal + self._counts.different
        if computed.position <= self._span.reached and (
            heard or computed.position > self._span.begun
        ):
            # Those that were passed over lay before an unexpected one.
            tail = self._counts.tail + self._missing * bool(heard) + 1
            self._missing = 0
            self._counts = dataclasses.replace(self._counts, tail=tail)

    def _pass_over(self) -> None:
        self._computed.popleft()
        self._missing += 1

    def _unexpected(self, recorded: _Recorded) -> None:
        self._ahead.popleft()
        self._counts = dataclasses.replace(self._counts, unexpected=self._counts.unexpected + 1)
        self._note(recorded.key[0], recorded, "", "a message", None)

    def _is_later(self, recorded: _Recorded, computed: _Computed) -> bool:
        """Whether a recorded message belongs after a computed one."""
        if recorded.key == _UNREADABLE:
            return False
        return recorded.key > computed.key or self._may_follow(recorded, computed)

    def _may_follow(self, recorded: _Recorded, computed: _Computed) -> bool:
        """Whether a recorded message may be of a later stretch than a computed one."""
        return recorded.last_stretch > computed.last_stretch

    def _note(
        self, stamp: int, recorded: _Recorded, field: str, value: str, computed: str | None
    ) -> None:
        if len(self.suspects) < _MOST_SUSPECTS:
            message = recorded.message
            difference = Difference(self._topic, stamp, message.log_time, field, value, computed)
            data = without_padding(message, self._codec)
            self.suspects.append(Suspect(difference, recorded.key, data))

    def _same(self, recorded: _Recorded, expected: bytes) -> bool:
        """Whether all fields are equal bit for bit; what is between them is nobody's."""
        message = recorded.message
        return message.data == expected or without_padding(message, self._codec) == expected

    def _first_field(self, recorded: _Recorded, expected: bytes) -> tuple[str, str, str]:
        try:
            found = self._codec.decode(recorded.message.data)
        except BagFormatError as error:
            return "", str(error), "a message"
        return next(_differing("", found, self._codec.decode(expected)))


# So many are kept of a topic: more of them show nothing that these do not.
_MOST_SUSPECTS = 10_000


def computed_key(fields: Fields) -> Key:
    """Return stamp [ns] and number of a computed message."""
    return stamp_of(fields), int(fields.get("sequence", 0))


def recorded_key(recorded: Message, codec: Codec) -> Key:
    """Return stamp [ns] and number of a recorded message; below zero if it cannot be decoded."""
    try:
        message = codec.decode(recorded.data)
    except BagFormatError:
        return _UNREADABLE
    stamp = message.header.stamp
    return join_seconds(stamp.sec, stamp.nanosec), getattr(message, "sequence", 0)


def without_padding(message: Message, codec: Codec) -> bytes:
    """Return a message's bytes with zeros between fields, or as they are if not decodable."""
    try:
        return codec.without_padding(message.data)
    except BagFormatError:
        return message.data


def without_repeats(recorded: Iterator[Message]) -> Iterator[Message]:
    """Leave out messages that stand there twice, as latched ones where a bag's next file begins."""
    last = None
    for message in recorded:
        if message.data != last:
            yield message
        last = message.data


def _differing(path: str, found: Any, expected: Any) -> Iterator[tuple[str, str, str]]:
    """Yield the places that differ, with both values."""
    if dataclasses.is_dataclass(found) or isinstance(found, SimpleNamespace):
        for name in vars(found):
            if not name.startswith("__"):
                inner = f"{path}.{name}" if path else name
                yield from _differing(inner, getattr(found, name), getattr(expected, name))
    elif isinstance(found, (list, np.ndarray, array)):
        if len(found) != len(expected):
            yield f"length of {path}", str(len(found)), str(len(expected))
        for i in range(min(len(found), len(expected))):
            yield from _differing(f"{path}[{i}]", found[i], expected[i])
    elif _bits(found) != _bits(expected):
        yield path, _shown(found, expected), _shown(expected, found)


def _bits(value: Any) -> Any:
    return np.float64(value).tobytes() if isinstance(value, float) else value


def _shown(value: Any, other: Any) -> str:
    """A value as text that shows how it differs."""
    if isinstance(value, float) and repr(float(value)) == repr(float(other)):
        return f"{value!r} (bits {np.float64(value).tobytes()[::-1].hex()})"
    return f"{float(value)!r}" if isinstance(value, float) else f"{value!r:.100}"
