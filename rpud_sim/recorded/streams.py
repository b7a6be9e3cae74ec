"""Streams of messages, topic by topic, and the comparison of two of them."""

from __future__ import annotations

import heapq
import struct
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.bag import BagFormatError
from rpud_sim.bag.batches import SerializedBatch, gathered, items, joined
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.encoder import Decoded
from rpud_sim.foundation.time import SECOND, join_seconds

_MOST_WAITING = 64 * 2**20  # greatest size of messages that wait [bytes]
_FEW = 2**16  # size of messages that are better given together [bytes]
_STAMP = slice(4, 12)  # of the header, after the four bytes that tell the encoding
UNREADABLE = -(2**62)  # time of a message that is too short for a stamp [ns]


class TopicStreams:
    """Streams of several topics from one pass, so that each chunk is uncompressed once.

    ``read`` starts a pass for some topics. A stream that is too far behind or ahead of the others
    gets a pass of its own. So memory is bounded whatever the order of the messages.
    """

    def __init__(self, read: Callable[[Collection[str]], Iterator[SerializedBatch]]) -> None:
        self._read = read
        self._waiting: dict[str, list[deque[SerializedBatch]]] = {}  # of each stream, by its topic
        self._size = 0  # of waiting messages [bytes]

    @cached_property
    def _together(self) -> Iterator[SerializedBatch]:
        return self._read(set(self._waiting))

    def stream(self, topic: str) -> Generator[SerializedBatch, None, None]:
        """Return the messages of a topic in their order, for one reader.

        Nothing is read before all readers have theirs. One that is closed before its end lets no
        further messages wait.
        """
        waiting: deque[SerializedBatch] = deque()
        self._waiting.setdefault(topic, []).append(waiting)
        return self._stream(topic, waiting)

    def _stream(
        self, topic: str, waiting: deque[SerializedBatch]
    ) -> Generator[SerializedBatch, None, None]:
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
        for block in self._read({topic}):
            rest = block.part(slice(min(passed, len(block)), None))
            passed -= len(block) - len(rest)
            if len(rest):
                yield rest


def read_together(readers: Iterable[Iterator[int]]) -> None:
    """Read all to their ends; each yields, now and then, to which time it came [ns].

    The one that is behind goes on, so that few messages of the others wait.
    """
    queue = [(-(2**63), number, reader) for number, reader in enumerate(readers)]
    while queue:
        _, number, reader = queue[0]
        time = next(reader, None)
        if time is None:
            heapq.heappop(queue)
        else:
            heapq.heapreplace(queue, (time, number, reader))


@dataclass(frozen=True)
class KeyedMessages:
    """Messages of a topic with what tells them apart in every stream."""

    messages: SerializedBatch
    runs: np.ndarray  # number of the run of each, ascending, shape (n,)
    times: np.ndarray  # of the stamp of each, in the time that streams share, shape (n,) [ns]
    origins: np.ndarray  # stamp of zero in that time, shape (n,) [ns]

    def part(self, chosen: slice) -> KeyedMessages:
        return KeyedMessages(
            self.messages.part(chosen),
            self.runs[chosen],
            self.times[chosen],
            self.origins[chosen],
        )


def stamps_of(block: SerializedBatch) -> np.ndarray:
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


class Head:
    """Next message of a stream."""

    def __init__(self, held: KeyedMessages, number: int, codec: Codec) -> None:
        self.topic = held.messages.topic
        self.run, self.time = int(held.runs[number]), int(held.times[number])
        self.origin = int(held.origins[number])
        self.stamp = self.time + self.origin if self.time != UNREADABLE else 0
        self.log_time = int(held.messages.log_times[number])
        self.publish_time = int(held.messages.publish_times[number])
        self.data = held.messages.message(number)
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


