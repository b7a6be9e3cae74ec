"""Runs of a drill in a bag: the plan of each, and which messages belong to it.

A message belongs to the last run that had begun when it was published.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader
from rpud_sim.bag.metadata import RECORDING_RECORD
from rpud_sim.bag.own_records import MANIFEST_RECORD, Manifest, manifest_from_record
from rpud_sim.foundation.quantities import did_you_mean, joined
from rpud_sim.foundation.terminal import error_text
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.batch import Batch
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.journal import (
    PROGRESS,
    RecordedEntry,
    RecordedJournal,
    UnverifiableError,
    common_stamp,
    held_journals,
    progress_readers,
    recorded_progress,
    within,
    wrong_header,
)
from rpud_sim.recorded.output import SkippedParts
from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.changes import ChangeError
from rpud_sim.simulation.plan import JournalEntry, Plan
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.simulation.versions import engine_of, other_engine

_EARLIEST, _LATEST = -(2**63), 2**63 - 1  # no time is beyond [ns]
_TOPIC_DELAY = 1 * SECOND  # longest delay between topics on their way to a recorder [ns]
_DIGITS = 20  # of a time in nanoseconds, at most
_FIRST_ENGINE = 6  # that this release reads, of release 0.3
_NO_COMMANDS = ("begin", "origin", "stop", "flush", "end")


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
    incomplete: str = ""  # why it is not known how the run continued; empty if it is
    complete_until: int = _LATEST  # publishing time up to which the journal has every entry [ns]
    ends_early: str = ""  # of a run that was not closed: where its journal ends
    computed_until: int = _LATEST  # stamp up to which the bag should hold messages [ns]
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

    def doubt(self, published: int | None = None) -> str:
        """Return why the journal need not explain a message; empty if it has to.

        ``published`` is when it was published [ns]; None is for what the run was from its end on.
        """
        if published is None:
            return self.incomplete
        return "" if published <= self.complete_until else self.incomplete or self.ends_early

    def lacks(self, end: int | None = None) -> str:
        """Return why the journal is not complete up to a simulation time [ns]; empty if it is.

        None is for the end of the run.
        """
        if not self.incomplete or (end is not None and end <= self.end):
            return ""
        return f"the journal is complete up to {self.end / SECOND:.9g} s alone: {self.incomplete}"

    @property
    def ended(self) -> bool:
        """Whether ``end`` is the end of what can be computed: no block may end later."""
        return self.closed or bool(self.incomplete)

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
        return within(publish_times, self.window)

    def of(self, batches: Iterable[Batch]) -> Iterator[Batch]:
        """Yield the messages of the run in a bag; each batch has one origin."""
        for batch in batches:
            held = self.holds(batch.publish_times)
            own = batch if held.all() else batch.part(held)
            if len(own):
                for origin, part in _parts(own, self.origins(own.publish_times)):
                    yield replace(part, run=self.number, origin=origin)

    def computed(self, until: int, wanted: Collection[str]) -> Iterator[Batch]:
        """Compute the messages of topics up to a simulation time [ns]; stamps are as recorded.

        A change that cannot be carried out raises a RecordingError.
        """
        try:
            run = Run(self.plan, None, wanted.__contains__)
            for batch in run.advance_to(until):
                if batch.topic in wanted:
                    yield replace(batch, run=self.number)
        except ChangeError as error:
            raise RecordingError(f"{self.journal}: {error}") from error


def by_run(runs: Sequence[RecordedRun], batches: Iterable[Batch]) -> Iterator[Batch]:
    """Yield batches, each of one run with its number; 0 is before the first of the runs."""
    edges = np.array([run.window[0] for run in runs])
    for batch in batches:
        for run, part in _parts(batch, np.searchsorted(edges, batch.publish_times, "right")):
            yield replace(part, run=run)


def _parts(batch: Batch, values: np.ndarray) -> Iterator[tuple[int, Batch]]:
    """Yield the parts of a batch whose messages have one value, and that."""
    cuts = np.flatnonzero(values[1:] != values[:-1]) + 1
    for first, last in pairwise([0, *cuts.tolist(), len(batch)]):
        yield int(values[first]), batch.part(slice(first, last))


def runs_of(
    bag: BagReader, topic: str | None = None, damages: SkippedParts | None = None
) -> list[RecordedRun]:
    """Return the runs of a drill in a bag, at least one.

    ``topic`` chooses one of several journals. An UnverifiableError explains a failure.
    """
    found = held_journals(bag)
    names = joined(found)
    if topic is None and len(found) > 1:
        raise RecordingError(f"{bag.path} holds several journals: choose with --topic of {names}")
    if topic is not None and topic not in found:
        raise RecordingError(
            f"{bag.path} holds no journal named {topic}{did_you_mean(topic, found)}"
        )
    return _runs(
        bag, RecordedJournal(bag, found[topic or next(iter(found))]), damages or SkippedParts(bag)
    )


def run_of(
    bag: BagReader, number: int = 1, topic: str | None = None, damages: SkippedParts | None = None
) -> RecordedRun:
    """Return a run of a bag by its number, from 1."""
    runs = runs_of(bag, topic, damages)
    if not 1 <= number <= len(runs):
        raise RecordingError(
            f"run = {number} is outside its range [1, {len(runs)}]: resets begin new ones",
            code=2,
        )
    return runs[number - 1]


def find_drill(
    bag: BagReader, damages: SkippedParts, namespace: str | None = None, run: int | None = None
) -> RecordedRun:
    """Return a run of a drill in a bag: by default of the only drill, and the first.

    Without a journal that shows its runs, the whole bag is one.
    """
    chosen = choose_namespace(bag.path, drill_namespaces(bag), namespace)
    journal = f"{chosen}/journal"
    reason = f"{bag.path} holds no journal: commands are unknown, and a reset is not seen"
    if any(s.topic.name == journal and s.message_count for s in bag.readable_topics):
        try:
            found = run_of(bag, run or 1, journal, damages)
        except UnverifiableError as error:
            reason = f"{bag.path}: {error}"
            if run not in (None, 1):
                raise RecordingError(reason) from error
        else:
            several = (
                f"{bag.path} holds {found.runs} runs: the first is compared; choose with --run"
            )
            warnings = (found.doubt(), several if found.runs > 1 and run is None else "")
            return replace(found, warnings=tuple(filter(None, warnings)))
    elif run not in (None, 1):
        raise RecordingError(f"{bag.path} holds no journal, so there is no run {run}")
    shown = recorded_progress(bag, progress_readers(bag, f"{chosen}/"), 0, SECOND)
    origin = min((int(found["stamp"].min()) for _, found in shown), default=bag.start_time)
    manifest = find_manifest(bag, chosen, damages)
    return RecordedRun(
        os.fspath(bag.path), journal, first_origin=origin, manifest=manifest, warnings=(reason,)
    )


def drill_namespaces(bag: BagReader) -> list[str]:
    """Return the namespaces in which a bag holds messages of a drill's own types."""
    spaces = set()
    for summary in bag.readable_topics:
        space, _, name = summary.topic.name.rpartition("/")
        kind = TOPICS[name].type if name in TOPICS else ""
        if kind.startswith("rpud_msgs/") and kind == summary.topic.type and summary.message_count:
            spaces.add(space)
    return sorted(spaces)


