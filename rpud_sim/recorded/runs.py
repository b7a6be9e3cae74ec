"""Runs of a drill in a bag: the plan of each, and which messages belong to it.

A message belongs to the last run that had begun when it was published.
"""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.columns import FieldReader, Kind, columns_of
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.metadata import MANIFEST_RECORD, Manifest, manifest_from_record
from rpud_sim.foundation.quantities import suggestion
from rpud_sim.foundation.time import NEVER, SECOND, join_seconds
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.output import Damages
from rpud_sim.simulation.batch import Batch
from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.changes import ChangeError
from rpud_sim.simulation.journal import JournalEntry
from rpud_sim.simulation.plan import Plan
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.topics import PROVED, TOPICS
from rpud_sim.simulation.versions import engine_of, other_engine

JOURNAL = TOPICS["journal"].type

_MOST_ENTRIES = 2_000_000  # of a journal, twice as many as a drill keeps
_END_LENGTH = 4 * SECOND  # end of a bag that shows how far a drill came [ns]
_BEYOND = 60 * SECOND  # of an entry after all messages: topics may be silent so long [ns]
_EARLIEST, _LATEST = -(2**62), 2**62  # beyond all times [ns]
_NO_COMMANDS = ("begin", "origin", "stop", "flush", "end")


class UnverifiableError(RecordingError):
    """Bag that can be neither proved nor disproved."""


class RecordedEntry(NamedTuple):
    """Entry of a journal in a bag."""

    entry: JournalEntry
    stamp: int  # of its header [ns]
    frame: str  # of its header
    log_time: int  # [ns]
    publish_time: int  # [ns]


@dataclass(frozen=True)
class RecordedRun:
    """Run of a drill in a bag, from its beginning to the next one."""

    path: str  # of the bag
    journal: str  # name of the journal's topic, also where the bag holds none
    number: int = 1  # of the run, from 1
    runs: int = 1  # number of runs of this drill in the bag
    entries: tuple[RecordedEntry, ...] = ()  # of the run; empty without a journal
    # Publishing times between which its messages lie, both included [ns].
    window: tuple[int, int] = (_EARLIEST, _LATEST)
    end: int = 0  # simulation time up to which the journal is complete [ns]
    torn: str = ""  # why it is not known how the run went on; empty if it is
    first_origin: int = 0  # stamp of simulation time zero where the journal has none [ns]
    manifest: Manifest | None = None
    warnings: tuple[str, ...] = ()  # what is not known of it, one line each

    @property
    def prefix(self) -> str:
        """Namespace of the drill, with a slash at its end."""
        return self.journal[: -len("journal")]

    @property
    def namespace(self) -> str:
        return self.prefix[:-1]

    def topic(self, name: str) -> str:
        return self.prefix + name

    @property
    def begun(self) -> int:
        """Publishing time of the run's beginning [ns]."""
        return self.entries[0].publish_time

    @property
    def closed(self) -> bool:
        """Whether the run ended with its last entry."""
        last = self.entries[-1].entry.kind if self.entries else ""
        return last == "end" or (last == "flush" and self.number < self.runs)

    @cached_property
    def beginning(self) -> Mapping[str, Any]:
        """Content of the entry ``begin``; empty without a journal."""
        return self.entries[0].entry.content if self.entries else {}

    @cached_property
    def plan(self) -> Plan:
        """The plan that the journal carried out; an unusable entry raises a RecordingError."""
        if reason := other_engine(self.beginning):
            raise RecordingError(f"{self.journal}: {reason}")
        try:
            return Plan.of(each.entry for each in self.entries)
        except ChangeError as error:
            raise RecordingError(f"{self.journal}: {error}") from error

    @cached_property
    def parameters(self) -> dict[str, Any]:
        """Parameters at the beginning, and the initial phase, by name."""
        if not self.entries:
            return dict(self.manifest.parameters) if self.manifest else {}
        held = self.beginning.get("parameters")
        phase = {n: self.beginning[n] for n in ("initial_phase",) if n in self.beginning}
        return {**(held if isinstance(held, dict) else {}), **phase}

    @property
    def versions(self) -> dict[str, str]:
        """Versions of what computed the run, by name."""
        found = dict(self.manifest.versions) if self.manifest else {}
        made_by = self.beginning.get("made_by")
        found |= made_by if isinstance(made_by, dict) else {}
        if self.beginning:
            found["engine"] = engine_of(self.beginning)
        return {str(name)[:80]: f"{value!s:.200}" for name, value in found.items()}

    @property
    def seed(self) -> int | None:
        """Seed of all random numbers; None if it is unknown."""
        seed = self.beginning.get("seed", self.parameters.get("seed"))
        return seed if isinstance(seed, int) else self.manifest.seed if self.manifest else None

    @property
    def commands(self) -> tuple[JournalEntry, ...]:
        """Journal entries of commands, faults and changed parameters, in order."""
        entries = (each.entry for each in self.entries)
        return tuple(entry for entry in entries if entry.kind not in _NO_COMMANDS)

    @cached_property
    def _origins(self) -> tuple[np.ndarray, np.ndarray]:
        """Publishing times of origins, and the origins [ns]."""
        found = [each for each in self.entries if each.entry.kind == "origin"]
        origins = [int(each.entry.content["origin"]) for each in found] or [self.first_origin]
        times = [each.publish_time for each in found] or [_EARLIEST]
        return np.array(times), np.array(origins)

    @property
    def origin(self) -> int:
        """Last stamp of simulation time zero [ns]."""
        return int(self._origins[1][-1])

    def origins(self, publish_times: np.ndarray) -> np.ndarray:
        """Return the stamps of simulation time zero that messages have [ns], shape (n,)."""
        times, origins = self._origins
        return origins[np.maximum(np.searchsorted(times, publish_times, "right") - 1, 0)]

    def holds(self, publish_times: np.ndarray) -> np.ndarray:
        """Return whether messages belong to the run, by their publishing times [ns], (n,)."""
        first, last = self.window
        return (publish_times >= first) & (publish_times <= last)

    def computed(self, until: int, wanted: Collection[str]) -> Iterator[Batch]:
        """Compute the messages of topics up to a simulation time [ns]; the origin is as recorded.

        A change that cannot be carried out raises a RecordingError.
        """
        run = Run(self.plan, None, wanted.__contains__)
        try:
            for batch in run.advance_to(until):
                if batch.topic in wanted:
                    yield batch
        except ChangeError as error:
            raise RecordingError(f"{self.journal}: {error}") from error


