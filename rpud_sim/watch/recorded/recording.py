"""Open bag of a page: its signals, its clocks, and its parts, read by several threads."""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

import rpud_sim.bag
from rpud_sim.bag import BagError, Message, Piece
from rpud_sim.bag.block_order import gathered_blocks
from rpud_sim.bag.message_block import MessageBlock, joined
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.report.timeline import zero_stamp
from rpud_sim.watch.recorded.clock import Clock, Jump, JumpSearch, Series
from rpud_sim.watch.recorded.kept_rows import KeptRows, PieceRows
from rpud_sim.watch.recorded.signals import (
    TRAJECTORY,
    Rows,
    Signal,
    clock_topics,
    namespace,
    topic_readers,
)

# Parts that are read before the page stands; of the others it has not seen anything yet.
SAMPLED = 48

# Longest time from the stamp of a message to that of others that are logged before it [s].
LATE = 0.5

_PROBED = 64  # further parts that are read to find jumps of clocks

_Read = TypeVar("_Read")


class Recording:
    """Open bag.

    All methods may be called by several threads; one part is read at a time. Parts are numbered in
    the order of their beginnings. A damaged part is empty, and counted. The bag may still be being
    recorded, or not closed.
    """

    def __init__(self, path: str | Path) -> None:
        self._bag = rpud_sim.bag.open(path, unclosed=True)
        try:
            self.path = Path(path)
            self.begin = self._bag.start_time  # log time of its beginning [ns]
            self.duration = self._bag.duration / SECOND  # from the first to the last log time [s]
            self.message_count = self._bag.message_count  # of all topics
            self.size = self._bag.size  # of its files [bytes]
            self.unclosed = bool(self._bag.unclosed)  # whether a file was not closed
            self._sizes = {file: file.stat().st_size for file in self._bag.files}
            # By topic: readers, and reasons why there are no signals.
            self.readers, self.left_out = topic_readers(self._bag)
            self.pieces = self._bag.pieces()
        except BaseException:
            self._bag.close()
            raise
        self.damages: dict[int, str] = {}  # reasons why parts are not read, by their numbers
        self._lock = threading.Lock()
        self._kept = KeptRows()
        self._topics = frozenset(
            name for name, reader in self.readers.items() if reader.signals or reader.stamped
        )
        self._clock_topics = clock_topics(self.readers)
        self._topics -= {
            name
            for name, reader in self.readers.items()
            if reader.block and name not in self._clock_topics[namespace(name)]
        }
        self._held_by = {
            drill: [
                number
                for number, piece in enumerate(self.pieces)
                if any(namespace(topic) == drill for topic in piece.topics)
            ]
            for drill in {namespace(name) for name in self.readers}
        }
        self._spans: dict[str, dict[int, tuple[float, float]]] = {
            drill: {} for drill in self._held_by
        }
        self.clocks: dict[str, Clock] = {drill: Clock(None, self.begin) for drill in self._held_by}
        self._find_clocks()

    @property
    def signals(self) -> tuple[Signal, ...]:
        return tuple(signal for reader in self.readers.values() for signal in reader.signals)

    def trajectory(self, drill: str) -> str | None:
        """Return the trajectory's topic of a drill; None without one."""
        for name, reader in self.readers.items():
            if reader.summary.topic.type == TRAJECTORY and namespace(name) == drill:
                return name
        return None

    @property
    def sample(self) -> list[int]:
        """Numbers of the parts that give a first picture."""
        places = np.linspace(0, len(self.pieces) - 1, SAMPLED) if self.pieces else np.empty(0)
        return np.unique(places.astype(int)).tolist()

    @property
    def changed(self) -> str:
        """What happened to the files since they were opened; empty if nothing did."""
        for file, size in self._sizes.items():
            try:
                now = file.stat().st_size
            except OSError:
                return f"{file.name} was deleted"
            if now < size:
                return f"{file.name} became shorter"
            if now > size:
                return f"{file.name} has grown by {(now - size) / 1e6:.1f} MB"
        return ""

    def rows(self, number: int) -> PieceRows:
        """Return the rows of a part, by topic; none of a damaged one."""
        with self._lock:
            if (kept := self._kept.find(number)) is not None:
                return kept
            found = self._read(number)
            for drill in self._held_by:
                if times := self._times(drill, found):
                    self._spans[drill][number] = times
            self._kept.add(number, found)
            return found

    def messages(self, number: int, topics: Sequence[str]) -> list[Message]:
        """Return the messages of topics in a part; none of a damaged one."""
        with self._lock:
            return self._undamaged(number, frozenset(topics), lambda piece: piece.read(topics))

    def pieces_between(self, drill: str, start: float, end: float) -> Iterator[int]:
        """Yield the numbers of parts that may hold what a drill did from ``start`` to ``end`` [s].

        Times are since the bag began. It reads some parts to find the others.
        """
        held = self._held_by.get(drill, [])
        first = self._search(drill, held, start - LATE, lambda times: times[1] >= start - LATE)
        for number in held[first:]:
            times = self._span(drill, number)
            if times is not None and times[0] > end + LATE:
                return
            yield number

    def pieces_from(self, drill: str, time: float, *, back: bool = False) -> Iterator[int]:
        """Yield the numbers of parts from a time [s] on, to the end or to the beginning."""
        held = self._held_by.get(drill, [])
        if back:
            after = self._search(drill, held, time + LATE, lambda times: times[0] > time + LATE)
            yield from reversed(held[:after])
        else:
            first = self._search(drill, held, time - LATE, lambda times: times[1] >= time - LATE)
            yield from held[first:]

    def elapsed(self, topic: str, rows: Rows) -> np.ndarray:
        """Return the times of rows since the bag began [s]."""
        if not self.readers[topic].stamped:
            return (rows.log_times - self.begin) / SECOND
        return self.clocks[namespace(topic)].elapsed(rows.stamps, rows.log_times)

    def end_of(self, number: int) -> float:
        """Return the greatest time since the bag began in a part [s]; 0 without rows."""
        found = self.rows(number)
        ends = [
            float(self.elapsed(topic, rows).max())
            for topic, rows in found.items()
            if len(rows.stamps)
        ]
        return max(ends, default=0.0)

    def set_jumps(self, drill: str, jumps: Sequence[Jump]) -> None:
        clock = self.clocks[drill]
        with self._lock:
            self.clocks[drill] = Clock(clock.zero, clock.begin, tuple(jumps))
            self._spans[drill].clear()

    def close(self) -> None:
        with self._lock:
            self._bag.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read(self, number: int) -> PieceRows:
        by_topic: dict[str, list[MessageBlock]] = {}
        for block in self._undamaged(number, self._topics, self._blocks):
            by_topic.setdefault(block.topic, []).append(block)
        return {
            name: self.readers[name].read(blocks[0] if len(blocks) == 1 else joined(blocks))
            for name, blocks in by_topic.items()
        }

    def _blocks(self, piece: Piece) -> Iterable[MessageBlock]:
        if piece.blocks is not None:
            return piece.blocks(self._topics)
        return gathered_blocks(piece.read(self._topics))

    def _undamaged(
        self,
        number: int,
        topics: frozenset[str],
        read: Callable[[Piece], Iterable[_Read]],
    ) -> list[_Read]:
        """Return what a part holds of some topics, up to its damage; note the damage."""
        piece = self.pieces[number]
        found: list[_Read] = []
        if piece.topics.isdisjoint(topics):
            return found
        try:
            found.extend(read(piece))  # what is before the damage stays
        except BagError as error:
            self.damages.setdefault(number, str(error))
        return found

    def series(self, drill: str, found: PieceRows) -> Series:
        """Return stamps and log times of a drill's clock topics, in the order of the log times."""
        wanted = self._clock_topics[drill]
        parts = [rows for name, rows in found.items() if name in wanted]
        none = np.empty(0, np.int64)
        logs = np.concatenate([none, *(rows.log_times for rows in parts)])
        stamps = np.concatenate([none, *(rows.stamps for rows in parts)])
        order = np.argsort(logs, kind="stable")
        return stamps[order], logs[order]

    def _times(self, drill: str, found: PieceRows) -> tuple[float, float] | None:
        if not self._clock_topics[drill]:
            logs = [rows.log_times for name, rows in found.items() if namespace(name) == drill]
            logs = [each for each in logs if len(each)]
            if not logs:
                return None
            times = np.concatenate(logs) - self.begin
            return float(times.min()) / SECOND, float(times.max()) / SECOND
        stamps, logs_ = self.series(drill, found)
        if not len(stamps):
            return None
        elapsed = self.clocks[drill].elapsed(stamps, logs_)
        return float(elapsed.min()), float(elapsed.max())

    def _span(self, drill: str, number: int) -> tuple[float, float] | None:
        if number not in self._spans[drill]:
            found = self.rows(number)
            if number not in self._spans[drill] and (times := self._times(drill, found)):
                self._spans[drill][number] = times
        return self._spans[drill].get(number)

    def _search(
        self,
        drill: str,
        held: list[int],
        time: float,
        reached: Callable[[tuple[float, float]], bool],
    ) -> int:
        """Return the place of the first part that is reached.

        Most clocks run with the log times. So it begins where the log times have come to ``time``,
        and doubles its steps from there; bisection does the rest.
        """
        low, high = 0, len(held)
        place = bisect_left(held, self.begin + time * SECOND, key=self._end_of_piece)
        step = 1
        while low < high:
            probe = middle = min(max(place, low), high - 1)
            times = self._span(drill, held[probe])
            while times is None and probe + 1 < high:
                probe += 1
                times = self._span(drill, held[probe])
            if times is None or reached(times):
                high = middle
                place = middle - step
            else:
                low = probe + 1
                place = probe + step
            step *= 2
            if step > (high - low) // 2:
                place = (low + high) // 2
        return low

    def _end_of_piece(self, number: int) -> int:
        return self.pieces[number].end_time

    def _find_clocks(self) -> None:
        search = JumpSearch(_PROBED)
        for drill, topics in self._clock_topics.items():
            if not topics:
                continue

            def series(number: int, drill: str = drill) -> Series:
                return self.series(drill, self.rows(number))

            read = ((number, series(number)) for number in self.sample)
            parts = [(number, found) for number, found in read if len(found[0])]
            if not parts:
                continue
            zero = self._zero(drill, parts[0][0])
            self.clocks[drill] = Clock(zero, self.begin, search.jumps(parts, series))
            self._spans[drill].clear()

    def _zero(self, drill: str, number: int) -> int:
        """Return the stamp of a drill's clock at the beginning of the bag [ns]."""
        found = self.rows(number)
        names = self._clock_topics[drill] & found.keys()
        rows = min(
            (found[name] for name in names if len(found[name].stamps)),
            key=lambda each: int(each.log_times[0]),
        )
        return zero_stamp(rows.stamps, rows.log_times, self.begin)