def choose_namespace(
    path: str | os.PathLike[str], spaces: Sequence[str], wanted: str | None
) -> str:
    """Return one of the namespaces of drills in a bag, by default the only one."""
    if wanted is None and len(spaces) == 1:
        return spaces[0]
    if not spaces:
        raise RecordingError(f"{path} holds no topic of a drill")
    names = [name or "/" for name in spaces]
    if wanted is None:
        which = f"choose --namespace of {joined(names)}"
        raise RecordingError(f"{path} holds several drills: {which}", code=2)
    space = wanted if wanted in spaces else f"/{wanted.strip('/')}".rstrip("/")
    if space not in spaces:
        hint = did_you_mean(space, names)
        raise RecordingError(f"{path} holds no drill in {wanted!r:.80}{hint}", code=2)
    return space


def find_manifest(bag: BagReader, namespace: str, damages: SkippedParts) -> Manifest | None:
    """Return the manifest of a drill in a bag; None if there is none, or if it is not clear."""
    found = []
    for record in damages.records(bag, MANIFEST_RECORD):
        try:
            found.append(manifest_from_record(record))
        except BagFormatError as error:
            damages.add_record(MANIFEST_RECORD, error)
    own = [m for m in found if m.node.rpartition("/")[0] == namespace and m.node]
    return next(iter((*own, *(found if len(found) == 1 else ()))), None)