@cache
def installed_codec(type_name: str) -> Codec:
    """Return the codec of a type as it is installed here; making one takes long."""
    return Codec(type_name, find_definition(type_name))


def held_journals(bag: BagReader) -> dict[str, TopicSummary]:
    """Return the journals that have messages, by name, at least one."""
    held = {s.topic.name: s for s in bag.topics if s.topic.type == JOURNAL and s.message_count}
    if not held:
        raise UnverifiableError(
            f"{bag.path} holds no journal; record the topic journal, or all of the namespace"
        )
    return held


def runs_of(
    bag: BagReader, topic: str | None = None, damages: Damages | None = None
) -> list[RecordedRun]:
    """Return the runs of a drill in a bag, at least one.

    ``topic`` chooses one of several journals. An UnverifiableError says why runs cannot be told.
    """
    found = held_journals(bag)
    names = ", ".join(found)
    if topic is None and len(found) > 1:
        raise RecordingError(f"{bag.path} holds several journals: choose with --topic of {names}")
    if topic is not None and topic not in found:
        raise RecordingError(
            f"{bag.path} holds no journal named {topic}, but {names}{suggestion(topic, found)}"
        )
    return _Journal(bag, found[topic or names]).runs(damages or Damages(bag))


def run_of(
    bag: BagReader, number: int = 1, topic: str | None = None, damages: Damages | None = None
) -> RecordedRun:
    """Return a run of a bag by its number, from 1."""
    runs = runs_of(bag, topic, damages)
    if not 1 <= number <= len(runs):
        raise RecordingError(
            f"--run = {number} is outside its range [1, {len(runs)}]: resets begin new ones"
        )
    return runs[number - 1]


