"""Open bag: its signals, its time lines, its chunks, and how it is read into histories."""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

import rpud_sim.bag
from rpud_sim.bag import BagChunk, BagError, BagFormatError, BagReader, Message, TopicSummary
from rpud_sim.bag.tables import compiled
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.batch import Batch, joined, messages_of
from rpud_sim.messages.columns import Column, FieldReader, Kind
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.runs import RecordedRun, runs_of
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.viewer.bins import Bins, gaps_of
from rpud_sim.viewer.history import History, Signal, is_foreign, namespace
from rpud_sim.viewer.stamp_times import Rows, StampTimes

MOST_SIGNALS, MOST_TOPICS = 120, 100  # signals of a bag, and topics with signals
OURS = "rpud_msgs/"  # signals of these types come first where a bag has too many
TRAJECTORY_TYPE, STATUS_TYPE = TOPICS["trajectory"].type, TOPICS["status"].type
FAULTS_TYPE = TOPICS["faults"].type
BINS = 2**17  # greatest number of bins of a signal
MEMORY = 256 * 2**20  # greatest size of the bins of all signals [bytes]
MOST_FAULTS = 10_000  # messages of faults that are read; further ones are counted

GREATEST = 1e120  # size of a value: squares of greater ones overflow
SAMPLED = 48  # chunks that are read before the page is complete
LATE = 0.5  # longest time from the stamp of a message to that of others logged before it [s]

_KEPT = 96  # chunks whose rows are kept
_NO_SIGNALS = {"sequence", "sample_period"}  # they number messages, or help to read them
_LEAST_BINS = 2**10
_BIN_SIZE = 32  # bytes
_TOGETHER = 16  # chunks that are read together
_SPARE = 1.02  # of the time, for what is later than the last log time


class TopicReader:
    """Reader of the signals of one topic, of which it takes at most so many."""

    def __init__(self, summary: TopicSummary, columns: Sequence[Column], most: int) -> None:
        self.topic, self.type = summary.topic.name, summary.topic.type
        self.unreadable = 0  # messages that are not of the type
        self.block = columns[0].name == "time"  # whether a message holds many rows
        stamp = [each for each in columns if each.name == "header.stamp" and each.kind is Kind.TIME]
        numbers = [
            each
            for each in columns
            if each.kind is Kind.NUMBER and each.name not in _NO_SIGNALS and not self.block
        ][:most]
        self.stamped = bool(stamp)
        self.latched = "transient_local" in {each.durability for each in summary.topic.offered_qos}
        self.signals = [Signal(self.topic, self.type, each.name, each.unit) for each in numbers]
        self.codec, _ = compiled(self.type, summary.definition or "")
        self._fields = FieldReader(self.codec, [*stamp, *numbers])

    def read(self, batch: Batch) -> Rows:
        """Return the rows of messages; count those that are not of the type."""
        found = self._fields.read(batch)
        self.unreadable += len(found.errors)
        logs, published = batch.log_times[found.rows], batch.publish_times[found.rows]
        values = {}
        for signal in self.signals:
            numbers = found.array(signal.column).astype(float)
            values[signal.column] = np.clip(numbers, -GREATEST, GREATEST)
        stamps = found.array("header.stamp") if self.stamped else logs
        return Rows(logs, published, stamps, values)


def topic_readers(bag: BagReader) -> tuple[dict[str, TopicReader], dict[str, str]]:
    """Return the readers of topics by their names, and the reasons why others have none."""
    left_out, left = {**bag.damages, **bag.left_out}, MOST_SIGNALS
    readers: dict[str, TopicReader] = {}
    for summary in sorted(bag.readable_topics, key=lambda s: not s.topic.type.startswith(OURS)):
        name = summary.topic.name
        if name in left_out or not summary.message_count:
            continue
        if len(readers) >= MOST_TOPICS:
            left_out[name] = f"the bag has more than {MOST_TOPICS} topics"
            continue
        try:
            readers[name] = TopicReader(summary, bag.columns(name), left)
        except BagFormatError as error:
            left_out[name] = str(error)
        else:
            left -= len(readers[name].signals)
    return dict(sorted(readers.items())), left_out


