"""Streams of messages, topic by topic, and the comparison of two of them."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.bag import BagFormatError
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.messages.batch import Batch, joined
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.encoder import Decoded, gathered, items

_MOST_WAITING = 64 * 2**20  # greatest size of messages that wait [bytes]
_MANY = 2**22  # size of messages that are read together [bytes]
_FEW = 2**16  # size of messages that are better given together [bytes]
_STAMP = slice(4, 12)  # of the header, after the four bytes that show the encoding
UNREADABLE = -(2**62)  # time of a message that is too short for a stamp [ns]


class TopicStreams:
    """Streams of several topics from one pass, so that each chunk is uncompressed once.

    ``read`` starts a pass for some topics. A stream that is too far behind or ahead of the others
    gets a pass of its own. So memory is bounded whatever the order of the messages.
    """

    def __init__(self, read: Callable[[Collection[str]], Iterator[Batch]]) -> None:
        self.read = read
        self.waiting = 0  # size of the messages that wait [bytes]
        self._streams: dict[str, list[TopicStream]] = {}  # by topic

    @cached_property
    def _together(self) -> Iterator[Batch]:
        return self.read(set(self._streams))

    def stream(self, topic: str) -> TopicStream:
        """Return the messages of a topic; nothing is read before all have their streams."""
        stream = TopicStream(self, topic)
        self._streams.setdefault(topic, []).append(stream)
        return stream

    def advance(self) -> bool:
        """Read the next batches for the streams of their topics; return whether there were any."""
        goal = self.waiting + _MANY
        found = False
        while self.waiting < goal and (batch := next(self._together, None)) is not None:
            found = True
            if streams := [each for each in self._streams[batch.topic] if not each.closed]:
                kept = batch.packed()  # a few messages must not keep a whole chunk
                for each in streams:
                    each.add(kept)
            else:
                goal -= len(batch.data)
        return found


class TopicStream:
    """Messages of one topic, in their order; an empty list where others must be read first."""

    def __init__(self, streams: TopicStreams, topic: str) -> None:
        self.waiting = 0  # size of the messages that wait [bytes]
        self.closed = False  # whether it takes no more of what is read together
        self._streams, self._topic = streams, topic
        self._batches: deque[Batch] = deque()
        self._passed = 0  # messages so far
        self._alone: Iterator[Batch] | None = None  # its own pass

    def add(self, batch: Batch) -> None:
        self._batches.append(batch)
        self._count(len(batch.data))

    def _count(self, size: int) -> None:
        self.waiting += size
        self._streams.waiting += size

    def __iter__(self) -> TopicStream:
        return self

    def __next__(self) -> list[Batch]:
        if self._batches:
            # Together, as each batch costs more than a few small messages.
            found, size = [self._batches.popleft()], 0
            first = found[0]
            while (
                self._batches
                and (self._batches[0].run, self._batches[0].origin) == (first.run, first.origin)
                and (size := size + len(found[-1].data)) < _FEW
            ):
                found.append(self._batches.popleft())
            self._count(-sum(len(each.data) for each in found))
            self._passed += sum(map(len, found))
            return [joined(found)]
        if self._alone is None and self._streams.waiting <= _MOST_WAITING:
            if self._streams.advance():
                return []
            raise StopIteration
        if self._alone is None:
            self.close()
            self._alone = self._rest()
        return [next(self._alone)]

    def close(self) -> None:
        """Let no further messages wait."""
        self.closed = True
        self._count(-self.waiting)
        self._batches.clear()

    def _rest(self) -> Iterator[Batch]:
        passed = self._passed
        for batch in self._streams.read({self._topic}):
            rest = batch.part(slice(min(passed, len(batch)), None))
            passed -= len(batch) - len(rest)
            if len(rest):
                yield rest


def read_together(readers: Iterable[tuple[Iterator[object], Sequence[TopicStream]]]) -> None:
    """Read all to their ends, each from its streams; first the one for which most waits."""
    left = list(readers)
    while left:
        chosen = max(left, key=lambda each: sum([stream.waiting for stream in each[1]]))
        if next(chosen[0], left) is left:
            left.remove(chosen)


def stamps_of(block: Batch) -> np.ndarray:
    """Return the stamps of messages that begin with a header, shape (n,) [ns]."""
    whole = block.sizes >= _STAMP.stop
    stamps = np.full(len(block), UNREADABLE)
    places = block.starts[whole] + _STAMP.start
    if len(places):
        little = (block.data[block.starts[whole] + 1] & 1).astype(bool)
        parts = []
        for code, offset in (("i4", 0), ("u4", 4)):
            given = items(block.data, f"<{code}")[places + offset]
            parts.append(np.where(little, given, given.byteswap()).astype(np.int64))
        stamps[whole] = parts[0] * SECOND + parts[1]
    return stamps


def _times(batch: Batch) -> np.ndarray:
    """Return the stamps of messages since the origin of their run, shape (n,) [ns]."""
    stamps = stamps_of(batch)
    return np.where(stamps == UNREADABLE, UNREADABLE, stamps - batch.origin)


class Head:
    """Next message of a stream."""

    def __init__(self, held: Batch, number: int, codec: Codec) -> None:
        self.topic, self.run, self.origin = held.topic, held.run, held.origin
        self.time = int(_times(held.part(slice(number, number + 1)))[0])  # since the origin [ns]
        self.stamp = self.time + self.origin if self.time != UNREADABLE else 0
        self.log_time = int(held.log_times[number])
        self.publish_time = int(held.publish_times[number])
        self.data = held.message(number)
        self._codec = codec

    @cached_property
    def key(self) -> tuple[int, int, int]:
        """Run, time and sequence number: unique within a topic, unless something is wrong."""
        try:
            return self.run, self.time, int(getattr(self._codec.decode(self.data), "sequence", 0))
        except (BagFormatError, TypeError):
            return self.run, UNREADABLE, 0

    def shifted(self) -> Any:
        """Return the decoded message with times counted from the origin.

        A message that cannot be decoded raises a BagFormatError.
        """
        return _shifted(self._codec.decode(self.data), self.origin)


class StreamHead:
    """Place in a stream of one topic, whose parts are lists of batches and may be empty."""

    def __init__(self, parts: Iterator[list[Batch]], codec: Codec) -> None:
        self._parts = parts
        self._codec = codec
        self._ended = False
        self._held: deque[Batch] = deque()
        self._heads: deque[Head] = deque()  # of the first messages

    def ready(self) -> bool:
        """Take the next part if none is held; return whether the next message is known now."""
        return bool(self._held) or self._ended or self._take()

    def _take(self) -> bool:
        part = next(self._parts, None)
        if part is None:
            self._ended = True
            return True
        found = [batch for batch in part if len(batch)]
        self._held += found
        return bool(found)

    def held(self) -> Batch | None:
        """Return the next messages of a cursor that is ready, at least one; None at the end."""
        return self._held[0] if self._held else None

    def head(self, ahead: int = 0) -> Head | None:
        """Return the next message, or one ahead of it; None if there is none."""
        while len(self._heads) <= ahead:
            number = len(self._heads)
            for part in self._held:
                if number < len(part):
                    self._heads.append(Head(part, number, self._codec))
                    break
                number -= len(part)
            else:
                if self._ended:
                    return None
                self._take()
        return self._heads[ahead]

    def skip(self, count: int) -> None:
        """Skip messages of those that ``held`` returned."""
        first = self._held.popleft()
        if count < len(first):
            self._held.appendleft(first.part(slice(count, None)))
        if count == 1 and self._heads:
            self._heads.popleft()
        else:
            self._heads.clear()


class Matched(NamedTuple):
    """Step of a comparison: equal messages, a pair, a message of one side, or none yet."""

    equal: int = 0  # number of equal messages
    first: Head | None = None
    second: Head | None = None


def matched(
    first: StreamHead, second: StreamHead, *, several_times: bool = False
) -> Iterator[Matched]:
    """Match the messages of two streams of one topic, both in order, by run, time and number.

    Either side may lack messages. Only those that follow show whether one is missing or altered, so
    two of each side are looked at. ``several_times``: messages hold other times than their stamp.
    """
    while True:
        if not (first.ready() and second.ready()):
            yield Matched()
            continue
        if count := _equal_count(first.held(), second.held(), several_times):
            first.skip(count)
            second.skip(count)
            yield Matched(count)
            continue
        one, other = first.head(), second.head()
        if one is None and other is None:
            return
        takes = _takes(first, second)
        if takes[0]:
            first.skip(1)
        if takes[1]:
            second.skip(1)
        yield Matched(first=one if takes[0] else None, second=other if takes[1] else None)


def _takes(first: StreamHead, second: StreamHead) -> tuple[bool, bool]:
    """Return which sides' next messages belong together, or which one has no partner."""
    one, other = first.head(), second.head()
    if one is None or other is None:
        return one is not None, other is not None
    after_one, after_other = first.head(1), second.head(1)
    if one.key == other.key:
        # A later one may have the same key, and be the other side's.
        again = after_one is not None and after_one.key == other.key
        return True, not (again and after_one is not None and after_one.data == other.data)
    same_run = one.run == other.run
    if same_run and after_one and after_other and after_one.key == after_other.key:
        return True, True  # their followers agree: an altered stamp
    if one.key < other.key:
        out_of_order = after_other is not None and after_other.key <= one.key
        return not out_of_order, out_of_order
    out_of_order = after_one is not None and after_one.key <= other.key
    return out_of_order, not out_of_order