def find_drill(
    bag: BagReader, damages: Damages, namespace: str | None = None, run: int | None = None
) -> RecordedRun:
    """Return a run of a drill in a bag: by default of the only drill, and the first.

    Without a journal that shows its runs, the whole bag is one.
    """
    chosen = _choose(bag, namespace)
    journal = f"{chosen}/journal"
    reason = f"{bag.path} holds no journal: commands are unknown, and a reset is not seen"
    if any(s.topic.name == journal and s.message_count for s in bag.readable_topics):
        try:
            found = run_of(bag, run or 1, journal, damages)
        except RecordingError as error:
            reason = f"{bag.path}: {error}"
            if run not in (None, 1):
                raise RecordingError(reason) from error
        else:
            several = (
                f"{bag.path} holds {found.runs} runs: the first is compared; choose with --run"
            )
            warnings = (found.torn, several if found.runs > 1 and run is None else "")
            return replace(found, warnings=tuple(filter(None, warnings)))
    elif run not in (None, 1):
        raise RecordingError(f"{bag.path} holds no journal, so there is no run {run}")
    shown = recorded_progress(bag, progress_readers(bag, f"{chosen}/"), 0, SECOND)
    origin = min((int(found["stamp"].min()) for _, found in shown), default=bag.start_time)
    manifest = find_manifest(bag, chosen, damages)
    return RecordedRun(
        os.fspath(bag.path), journal, first_origin=origin, manifest=manifest, warnings=(reason,)
    )


def _choose(bag: BagReader, wanted: str | None) -> str:
    """Return the namespace of a drill in a bag."""
    spaces = set()
    for summary in bag.readable_topics:
        space, _, name = summary.topic.name.rpartition("/")
        known = TOPICS.get(name)
        own = known is not None and known.type == summary.topic.type
        if own and summary.topic.type.startswith("rpud_msgs/") and summary.message_count:
            spaces.add(space)
    found = sorted(spaces)
    if not found:
        raise RecordingError(f"{bag.path} holds no topic of a drill")
    names = ", ".join(f"{name:.80}" or "/" for name in found)
    if wanted is None:
        if len(found) > 1:
            raise RecordingError(f"{bag.path} holds several drills: choose --namespace of {names}")
        return found[0]
    space = "" if wanted == "/" else f"/{wanted.strip('/')}"
    if space not in found:
        raise RecordingError(
            f"{bag.path} holds no drill in {wanted!r:.80}, but in {names}{suggestion(space, found)}"
        )
    return space


def find_manifest(bag: BagReader, namespace: str, damages: Damages) -> Manifest | None:
    """Return the manifest of a drill in a bag; None if there is none, or if it is not clear."""
    found = []
    for record in damages.records(bag, MANIFEST_RECORD):
        try:
            found.append(manifest_from_record(record))
        except BagFormatError as error:
            damages.add_record(MANIFEST_RECORD, error)
    own = [m for m in found if m.node.rpartition("/")[0] == namespace and m.node]
    return next(iter((*own, *(found if len(found) == 1 else ()))), None)


