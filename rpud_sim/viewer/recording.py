"""Open bag: its signals, its time lines, its chunks, and how it is read into histories."""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

import rpud_sim.bag
from rpud_sim.bag import BagChunk, BagError, BagFormatError, BagReader
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.batch import Batch, joined
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.runs import RecordedRun, by_run, drill_namespaces, runs_of
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.viewer.bins import Bins, gaps_of
from rpud_sim.viewer.history import History, is_foreign, namespace
from rpud_sim.viewer.topic_reader import TopicReader

MOST_SIGNALS, MOST_TOPICS = 120, 100  # signals of a bag, and topics with signals
OURS = "rpud_msgs/"  # signals of these types come first where a bag has too many
TRAJECTORY_TYPE, STATUS_TYPE = TOPICS["trajectory"].type, TOPICS["status"].type
FAULTS_TYPE = TOPICS["faults"].type
BINS = 2**17  # greatest number of bins of a signal
MEMORY = 256 * 2**20  # greatest size of the bins of all signals [bytes]
MOST_FAULTS = 10_000  # messages of faults that are read; further ones are counted

SAMPLED = 48  # chunks that are read before the page is complete
LATE = 0.5  # longest time from the stamp of a message to a stamp that was logged before it [s]

_KEPT = 96  # chunks whose rows are kept
_LEAST_BINS = 2**10
_SHORTEST_BIN = 1e-3  # that a short bag needs [s]
_BIN_SIZE = 32  # bytes
_TOGETHER = 16  # chunks that are read together
_SPARE = 1.02  # of the time, for what is later than the last log time


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