def _equal_count(first: Batch | None, second: Batch | None, several_times: bool) -> int:
    """Return how many messages, from the first on, are equal bit for bit but for their stamps."""
    if first is None or second is None or first.run != second.run:
        return 0
    count = min(len(first), len(second))
    same = first.sizes[:count] == second.sizes[:count]
    shifts = first.origin != second.origin
    if shifts:  # otherwise equal bytes have equal times
        if several_times:
            return 0
        parts = (each.part(slice(0, count)) for each in (first, second))
        same &= np.equal(*map(_times, parts))
    if not (count := _leading(same)):
        return 0
    sizes = first.sizes[:count]
    one, other = (_content(each, count, shifts) for each in (first, second))
    if np.array_equal(one, other):
        return count
    return int(np.searchsorted(np.cumsum(sizes), np.argmax(one != other), side="right"))


def _content(block: Batch, count: int, shifts: bool) -> np.ndarray:
    """Return the bytes of messages, without their stamps if these are shifted."""
    sizes = block.sizes[:count]
    data = gathered(block.data, block.starts[:count], sizes)
    if shifts:
        data = data.copy()
        starts = np.cumsum(sizes) - sizes
        data[(starts[:, None] + np.arange(_STAMP.start, _STAMP.stop)).ravel()] = 0
    return data