def _is_own(reader: TopicReader) -> bool:
    """Whether a topic has name and type of a drill's own; commands and other programs have not."""
    name = reader.topic.rpartition("/")[2]
    return name in TOPICS and reader.type == TOPICS[name].type


class RecordedBag:
    """Open bag; for one thread at a time.

    Chunks are numbered in the order of their beginnings. A damaged one is empty, and counted.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.bag = rpud_sim.bag.open(path)
        try:
            self.begin = self.bag.start_time  # log time of its beginning [ns]
            # By topic: readers, and reasons why there are no signals.
            self.readers, self.left_out = topic_readers(self.bag)
            self.chunks: list[BagChunk] = self.bag.chunks()
            self._prepare()
        except BaseException:
            self.bag.close()
            raise

    def _prepare(self) -> None:
        self.signals = [each for reader in self.readers.values() for each in reader.signals]
        self.damages: dict[int, str] = {}  # reasons why chunks are not read, by their numbers
        self.unknown: dict[str, str] = {}  # why the runs of drills are not known, by namespace
        # Rows of a chunk by topic, none of a damaged one; those that were used last are kept.
        self.rows = lru_cache(_KEPT)(lambda number: self.rows_of([number]))
        # Topics that show the time of each namespace. Blocks are logged long after their stamps,
        # and latched messages may be old: they do so only where there is nothing else.
        self._timed: dict[str, set[str]] = {}
        for drill in {*map(namespace, self.readers)} or {""}:  # nothing is readable
            here = [each for name, each in self.readers.items() if namespace(name) == drill]
            own = [each for each in here if _is_own(each) or not self.is_drill(drill)]
            stamped = [each for each in own if each.stamped]
            prompt = [each for each in stamped if not (each.latched or each.block)]
            self._timed[drill] = {each.topic for each in prompt or stamped or own}
        self._topics = {
            name
            for name, reader in self.readers.items()
            if (reader.signals or reader.stamped)
            and (not reader.block or name in self._timed[namespace(name)])
        }
        drills = sorted(filter(self.is_drill, self._timed), key=len)
        # Whose clock a namespace has: one within a drill's has that of the drill.
        self._clocks = {
            each: next((d for d in reversed(drills) if f"{each}/".startswith(f"{d}/")), each)
            for each in self._timed
        }
        held = [{*map(self.clock, chunk.topics)} for chunk in self.chunks]
        self._held = {
            drill: [number for number, clocks in enumerate(held) if drill in clocks]
            for drill in set(self._clocks.values())
        }
        self._usual_ends: dict[str, float] = {}  # of namespaces without a drill [s]
        self.span = lru_cache(None)(self._span)
        # None of a namespace without stamps, where log times count.
        self.time_lines = {drill: self._time_line(drill) for drill in self._held}
        self.end = max(map(self._last, drills), default=math.inf)  # of the drills [s]

    def is_drill(self, drill: str) -> bool:
        """Whether a namespace has topics of a drill."""
        return any(
            _is_own(each) and each.type.startswith(OURS)
            for name, each in self.readers.items()
            if namespace(name) == drill
        )

    def clock(self, topic: str) -> str:
        """Return the namespace whose clock a topic has."""
        return self._clocks.get(here := namespace(topic), here)

    def fits(self, topic: str, times: np.ndarray) -> np.ndarray:
        """Return which times of messages [ns] a topic may have, shape (n,).

        Only a drill's own topics set how long it lasts: any stamp may be in one of others.
        """
        if self.is_drill(drill := self.clock(topic)) and topic in self._timed[drill]:
            return np.ones(len(times), bool)
        end = self.end if self.is_drill(drill) else self._usual_end(drill)
        return (times >= -LATE * SECOND) & (times <= (end + LATE) * SECOND)

    def topic(self, drill: str, kind: str) -> str:
        """Return the topic of a drill with messages of a type, the drill's own first; or ""."""
        of_kind = [name for name, reader in self.readers.items() if reader.type == kind]
        found = [name for name in of_kind if namespace(name) == drill]
        return min(found, key=is_foreign, default="")

    @property
    def sample(self) -> list[int]:
        """Numbers of the chunks that give a first picture."""
        places = np.linspace(0, len(self.chunks) - 1, SAMPLED) if self.chunks else np.empty(0)
        numbers: list[int] = np.unique(places.astype(int)).tolist()
        return numbers

    def rows_of(self, numbers: Iterable[int]) -> dict[str, Rows]:
        """Return the rows of several chunks together, by topic; they are not kept."""
        by_topic: dict[str, list[Batch]] = defaultdict(list)
        for number in numbers:
            for batch in self._undamaged(number, self._topics):
                by_topic[batch.topic].append(batch)
        return {name: self.readers[name].read(joined(each)) for name, each in by_topic.items()}

    def messages(self, number: int, topic: str) -> list[Message]:
        """Return the messages of a topic in a chunk; none of a damaged one."""
        return [*messages_of(self._undamaged(number, {topic}))]

    def chunks_between(self, drill: str, start: float, end: float) -> Iterator[int]:
        """Yield the numbers of chunks that may hold what a drill did from ``start`` to ``end`` [s].

        Times are since the bag began. It reads some chunks to find the others.
        """
        for number in self.chunks_from(drill, start):
            times = self.span(drill, number)
            if times is not None and times[0] > end + LATE:
                return
            yield number

    def chunks_from(self, drill: str, time: float, *, back: bool = False) -> Iterator[int]:
        """Yield the numbers of chunks from a time [s] on, to the end or to the beginning."""
        held, end = self._held[drill], partial(self._end, drill)
        if back:
            yield from reversed(held[: bisect_left(held, time + LATE, key=end) + 1])
        else:
            yield from held[bisect_left(held, time - LATE, key=end) :]

    def times(self, topic: str, rows: Rows) -> np.ndarray:
        """Return the times of rows since the bag began [ns]."""
        line = self.time_lines[self.clock(topic)]
        if line is None or not self.readers[topic].stamped:
            return rows.log_times - self.begin
        return rows.stamps - line.offsets(rows.publish_times)

    def offset(self, topic: str, published: int) -> int:
        """Return the stamp of time zero that a message has by its publishing time [ns]."""
        line = self.time_lines[self.clock(topic)]
        return line.offset(published) if line else self.begin

    def series(self, topic: str, columns: Sequence[str], numbers: Iterable[int]) -> np.ndarray:
        """Return times [s] and columns of a topic in some chunks, in order of time: (1 + k, n)."""
        found = [np.empty((1 + len(columns), 0))]
        for number in numbers:
            if (rows := self.rows(number).get(topic)) is not None:
                none = np.full(len(rows.stamps), np.nan)
                values = [rows.values.get(column, none) for column in columns]
                times = self.times(topic, rows)
                each = np.array([times / SECOND, *values])
                found.append(each[:, self.fits(topic, times)])
        series = np.concatenate(found, axis=1)
        return series[:, np.argsort(series[0], kind="stable")]

    def close(self) -> None:
        self.bag.close()

    def _undamaged(self, number: int, topics: set[str]) -> list[Batch]:
        """Return what a chunk holds of some topics; note its damage."""
        chunk = self.chunks[number]
        if chunk.topics.isdisjoint(topics):
            return []
        try:
            return chunk.batches(topics)
        except BagError as error:
            self.damages.setdefault(number, str(error))
            return []

    def _span(self, drill: str, number: int) -> tuple[float, float] | None:
        """Return the first and the last time of a drill in a chunk [s]; None if it has none."""
        found = [self.times(name, rows) for name, rows in self._timed_rows(drill, number)]
        if not found:
            return None
        first, last = min(int(each.min()) for each in found), max(int(each.max()) for each in found)
        return first / SECOND, last / SECOND

    def _end(self, drill: str, number: int) -> float:
        span = self.span(drill, number)
        return span[1] if span else (self.chunks[number].end_time - self.begin) / SECOND

    def _last(self, drill: str) -> float:
        """Return the last time of a drill [s]; 0 without any."""
        spans = (self.span(drill, number) for number in reversed(self._held[drill]))
        return next((span[1] for span in spans if span), 0.0)

    def _usual_end(self, drill: str) -> float:
        """Return how long a namespace without a drill lasts [s]: one wrong stamp does not count."""
        if drill not in self._usual_ends:
            numbers = self._held[drill][-_TOGETHER:]
            found = [self.times(n, rows) for i in numbers for n, rows in self._timed_rows(drill, i)]
            times = np.sort(np.concatenate(found)) if found else np.empty(0)
            low, high = np.quantile(times, (0.05, 0.95)) if len(times) else (0.0, 0.0)
            self._usual_ends[drill] = float(high + (high - low)) / SECOND
        return self._usual_ends[drill]

    def _time_line(self, drill: str) -> StampTimes | None:
        for number in self._held[drill][:SAMPLED]:
            found = [rows for _, rows in self._timed_rows(drill, number)]
            if not self.is_drill(drill):  # another program may have a clock only later
                stamped = [(rows, rows.stamps > 0) for rows in found]
                found = [rows.since(np.argmax(valid)) for rows, valid in stamped if valid.any()]
            if found and self.readers[min(self._timed[drill])].stamped:
                return self._line(drill, min(found, key=lambda rows: int(rows.stamps[0])))
        return None

    def _line(self, drill: str, first: Rows) -> StampTimes:
        """Return the time line of a drill; of one run if the journal does not show its runs."""
        journal, origin = f"{drill}/journal", int(first.stamps[0])
        whole = [RecordedRun(str(self.path), journal, first_origin=origin)]
        try:
            runs = runs_of(self.bag, journal) if journal in self.readers else whole
            return StampTimes(runs, first, self.begin)
        except (BagError, OverflowError, RecordingError) as error:
            self.unknown[drill] = str(error)
            return StampTimes(whole, first, self.begin)

    def _timed_rows(self, drill: str, number: int) -> list[tuple[str, Rows]]:
        """Return what shows the time of a namespace in a chunk, by topic."""
        rows = self.rows(number)
        return [(n, rows[n]) for n in self._timed[drill] & rows.keys() if len(rows[n].stamps)]