def _runs(bag: BagReader, journal: RecordedJournal, damages: SkippedParts) -> list[RecordedRun]:
    """Return the runs of a journal; its entries from a gap on belong to none."""
    groups: list[tuple[list[RecordedEntry], str]] = []
    orphans = 0
    for each in journal.entries():
        entries, gap = groups[-1] if groups else ([], "")
        if each.entry.kind == "begin":
            groups.append(([each], ""))
        elif not groups:
            orphans += 1
        elif not gap:
            if reason := _discontinuity(entries[-1].entry, each.entry.sequence):
                groups[-1] = entries, f"{journal.name}: {reason}"
            else:
                entries.append(each)
    if not groups:
        raise UnverifiableError(
            f"cannot be decided: {orphans} entries of {journal.name} have no beginning; their "
            "recorder came too late, and no recorder of this package asked the drill for it"
        )
    for entries, _ in groups:
        beginning = entries[0].entry.content
        engine = engine_of(beginning)
        if not (isinstance(engine, int) and engine >= _FIRST_ENGINE):
            raise RecordingError(f"{journal.name}: {other_engine(beginning)}")
    starts = [entries[0].publish_time for entries, _ in groups]
    # Of runs that had ended when the recording began there is nothing but entries.
    began = max((_began(each) for each in damages.records(bag, RECORDING_RECORD)), default=0)
    ended = sum(start < began for start in starts[1:])
    groups, starts = groups[ended:], starts[ended:]
    timed = any(e.publish_time != e.log_time for entries, _ in groups for e in entries)
    if len(groups) > 1 and not (timed and all(np.diff(starts) > 0)):
        raise UnverifiableError(
            f"cannot be decided: the bag holds {len(groups)} runs, and no publishing times "
            "that show which of them a message belongs to"
        )
    edges = [_EARLIEST, *starts[1:], _LATEST + 1]
    if orphans or groups[0][0][0].entry.sequence:  # there was a run before
        edges[0] = starts[0]
    manifest = find_manifest(bag, journal.name.rpartition("/")[0], damages)
    found = [
        RecordedRun(
            os.fspath(bag.path),
            journal.name,
            number,
            len(groups),
            tuple(entries),
            (edges[number - 1], edges[number] - 1),
            entries[-1].entry.time,
            gap,
            manifest=manifest,
        )
        for number, (entries, gap) in enumerate(groups, 1)
    ]
    for run in found:
        journal.check(run.entries)
    return [_to_its_end(run, journal) for run in found]


def _began(record: Mapping[str, str]) -> int:
    """Return when a recording began [ns since the epoch], 0 if its record lacks it."""
    text = record.get("began", "")
    return int(text) if text.isdecimal() and len(text) < _DIGITS else 0


def _discontinuity(last: JournalEntry, number: int) -> str:
    """Return why an entry of this number does not continue a run; empty if it does."""
    if last.kind == "end":
        return f"entry {number} of the journal comes after the end, entry {last.sequence}"
    if number <= last.sequence:
        return f"entry {number} of the journal comes after entry {last.sequence}"
    if number > last.sequence + 1:
        return f"entries {last.sequence + 1} to {number - 1} of the journal are missing"
    return ""


def _to_its_end(run: RecordedRun, journal: RecordedJournal) -> RecordedRun:
    """Return a run with what messages show of its end, at the end of a block if it is not closed.

    The last second of a recording shows nothing: when a recorder closes, messages of some topics
    are still on their way. If the drill ended first, its last status shows the end.
    """
    last = run.number == run.runs
    if run.incomplete:
        run = replace(run, complete_until=run.entries[-1].publish_time - 1)
    elif not run.closed and (wrong := wrong_header(run.entries)):
        number = wrong.recorded.entry.sequence
        reason = f"{wrong.field} of entry {number} is {wrong.value}, not {wrong.right}"
        run = replace(run, incomplete=f"{run.journal}: {reason}")
    if not last and run.ended:
        return run
    by_topic = journal.progress(run.window, at_end=last)
    shown = np.concatenate([np.empty(0, PROGRESS), *by_topic.values()])
    arrived = shown[shown["log_time"] <= shown["log_time"].max(initial=0) - _TOPIC_DELAY * last]
    if last or not run.closed:
        # Two messages have to agree, so that one altered stamp changes nothing.
        stamps = np.sort(arrived["stamp"])
        stopped = shown["stamp"][shown["stopped"]] if run.closed else stamps[:0]
        known = int(stamps[-2]) - 1 if len(stamps) > 1 else -1
        run = replace(run, computed_until=max(known, int(stopped.max(initial=-1))))
    if run.ended:
        return run
    entries = run.entries[-1].entry.sequence + 1
    counts = shown["entries"]
    counted = int(counts.max(initial=0))  # entries, as a status counts them
    confirmed = shown["published"][(counts >= 0) & (counts <= entries)]
    if counted <= entries:  # complete but for the last second
        confirmed = np.append(confirmed, arrived["published"])
    early = f"the bag holds {entries} of its entries, and a status counts {counted or 'none'}"
    return replace(
        run,
        end=max(run.end, _boundary(run, [int(each["stamp"].max()) for each in by_topic.values()])),
        complete_until=max(run.entries[-1].publish_time, int(confirmed.max(initial=0))),
        ends_early=f"the journal ends early: {early}",
    )


def _boundary(run: RecordedRun, stamps: Sequence[int]) -> int:
    """Return the end of the last block of a run, by the greatest stamp of each topic [ns]."""
    try:
        rate = int(run.beginning["parameters"]["telemetry_rate"])
        reached = max(run.end, common_stamp(stamps) - run.origin if stamps else 0)
        return boundary(boundaries_until(reached, rate), rate)
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise RecordingError(f"{run.journal} cannot be understood: {error_text(error)}") from None