def _leading(holds: np.ndarray) -> int:
    """Return how many values, from the first on, are true."""
    return len(holds) if holds.all() else int(np.argmin(holds))


def difference(first: Head, second: Head) -> tuple[str, str, str] | None:
    """Return the first field in which two messages differ, and its value in each, as texts.

    None if only bytes between fields differ. If one cannot be decoded, the field is empty.
    """
    values = []
    for each, other in ((first, "a message"), (second, "a message")):
        try:
            values.append(each.shifted())
        except BagFormatError as error:
            if first.data == second.data:
                return None
            texts = (str(error), other) if each is first else (other, str(error))
            return "", *texts
    return first_field(*values)


_TIME = "builtin_interfaces/msg/Time"


def _shifted(value: Any, offset: int) -> Any:
    """Return a decoded message with times counted from an origin [ns]; zero times stay."""
    if not offset:
        return value
    if isinstance(value, list):
        return [_shifted(item, offset) for item in value]
    if not isinstance(value, Decoded):
        return value
    if value.type_name == _TIME and all(isinstance(each, int) for each in vars(value).values()):
        time = join_seconds(value["sec"], value["nanosec"])
        time -= offset if time else 0
        return Decoded(_TIME, {"sec": time // SECOND, "nanosec": time % SECOND})
    inner = {name: _shifted(item, offset) for name, item in vars(value).items()}
    return Decoded(value.type_name, inner)


def first_field(found: Any, expected: Any) -> tuple[str, str, str] | None:
    """Return the first field in which decoded messages differ, and its values; None if none is."""
    # The length of a sequence comes before its items, so both sides keep the same pace.
    for (path, own), (_, other) in zip(_leaves(found), _leaves(expected), strict=False):
        if _bits(own) != _bits(other):
            first, second = _text(own), _text(other)
            if first == second:  # only the bits of NaN differ
                first, second = (f"{each} (bits {_bits(each).hex()})" for each in (own, other))
            return path, first, second
    return None


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Decoded):
        for name, inner in vars(value).items():
            yield from _leaves(inner, f"{path}.{name}" if path else name)
    elif isinstance(value, list | np.ndarray):
        yield f"length of {path}", len(value)
        for number, inner in enumerate(value):
            yield from _leaves(inner, f"{path}[{number}]")
    else:
        yield path, value


def _bits(value: Any) -> Any:
    return struct.pack(">d", value) if isinstance(value, float) else value


def _text(value: Any) -> str:
    return f"{float(value)!r}" if isinstance(value, float) else f"{value!r:.100}"