class _Journal:
    """Journal in a bag; the other messages of its drill bound how long it is run again."""

    def __init__(self, bag: BagReader, summary: TopicSummary) -> None:
        self.name = summary.topic.name
        self._bag = bag
        self._codec = installed_codec(JOURNAL)
        self._progress = progress_readers(bag, self.name[: -len("journal")])
        if summary.topic.type_hash not in ("", find_type_hash(JOURNAL)):
            try:  # every bag's journal is read
                self._codec = Codec(JOURNAL, summary.definition or "")
            except BagFormatError as error:
                raise UnverifiableError(f"{self.name}: {error}") from None

    def runs(self, damages: Damages) -> list[RecordedRun]:
        groups: list[tuple[list[RecordedEntry], str]] = []
        orphans = 0
        entries: list[RecordedEntry] = []
        gap = ""
        for each in self._entries():
            if each.entry.kind == "begin":
                entries, gap = [each], ""
                groups.append((entries, ""))
            elif not groups:
                orphans += 1
            elif not gap:
                last = entries[-1].entry.sequence
                if each.entry.sequence == last + 1:
                    entries.append(each)
                    continue
                gap = f"entries {last + 1} to {each.entry.sequence - 1} of the journal are missing"
                groups[-1] = (entries, gap)
        if not groups:
            raise UnverifiableError(
                f"cannot be decided: {orphans} entries of {self.name} have no beginning; their "
                "recorder came too late, and no recorder of this package asked the drill for it"
            )
        starts = [entries[0].publish_time for entries, _ in groups]
        timed = any(e.publish_time != e.log_time for entries, _ in groups for e in entries)
        if len(groups) > 1 and not (timed and all(np.diff(starts) > 0)):
            raise UnverifiableError(
                f"cannot be decided: the bag holds {len(groups)} runs, and no publishing times "
                "that show which of them a message belongs to"
            )
        edges = [_EARLIEST, *starts[1:], _LATEST + 1]
        if orphans or groups[0][0][0].entry.sequence:  # there was a run before
            edges[0] = starts[0]
        manifest = find_manifest(self._bag, self.name.rpartition("/")[0], damages)
        found = [
            RecordedRun(
                os.fspath(self._bag.path),
                self.name,
                number,
                len(groups),
                tuple(entries),
                (edges[number - 1], edges[number] - 1),
                entries[-1].entry.time,
                gap and f"{self.name}: {gap}",
                manifest=manifest,
            )
            for number, (entries, gap) in enumerate(groups, 1)
        ]
        for run in found:
            self._check(run)
        return [run if run.closed or run.torn else self._up_to_its_end(run) for run in found]

    def _entries(self) -> Iterator[RecordedEntry]:
        """Yield the entries in the order of publishing, each once."""
        found: list[RecordedEntry] = []
        for message in self._bag.messages({self.name}):
            found.append(self._decode(message))
            if len(found) > _MOST_ENTRIES:
                raise UnverifiableError(f"{self.name} has more than {_MOST_ENTRIES} entries")
        # A recorder that asked for entries has them later than others, or twice.
        found.sort(key=lambda each: (each.publish_time, each.entry.sequence))
        for _, same in groupby(found, key=lambda each: (each.publish_time, each.entry.sequence)):
            first, *others = same
            if any(each.entry.text != first.entry.text for each in others):
                raise UnverifiableError(
                    f"entry {first.entry.sequence} of the journal is there twice, with other "
                    "content"
                )
            yield first

    def _decode(self, message: Any) -> RecordedEntry:
        try:
            fields = self._codec.decode(message.data)
            content = json.loads(fields.content)
            time = content.pop("time")
            if type(time) is not int or not 0 <= time < NEVER:
                raise ValueError(f"time = {time!r:.40}")
            if fields.kind == "origin" and type(content["origin"]) is not int:
                raise ValueError(f"origin = {content['origin']!r:.40}")
            entry = JournalEntry(int(fields.sequence), time, str(fields.kind), content)
            stamp = join_seconds(fields.header.stamp.sec, fields.header.stamp.nanosec)
            frame = str(fields.header.frame_id)
            return RecordedEntry(entry, stamp, frame, message.log_time, message.publish_time)
        except (BagFormatError, AttributeError, LookupError, RecursionError, ValueError) as error:
            reason = " ".join(f"{error!r:.120}".split())
            text = f"an entry of the journal cannot be understood: {reason}"
            raise UnverifiableError(text) from None

    def _check(self, run: RecordedRun) -> None:
        """Raise an UnverifiableError at an entry of a time that nothing shows.

        It would be run again without an end.
        """
        origin: int | None = None
        for each in run.entries:
            entry = each.entry
            if entry.kind == "origin":
                origin = int(entry.content["origin"])
            elif origin is None:
                origin = each.stamp - entry.time
            late = entry.kind == "begin" and entry.time > 0
            if late or not self._shows(origin, entry.time):
                raise UnverifiableError(
                    f"entry {entry.sequence} of the journal ({entry.kind:.20}) is of "
                    f"{entry.time / SECOND:.9g} s, and no other message shows that time"
                )

    def _shows(self, origin: int, time: int) -> bool:
        """Whether messages show a simulation time; log times have to where there are none [ns]."""
        if origin + time <= self._latest_at_end + _BEYOND:
            return True
        if self._latest is not None:
            return origin + time <= self._latest + _BEYOND
        return time <= self._bag.duration + _BEYOND

    def _up_to_its_end(self, run: RecordedRun) -> RecordedRun:
        """Return a run that was not closed with the time that it reached, at the end of a block."""
        if wrong := wrong_header(run.entries):
            raise RecordingError(
                f"{self.name}: {wrong.field} of entry {wrong.recorded.entry.sequence} is "
                f"{wrong.value}, not {wrong.right}"
            )
        start = self._end_start if run.number == run.runs else 0
        stamps = _latest(
            (topic, own)
            for topic, found in recorded_progress(self._bag, self._progress, start)
            if len(own := found[run.holds(found["published"])])
        )
        try:
            rate = int(run.beginning["parameters"]["telemetry_rate"])
            reached = max(run.end, agreed(stamps) - run.origin if stamps else 0)
            end = boundary(boundaries_until(reached, rate), rate)
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            text = f"{self.name} cannot be understood: {error!r:.100}"
            raise RecordingError(text) from None
        return replace(run, end=max(run.end, end))

    @property
    def _end_start(self) -> int:
        return max(0, self._bag.duration - _END_LENGTH)

    @cached_property
    def _latest_at_end(self) -> int:
        return agreed(_latest(recorded_progress(self._bag, self._progress, self._end_start)))

    @cached_property
    def _latest(self) -> int | None:
        """Latest stamp of the whole bag, which need not be at its end; None without any [ns]."""
        found = _latest(recorded_progress(self._bag, self._progress, 0))
        return agreed(found) if found else None