class Reading:
    """Reading of a bag into the histories of its drills.

    At first it has a sample. ``look`` reads chunks anywhere in the bag, ``read_next`` the others.
    """

    def __init__(self, recording: RecordedBag, histories: Mapping[str, History]) -> None:
        self._recording, self._histories = recording, histories
        self._read: set[int] = set()  # numbers of chunks
        self._next = iter(range(len(recording.chunks)))
        self._until = 0.0  # time up to which all chunks were read [s]
        self._seen = 0.0  # latest time of what was read [s]
        self.unlisted = 0  # messages of faults beyond ``MOST_FAULTS``
        self.outside = Counter[str]()  # messages by topic, whose times the run does not have
        last = recording.rows(len(recording.chunks) - 1) if recording.chunks else {}
        expected = max(recording.bag.duration / SECOND, 1e-3)
        names = [signal.name for signal in recording.signals]
        fitting = MEMORY // (_BIN_SIZE * max(1, len(names)))
        count = min(BINS, max(_LEAST_BINS, 2 ** int(math.log2(fitting))))
        end = self._end_of(last)
        # Stamps may fall while log times rise: the last chunk is then before the first one.
        self.bins = Bins(names, (end if end > 0.0 else expected) * _SPARE / count, count)
        for history in histories.values():
            history.clear([self.bins])
            history.time = expected
        self._add_entries()
        self._add_faults()
        self.look(recording.sample)

    @property
    def complete(self) -> bool:
        return len(self._read) == len(self._recording.chunks)

    @property
    def share(self) -> float:
        """Part of the bag that was read, from 0 to 1; 1 only if all of it was."""
        chunks = len(self._recording.chunks)
        return 1.0 if self.complete else min(len(self._read) / chunks, 0.999)

    def look(self, numbers: Iterable[int]) -> None:
        """Read these chunks now, if they were not read yet."""
        for number in [] if self.complete else {*numbers} - self._read:
            self._add([number], self._recording.rows(number))

    def read_next(self) -> bool:
        """Read the next few chunks; return whether there were any."""
        left = (number for number in self._next if number not in self._read)
        if numbers := [*itertools.islice(left, _TOGETHER)]:
            found = self._recording.rows_of(numbers)
            self._until = max(self._until, self._end_of(found))
            self._add(numbers, found)
        return bool(numbers)

    def gaps(self) -> list[tuple[float, float]]:
        """Return where no signal has messages for much longer than usual, from and to [s].

        Of an incomplete reading it returns nothing.
        """
        return gaps_of(self.bins.used(), self.bins.width) if self.complete else []

    def _add(self, numbers: Iterable[int], found: Mapping[str, Rows]) -> None:
        """Add the rows of chunks."""
        recording = self._recording
        for topic, rows in found.items():
            if len(rows.stamps):
                times = recording.times(topic, rows)
                fits = recording.fits(topic, times)
                early = _is_own(recording.readers[topic]) & (times < 0)  # latched before the bag
                self.outside[topic] += int((~fits & ~early).sum())
                times, values = times[fits], {k: v[fits] for k, v in rows.values.items()}
                latest = float(times.max(initial=0)) / SECOND
                self._seen = min(max(self._seen, latest), recording.end)
                self._histories[recording.clock(topic)].add(Batch(topic, times, values))
        self._read.update(numbers)
        for history in self._histories.values():
            history.time = self._seen or history.time
            history.known = math.inf if self.complete else self._until
            sampled = min(SAMPLED, len(recording.chunks))
            history.samples = sampled / max(history.time or 0.0, 1e-9)

    def _end_of(self, found: Mapping[str, Rows]) -> float:
        """Return the greatest time of some rows [s]; 0 without any."""
        times = [self._recording.times(topic, rows) for topic, rows in found.items()]
        times = [t[self._recording.fits(n, t)] for n, t in zip(found, times, strict=True)]
        latest = max((float(each.max()) / SECOND for each in times if len(each)), default=0.0)
        return min(latest, self._recording.end)

    def _add_entries(self) -> None:
        for drill, line in self._recording.time_lines.items():
            for run, shift in zip(line.runs, line.shifts, strict=True) if line else ():
                for entry, *_ in run.entries:
                    time = (entry.time + shift) / SECOND
                    self._histories[drill].add_entry(time, entry.kind, entry.content)

    def _add_faults(self) -> None:
        recording = self._recording
        topics = {name for name, each in recording.readers.items() if each.type == FAULTS_TYPE}
        with suppress(BagError):  # what comes before the damage is shown
            messages = recording.bag.messages(topics) if topics else iter(())
            for message in itertools.islice(messages, MOST_FAULTS):
                history = self._histories[drill := recording.clock(message.topic)]
                line = recording.time_lines[drill]
                run = line.number(message.publish_time) if line else 0
                try:
                    decoded = recording.readers[message.topic].codec.decode(message.data)
                    origin = recording.offset(message.topic, message.publish_time)
                    history.add_faults(run, decoded.faults, origin)
                # Another type of the same name, or another program wrote it.
                except (AttributeError, BagError, TypeError, ValueError):
                    history.unlisted += 1
            self.unlisted = sum(1 for _ in messages)
