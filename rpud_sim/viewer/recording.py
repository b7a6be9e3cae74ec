"""Open bag: its signals, its clocks, and its parts, also while it still grows."""

from __future__ import annotations

import time
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

import rpud_sim.bag
from rpud_sim.bag import BagError, Message, Piece
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.message_block import MessageBlock, joined, messages_of
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.inspection.recorded_drill import Clock, Jump
from rpud_sim.viewer.signals import (
    OURS,
    Rows,
    Series,
    Signal,
    clock_topics,
    find_jumps,
    is_stranger,
    namespace,
    topic_readers,
    zero_stamp,
)

# Parts that are read before the page stands; of the others it has not seen anything yet.
SAMPLED = 48

# Longest time from the stamp of a message to that of others that are logged before it [s].
LATE = 0.5

_KEPT = 96  # parts whose rows, and decoded messages, are kept
_STILL = 10.0  # a bag that was written to within so many seconds may still be recorded [s]

PieceRows = dict[str, Rows]  # rows of one part of a bag, by topic


class Recording:
    """Open bag; for one thread at a time.

    Parts are numbered in the order of their beginnings. A damaged part is empty, and counted. The
    bag may still be being recorded, or not closed.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.bag = rpud_sim.bag.open(path, unclosed=True)
        try:
            self._files = _sizes(self.path)
            self.begin = self.bag.start_time  # log time of its beginning [ns]
            # By topic: readers, and reasons why there are no signals.
            self.readers, self.left_out = topic_readers(self.bag)
            self.pieces: list[Piece] = self.bag.pieces()
        except BaseException:
            self.bag.close()
            raise
        self.damages: dict[int, str] = {}  # reasons why parts are not read, by their numbers
        self.lost = ""  # what happened to the files since they were opened; empty for nothing
        # Rows of a part by topic, none of a damaged one; those that were used last are kept.
        self.rows = lru_cache(_KEPT)(lambda number: self.rows_of([number]))
        self.decoded = lru_cache(_KEPT)(self._decode)
        self._codecs: dict[str, Codec] = {}
        self._clock_topics = clock_topics(self.readers) or {"": frozenset()}  # nothing is readable
        self._topics = frozenset(
            name
            for name, reader in self.readers.items()
            if (reader.signals or reader.stamped)
            and (not reader.block or name in self._clock_topics[namespace(name)])
        )
        self._spans: dict[str, dict[int, tuple[float, float] | None]] = defaultdict(dict)
        self._held = lru_cache(_KEPT)(self._numbers)
        self.clocks = {drill: Clock(None, self.begin) for drill in self._clock_topics}
        self._find_clocks()

    @property
    def duration(self) -> float:
        """From the first to the last log time [s]."""
        return self.bag.duration / SECOND

    @property
    def growing(self) -> bool:
        """Whether the bag was not closed, and something was written to it just now."""
        if not self.bag.unclosed or self.lost:
            return False
        try:
            return time.time() - self.bag.files[-1].stat().st_mtime < _STILL
        except OSError:
            return False

    @property
    def signals(self) -> tuple[Signal, ...]:
        return tuple(signal for reader in self.readers.values() for signal in reader.signals)

    def is_drill(self, drill: str) -> bool:
        """Whether a namespace has topics of a drill."""
        return any(
            reader.summary.topic.type.startswith(OURS) and namespace(name) == drill
            for name, reader in self.readers.items()
        )

    def topic(self, drill: str, kind: str) -> str:
        """Return the topic of a drill with messages of a type, the drill's own first; or ""."""
        found = [
            name
            for name, reader in self.readers.items()
            if reader.summary.topic.type == kind and namespace(name) == drill
        ]
        return min(found, key=is_stranger, default="")

    @property
    def sample(self) -> list[int]:
        """Numbers of the parts that give a first picture."""
        places = np.linspace(0, len(self.pieces) - 1, SAMPLED) if self.pieces else np.empty(0)
        return np.unique(places.astype(int)).tolist()

    def grow(self) -> bool:
        """Add the parts that were written since the bag was opened, or grew.

        It returns False if that is not possible: there are other topics than before, or parts that
        were there are gone, or others. The bag must be opened again then.
        """
        now = _sizes(self.path)
        if now == self._files or self.lost:
            return True
        names = [file.name for file in self.bag.files]
        gone = [name for name in names if now.get(name, -1) < self._files.get(name, 0)]
        if gone and any(now[name] > self._files.get(name, 0) for name in now):
            return False  # a recorder with a limit of the disk deletes its oldest file
        if gone:
            missing = gone[0] not in now
            self.lost = f"{gone[0]} was deleted" if missing else f"{gone[0]} became shorter"
            return True
        try:
            bag = rpud_sim.bag.open(self.path, unclosed=True)
        except BagError as error:
            self.lost = f"it cannot be read any more: {error}"
            return True
        pieces = {_key(piece): piece for piece in bag.pieces()}
        known = {_key(piece) for piece in self.pieces}
        counted = {each.topic.name for each in bag.readable_topics if each.message_count}
        if not known <= pieces.keys() or not counted <= self.readers.keys() | self.left_out.keys():
            bag.close()
            return False
        new = [piece for key, piece in pieces.items() if key not in known]
        self.pieces = [pieces[_key(piece)] for piece in self.pieces] + new
        self.bag.close()
        self.bag, self._files = bag, now
        return True

    def rows_of(self, numbers: Iterable[int]) -> PieceRows:
        """Return the rows of several parts together, by topic; they are not kept."""
        by_topic: dict[str, list[MessageBlock]] = {}
        for number in numbers:
            for block in self._undamaged(number, self._topics):
                by_topic.setdefault(block.topic, []).append(block)
        return {
            name: self.readers[name].read(
                blocks[0] if len(blocks) == 1 else joined([block.packed() for block in blocks])
            )
            for name, blocks in by_topic.items()
        }

    def messages(self, number: int, topics: Sequence[str]) -> list[Message]:
        """Return the messages of topics in a part; none of a damaged one."""
        return [*messages_of(self._undamaged(number, frozenset(topics)))]

    def _decode(self, number: int, topic: str) -> list[tuple[Message, Any]]:
        """Return the messages of a topic in a part, as they came and decoded; no others."""
        if topic not in self._codecs:
            summary = self.readers[topic].summary
            self._codecs[topic] = Codec(summary.topic.type, summary.definition or "")
        found = []
        for message in self.messages(number, (topic,)):
            with suppress(BagError):
                found.append((message, self._codecs[topic].decode(message.data)))
        return found

    def pieces_between(self, drill: str, start: float, end: float) -> Iterator[int]:
        """Yield the numbers of parts that may hold what a drill did from ``start`` to ``end`` [s].

        Times are since the bag began. It reads some parts to find the others.
        """
        for number in self.pieces_from(drill, start):
            times = self.span(drill, number)
            if times is not None and times[0] > end + LATE:
                return
            yield number

    def pieces_from(self, drill: str, time: float, *, back: bool = False) -> Iterator[int]:
        """Yield the numbers of parts from a time [s] on, to the end or to the beginning."""
        held = self._held(drill, len(self.pieces))
        end = partial(self._end, drill)
        if back:
            yield from reversed(held[: bisect_left(held, time + LATE, key=end) + 1])
        else:
            yield from held[bisect_left(held, time - LATE, key=end) :]

    def elapsed(self, topic: str, rows: Rows) -> np.ndarray:
        """Return the times of rows since the bag began [s]."""
        if not self.readers[topic].stamped:
            return (rows.log_times - self.begin) / SECOND
        return self.clocks[namespace(topic)].elapsed(rows.stamps, rows.log_times)

    def time_of(self, message: Message, stamp: Any) -> float:
        """Return the time since the bag began [s] of a stamp in a message."""
        clock = self.clocks[namespace(message.topic)]
        if clock.zero is None:
            return (message.log_time - self.begin) / SECOND
        return (join_seconds(stamp.sec, stamp.nanosec) - clock.offset(message.log_time)) / SECOND

    def end_of(self, found: PieceRows) -> float:
        """Return the greatest time since the bag began of some rows [s]; 0 without any."""
        ends = [
            float(self.elapsed(topic, rows).max())
            for topic, rows in found.items()
            if len(rows.stamps)
        ]
        return max(ends, default=0.0)

    def set_jumps(self, found: Mapping[str, Sequence[Jump]]) -> None:
        for drill, jumps in found.items():
            clock = self.clocks[drill]
            self.clocks[drill] = Clock(clock.zero, clock.begin, tuple(jumps))
            self._spans[drill].clear()

    def close(self) -> None:
        self.bag.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _numbers(self, drill: str, count: int) -> list[int]:
        """Return which of the first parts hold topics of a drill."""
        parts = enumerate(self.pieces[:count])
        return [number for number, piece in parts if drill in map(namespace, piece.topics)]

    def _undamaged(self, number: int, topics: frozenset[str]) -> list[MessageBlock]:
        """Return what a part holds of some topics, up to its damage; note the damage."""
        piece = self.pieces[number]
        found: list[MessageBlock] = []
        if piece.topics.isdisjoint(topics):
            return found
        try:
            found.extend(piece.blocks(topics))  # what is before the damage stays
        except BagError as error:
            self.damages.setdefault(number, str(error))
        return found

    def series(self, drill: str, found: PieceRows) -> Series:
        """Return stamps and log times that show a drill's time, in the order of the log times."""
        wanted = self._clock_topics[drill]
        parts = [
            rows
            for name, rows in found.items()
            if (name in wanted if wanted else namespace(name) == drill)
        ]
        none = np.empty(0, np.int64)
        logs = np.concatenate([none, *(rows.log_times for rows in parts)])
        stamps = np.concatenate([none, *(rows.stamps for rows in parts)])
        order = np.argsort(logs, kind="stable")
        return stamps[order], logs[order]

    def span(self, drill: str, number: int) -> tuple[float, float] | None:
        """Return the first and the last time of a drill in a part [s]; None if it has none."""
        if number not in self._spans[drill]:
            stamps, logs = self.series(drill, self.rows(number))
            times = self.clocks[drill].elapsed(stamps, logs)
            self._spans[drill][number] = (times.min(), times.max()) if len(times) else None
        return self._spans[drill][number]

    def _end(self, drill: str, number: int) -> float:
        span = self.span(drill, number)
        return span[1] if span else (self.pieces[number].end_time - self.begin) / SECOND

    def _find_clocks(self) -> None:
        """Find when each clock began, and its jumps as far as a sample of the bag shows them."""
        for drill, topics in self._clock_topics.items():
            numbers = [number for number in self.sample if topics & self.rows(number).keys()]
            if not numbers:
                continue
            series = [self.series(drill, self.rows(number)) for number in numbers]
            stamps, logs = (np.concatenate(each) for each in zip(*series, strict=True))
            first = self.rows(numbers[0])
            rows = min(
                (first[name] for name in topics & first.keys()), key=lambda each: each.log_times[0]
            )
            zero = zero_stamp(rows.stamps, rows.log_times, self.begin)
            self.clocks[drill] = Clock(zero, self.begin, tuple(find_jumps(stamps, logs)))
            self._spans[drill].clear()


def _key(piece: Piece) -> tuple[int, int, int]:
    return piece.start_time, piece.end_time, piece.size


def _sizes(path: Path) -> dict[str, int]:
    """Return the sizes of a bag's files by their names [bytes]; of none that are gone."""
    try:
        files = [path] if path.is_file() else sorted(path.iterdir())
        return {file.name: file.stat().st_size for file in files}
    except OSError:
        return {}