class Cursor:
    """Place in a stream of one topic."""

    def __init__(self, parts: Iterator[KeyedMessages], codec: Codec) -> None:
        self._parts = parts
        self._codec = codec
        self._held: deque[KeyedMessages] = deque()
        self._heads: deque[Head] = deque()  # of the first messages

    def held(self) -> KeyedMessages | None:
        """Return the next messages, at least one; None at the end."""
        while not self._held and (part := next(self._parts, None)) is not None:
            if len(part.runs):
                self._held.append(part)
        return self._held[0] if self._held else None

    def head(self, ahead: int = 0) -> Head | None:
        """Return the next message, or one ahead of it; None if there is none."""
        while len(self._heads) <= ahead:
            number = len(self._heads)
            for part in self._held:
                if number < len(part.runs):
                    self._heads.append(Head(part, number, self._codec))
                    break
                number -= len(part.runs)
            else:
                if (following := next(self._parts, None)) is None:
                    return None
                if len(following.runs):
                    self._held.append(following)
        return self._heads[ahead]

    def skip(self, count: int) -> None:
        """Skip messages of those that ``held`` returned."""
        first = self._held.popleft()
        if count < len(first.runs):
            self._held.appendleft(first.part(slice(count, None)))
        if count == 1 and self._heads:
            self._heads.popleft()
        else:
            self._heads.clear()


class Matched(NamedTuple):
    """Step of a comparison: equal messages, a pair, or a message of one side."""

    equal: int = 0  # number of equal messages
    time: int = 0  # of the last of them [ns]
    first: Head | None = None
    second: Head | None = None


def matched(
    first: Cursor, second: Cursor, *, several_times: bool = False, latched: bool = False
) -> Iterator[Matched]:
    """Match the messages of two streams of one topic, both in order, by run, time and number.

    Either side may lack messages. Only those that follow show whether one is missing or altered, so
    two of each side are looked at. ``several_times`` says that messages hold other times than their
    stamp. Messages of a ``latched`` topic may repeat.
    """
    latest: tuple[bytes, bytes] = b"", b""
    while True:
        count = _equal_count(first.held(), second.held(), several_times)
        if count:
            held = first.held()
            assert held is not None
            time = int(held.times[count - 1])
            if latched:
                latest = held.messages.message(count - 1), latest[1]
                other = second.held()
                latest = latest[0], other.messages.message(count - 1) if other else b""
            first.skip(count)
            second.skip(count)
            yield Matched(count, time)
            continue
        one, other_one = first.head(), second.head()
        if latched:
            if one and one.data == latest[0]:
                first.skip(1)
                continue
            if other_one and other_one.data == latest[1]:
                second.skip(1)
                continue
        if one is None and other_one is None:
            return
        takes = _takes(first, second)
        if takes[0]:
            first.skip(1)
            latest = one.data if one else b"", latest[1]
        if takes[1]:
            second.skip(1)
            latest = latest[0], other_one.data if other_one else b""
        yield Matched(first=one if takes[0] else None, second=other_one if takes[1] else None)


def _takes(first: Cursor, second: Cursor) -> tuple[bool, bool]:
    """Return which sides' next messages belong together, or which one stands alone."""
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


def _equal_count(
    first: KeyedMessages | None, second: KeyedMessages | None, several_times: bool
) -> int:
    """Return how many messages, from the first on, are equal bit for bit but for their stamps."""
    if first is None or second is None:
        return 0
    count = min(len(first.runs), len(second.runs))
    same = first.runs[:count] == second.runs[:count]
    same &= first.times[:count] == second.times[:count]
    same &= first.messages.sizes[:count] == second.messages.sizes[:count]
    if several_times:
        same &= first.origins[:count] == second.origins[:count]
    if not (count := _leading(same)):
        return 0
    sizes = first.messages.sizes[:count]
    shifts = bool((first.origins[:count] != second.origins[:count]).any())
    one, other = (_content(each.messages, count, shifts) for each in (first, second))
    if np.array_equal(one, other):
        return count
    return int(np.searchsorted(np.cumsum(sizes), np.argmax(one != other), side="right"))


def _content(block: SerializedBatch, count: int, shifts: bool) -> np.ndarray:
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