class TimeLine:
    """Runs of a drill in a row: each begins where the one before ended.

    Time is simulation time since a bag began [ns], which stops during a pause. Of the first message
    stamp and publishing time are known, and how much later than the bag it was logged [ns].
    """

    def __init__(self, runs: Sequence[RecordedRun], stamp: int, published: int, late: int) -> None:
        if (start := runs[0].window[0]) > published:  # of a run whose beginning the bag lacks
            unknown = RecordedRun(runs[0].path, runs[0].journal, first_origin=stamp)
            runs = [replace(unknown, window=(0, start - 1), end=start - published), *runs]
        first, *later = (run for run in runs if run.window[1] >= published)
        self.runs = [replace(first, window=(-(2**63), first.window[1])), *later]
        self.starts: list[int] = []  # of each run, in the time of the bag [ns]
        begun = stamp - int(first.origins(np.array([published]))[0])
        end = late if late > SECOND else 0  # a drill may begin after its bag
        for run in self.runs:
            # A forged origin is an OverflowError.
            run.origins(np.array([each.publish_time for each in run.entries])).astype(np.int64)
            self.starts.append(end - begun)
            end += max(run.end - begun, 0)
            begun = 0

    def place(self, batch: Batch) -> Iterator[Batch]:
        """Yield messages; a batch is of one run and has one origin in this time."""
        for part in by_run(self.runs[1:], [batch]):
            for own in self.runs[part.run].of([part]):
                yield replace(own, run=part.run, origin=own.origin - self.starts[part.run])


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
            self._drills = drill_namespaces(self.bag)
            self.chunks: list[BagChunk] = self.bag.chunks()
            self._prepare()
        except BaseException:
            self.bag.close()
            raise

    def _prepare(self) -> None:
        self.signals = [each for reader in self.readers.values() for each in reader.signals]
        self.damages: dict[int, str] = {}  # reasons why chunks are not read, by their numbers
        self.unknown: dict[str, str] = {}  # why the runs of drills are not known, by namespace
        # Signals of a chunk, none of a damaged one; those that were used last are kept.
        self.signals_in = lru_cache(_KEPT)(lambda number: self.read([number]))
        self.time_lines: dict[str, TimeLine] = {}  # of namespaces with stamps
        # Topics that show the time of each namespace. Blocks are logged long after their stamps,
        # and latched messages may be old: they do so only where there is nothing else.
        self._timed: dict[str, set[str]] = {}
        for drill in {*map(namespace, self.readers)} or {""}:  # nothing is readable
            here = [each for name, each in self.readers.items() if namespace(name) == drill]
            own = [each for each in here if each.is_own or not self.is_drill(drill)]
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
        # Whose clock a namespace has: one within a drill's has the drill's clock.
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
        self.clocks = [*self._held]  # namespaces with times of their own
        lines = {drill: self._time_line(drill) for drill in self.clocks}
        self.time_lines = {drill: line for drill, line in lines.items() if line}
        self.end = max(map(self._last, drills), default=math.inf)  # of the drills [s]

    def is_drill(self, drill: str) -> bool:
        """Whether a namespace has topics of a drill."""
        return drill in self._drills

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

    def read(self, numbers: Iterable[int]) -> list[Batch]:
        """Return the signals of several chunks at times since the bag began; they are not kept."""
        placed = self.batches(numbers, self._topics)
        return [found for each in placed if len(found := self.readers[each.topic].read(each))]

    def batches(self, numbers: Iterable[int], topics: set[str]) -> Iterator[Batch]:
        """Yield what chunks hold of topics, in the order of log times within each topic.

        Damaged chunks hold nothing. The origin of a batch is the stamp of the bag's beginning.
        """
        by_topic: dict[str, list[Batch]] = defaultdict(list)
        for number in numbers:
            for batch in self._undamaged(number, topics):
                by_topic[batch.topic].append(batch)
        for parts in by_topic.values():
            whole = joined(parts)
            yield from self.place(whole.part(np.argsort(whole.log_times, kind="stable")))

    def place(self, batch: Batch) -> Iterator[Batch]:
        """Yield messages of a topic; a batch is of one run, and has one origin."""
        line = self.time_lines.get(self.clock(batch.topic))
        if line is None or not self.readers[batch.topic].stamped:
            return iter((replace(batch, origin=self.begin),))
        return line.place(batch)

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

    def series(self, topic: str, columns: Sequence[str], numbers: Iterable[int]) -> np.ndarray:
        """Return times [s] and columns of a topic in some chunks, in order of time: (1 + k, n)."""
        found = [np.empty((1 + len(columns), 0))]
        for batch in self._of(topic, numbers):
            none = np.full(len(batch), np.nan)
            values = [batch.fields.get(column, none) for column in columns]
            each = np.array([batch.times / SECOND, *values])
            found.append(each[:, self.fits(topic, batch.times)])
        series = np.concatenate(found, axis=1)
        return series[:, np.argsort(series[0], kind="stable")]

    def close(self) -> None:
        self.bag.close()

    def _of(self, topic: str, numbers: Iterable[int]) -> Iterator[Batch]:
        return (each for n in numbers for each in self.signals_in(n) if each.topic == topic)

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
        found = [each.times for each in self.signals_in(number) if each.topic in self._timed[drill]]
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
            found = [
                each.times
                for number in self._held[drill][-_TOGETHER:]
                for each in self.signals_in(number)
                if each.topic in self._timed[drill]
            ]
            times = np.sort(np.concatenate(found)) if found else np.empty(0)
            low, high = np.quantile(times, (0.05, 0.95)) if len(times) else (0.0, 0.0)
            self._usual_ends[drill] = float(high + (high - low)) / SECOND
        return self._usual_ends[drill]

    def _time_line(self, drill: str) -> TimeLine | None:
        """Return the time line of a namespace; None without stamps, where log times count."""
        if not any(self.readers[topic].stamped for topic in self._timed[drill]):
            return None
        for number in self._held[drill][:SAMPLED]:
            firsts = []  # stamps, with publishing and log times
            for batch in self.batches([number], self._timed[drill]):
                found = self.readers[batch.topic].read(batch)
                stamps = found.times + found.origin
                # Another program may have a clock only later.
                valid = stamps > 0 if not self.is_drill(drill) else np.ones(len(stamps), bool)
                if valid.any():
                    each = int(np.argmax(valid))
                    firsts.append((stamps[each], found.publish_times[each], found.log_times[each]))
            if firsts:
                stamp, published, logged = map(int, min(firsts))
                return self._line(drill, stamp, published, logged - self.begin)
        return None

    def _line(self, drill: str, *first: int) -> TimeLine:
        """Return the time line of a drill; of one run if the journal does not show its runs."""
        journal = f"{drill}/journal"
        whole = [RecordedRun(str(self.path), journal, first_origin=first[0])]
        try:
            runs = runs_of(self.bag, journal) if journal in self.readers else whole
            return TimeLine(runs, *first)
        except (BagError, OverflowError, RecordingError) as error:
            self.unknown[drill] = str(error)
            return TimeLine(whole, *first)


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
        last = recording.signals_in(len(recording.chunks) - 1) if recording.chunks else []
        expected = max(recording.bag.duration / SECOND, 1e-3)
        names = [signal.name for signal in recording.signals]
        fitting = MEMORY // (_BIN_SIZE * max(1, len(names)))
        end = self._end_of(last)
        # Stamps may fall while log times rise: the last chunk is then before the first one.
        span = (end if end > 0.0 else expected) * _SPARE
        wanted = 2 ** math.ceil(math.log2(max(span / _SHORTEST_BIN, 1.0)))
        count = min(BINS, max(_LEAST_BINS, min(wanted, 2 ** int(math.log2(fitting)))))
        self.bins = Bins(names, span / count, count)
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
            self._add([number], self._recording.signals_in(number))

    def read_next(self) -> bool:
        """Read the next few chunks; return whether there were any."""
        left = (number for number in self._next if number not in self._read)
        if numbers := [*itertools.islice(left, _TOGETHER)]:
            found = self._recording.read(numbers)
            self._until = max(self._until, self._end_of(found))
            self._add(numbers, found)
        return bool(numbers)

    def gaps(self) -> list[tuple[float, float]]:
        """Return where no signal has messages for much longer than usual, from and to [s].

        Of an incomplete reading it returns nothing.
        """
        return gaps_of(self.bins.used(), self.bins.width) if self.complete else []

    def _add(self, numbers: Iterable[int], found: Iterable[Batch]) -> None:
        """Add the signals of chunks."""
        recording = self._recording
        for batch in found:
            topic, times = batch.topic, batch.times
            fits = recording.fits(topic, times)
            early = recording.readers[topic].is_own & (times < 0)  # latched before the bag
            self.outside[topic] += int((~fits & ~early).sum())
            values = {name: each[fits] for name, each in batch.fields.items()}
            latest = float(times[fits].max(initial=0)) / SECOND
            self._seen = min(max(self._seen, latest), recording.end)
            history = self._histories[recording.clock(topic)]
            history.add(replace(batch, fields=values, times=times[fits]))
        self._read.update(numbers)
        for history in self._histories.values():
            history.time = self._seen or history.time
            history.known = math.inf if self.complete else self._until
            sampled = min(SAMPLED, len(recording.chunks))
            history.samples = sampled / max(history.time or 0.0, 1e-9)

    def _end_of(self, found: Iterable[Batch]) -> float:
        """Return the greatest time of some signals [s]; 0 without any."""
        fitting = (each.times[self._recording.fits(each.topic, each.times)] for each in found)
        latest = max((float(times.max(initial=0)) / SECOND for times in fitting), default=0.0)
        return min(latest, self._recording.end)

    def _add_entries(self) -> None:
        for drill, line in self._recording.time_lines.items():
            for run, start in zip(line.runs, line.starts, strict=True):
                for entry, *_ in run.entries:
                    time = (entry.time + start) / SECOND
                    self._histories[drill].add_entry(time, entry.kind, entry.content)

    def _add_faults(self) -> None:
        recording = self._recording
        topics = {name for name, each in recording.readers.items() if each.type == FAULTS_TYPE}
        left = MOST_FAULTS
        with suppress(BagError):  # what comes before the damage is shown
            for batch in recording.bag.batches(topics) if topics else ():
                for part in recording.place(batch):
                    for number in range(min(len(part), left)):
                        self._add_list(part, number)
                    self.unlisted += max(0, len(part) - left)
                    left = max(0, left - len(part))

    def _add_list(self, batch: Batch, number: int) -> None:
        """Add a list of faults."""
        recording = self._recording
        history = self._histories[recording.clock(batch.topic)]
        try:
            decoded = recording.readers[batch.topic].codec.decode(batch.message(number))
            history.add_faults(batch.run, decoded.faults, batch.origin)
        # Another type of the same name, or another program wrote it.
        except (AttributeError, BagError, TypeError, ValueError):
            history.unlisted += 1