def _latest(shown: Iterable[tuple[str, np.ndarray]]) -> list[int]:
    """Return the greatest stamp of each topic [ns]."""
    found: dict[str, int] = {}
    for topic, progress in shown:
        found[topic] = max(int(progress["stamp"].max()), found.get(topic, 0))
    return [*found.values()]


def agreed(stamps: Iterable[int]) -> int:
    """Return the greatest stamp that two topics reach, so that one altered stamp changes nothing.

    It is that of the only topic if there is no other, and 0 without any [ns].
    """
    return min(sorted(stamps)[-2:], default=0)


class WrongHeader(NamedTuple):
    """Entry whose header does not fit."""

    recorded: RecordedEntry
    field: str  # that does not fit
    value: str
    right: str  # what it should be


def wrong_header(entries: Sequence[RecordedEntry]) -> WrongHeader | None:
    """Return the first entry of a run whose header does not fit; None if all do.

    The stamp is the entry's time under an origin in force: the one before it, or one that another
    entry of the same time sets, for they are published together.
    """
    before: list[int] = []
    frame = TOPICS["journal"].frame
    for time, group in groupby(entries, lambda each: each.entry.time):
        together = list(group)
        origins = [e.entry.content["origin"] for e in together if e.entry.kind == "origin"]
        for each in together:
            allowed = origins if each.entry.kind == "origin" else [*before, *origins]
            if each.frame != frame:
                return WrongHeader(each, "header.frame_id", f"{each.frame!r:.80}", f"{frame!r}")
            if allowed and each.stamp - time not in allowed:
                right = str(time + allowed[-1])
                return WrongHeader(each, "header.stamp", str(each.stamp), right)
        before = origins[-1:] or before
    return None


# Progress of a drill at one message. Times are in nanoseconds. Only a status says whether the drill
# stopped, and counts the journal's entries so far: -1 elsewhere.
PROGRESS = np.dtype(
    [
        ("log_time", np.int64),
        ("published", np.int64),
        ("stamp", np.int64),
        ("stopped", np.bool_),
        ("entries", np.int64),
    ]
)
_STOPPED = "stopped"  # the STATE constant of rpud_msgs/Status

ProgressReaders = Mapping[str, tuple[Mapping[str, str], FieldReader]]


def progress_readers(bag: BagReader, prefix: str) -> ProgressReaders:
    """Return readers of a drill's topics that show its progress, by the names of the topics."""
    found = {}
    for summary in bag.topics:
        topic = summary.topic
        name = topic.name.removeprefix(prefix)
        if topic.name == name or name not in (*PROVED, "status") or not summary.definition:
            continue
        with suppress(BagFormatError):
            own = TOPICS[name].type
            same = (topic.type, topic.type_hash) == (own, find_type_hash(own))
            codec = installed_codec(own) if same else Codec(topic.type, summary.definition)
            wanted = {"header.stamp": Kind.TIME}
            if codec.type == TOPICS["status"].type:
                wanted |= {"state": Kind.TEXT, "journal_entries": Kind.NUMBER}
            columns = [c for c in columns_of(codec, "") if wanted.get(c.attribute) is c.kind]
            names = {column.attribute: column.name for column in columns}
            if "header.stamp" in names:
                found[topic.name] = names, FieldReader(codec, columns)
    return found


def recorded_progress(
    bag: BagReader, readers: ProgressReaders, start: int, duration: int | None = None
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield topics, and ``PROGRESS`` (n,) at some of their messages, those that can be read.

    ``start`` counts from the beginning of the bag [ns].
    """
    for block in bag.batches(readers.keys(), start, duration):
        names, reader = readers[block.topic]
        values = reader.read(block)
        held = {attribute: values.columns[name] for attribute, name in names.items()}
        found = np.zeros(len(values.rows), PROGRESS)
        found["log_time"] = block.log_times[values.rows]
        found["published"] = block.publish_times[values.rows]
        found["stamp"] = held["header.stamp"]
        found["entries"] = -1
        if "state" in held:
            found["stopped"] = held["state"] == _STOPPED
            found["entries"] = held.get("journal_entries", -1)
        if len(found):
            yield block.topic, found
