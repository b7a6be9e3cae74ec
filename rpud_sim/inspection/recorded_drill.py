"""One run of one drill in a bag: its journal, its clock, how it was made, and how far it got."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from rpud_sim.bag import BagFormatError, BagReader, TopicSummary
from rpud_sim.bag.manifest import MANIFEST_RECORD as MANIFEST
from rpud_sim.bag.manifest import Manifest, manifest_from_record
from rpud_sim.foundation.quantities import suggestion
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection import InspectionError
from rpud_sim.inspection.output import Damages
from rpud_sim.inspection.recorded_journal import (
    Recorded,
    RecordedJournal,
    UnverifiableError,
    agreed,
    held_journals,
    progress_codecs,
    recorded_progress,
    with_wrong_header,
)
from rpud_sim.inspection.run_clock import RunClock
from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.journal import JournalEntry
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.simulation.versions import engine_of, other_engine

_NO_COMMANDS = ("begin", "origin", "stop", "flush", "save", "state", "end")
_LATEST = 2**62  # later than every time [ns]


@dataclass(frozen=True)
class RecordedDrill:
    """One run of one drill in a bag."""

    path: str
    journal: str  # name of the journal's topic, also where the bag holds none
    manifest: Manifest | None
    clock: RunClock  # of simulation time
    number: int = 1  # of the run, from 1; a reset or a restored checkpoint begins the next one
    runs: int = 1  # number of runs of this drill in the bag
    before: tuple[Recorded, ...] = ()  # journal of the same start of the node before this run
    entries: tuple[Recorded, ...] = ()  # journal of the run; empty without a journal
    end: int = 0  # simulation time up to which the journal is complete [ns]
    torn: str = ""  # why the run cannot be told beyond its end; empty if it ended there
    closed: bool = False  # whether its last entry is the drill's end, or the flush before a reset
    warnings: tuple[str, ...] = ()

    @property
    def prefix(self) -> str:
        """Namespace of the drill, with a slash at its end."""
        return self.journal[: -len("journal")]

    @property
    def namespace(self) -> str:
        return self.prefix[:-1]

    @property
    def start(self) -> int:
        """Simulation time at which the run begins [ns]: that of its first origin."""
        first = self.entries[0].entry
        entries = (each.entry for each in self.entries)
        if first.kind == "state":
            return first.time
        return next((entry.time for entry in entries if entry.kind == "origin"), 0)

    @cached_property
    def bounds(self) -> tuple[int, int]:
        """Publishing times between which the messages of the run lie [ns]."""
        first, last = 0, _LATEST
        if self.number > 1:
            # A run is flushed before the next begins, whose first messages may precede its entry.
            before = (self.before[-1:] or self.entries[:1])[0]
            begin = before if before.entry.kind == "flush" else self.entries[0]
            first = begin.message.publish_time
        if self.number < self.runs:
            last = self.entries[-1].message.publish_time
        return first, last

    @cached_property
    def beginning(self) -> Mapping[str, Any]:
        """Content of the entry ``begin`` of the run; empty if it is unknown."""
        for entry in (each.entry for each in reversed((*self.before, *self.entries[:1]))):
            if entry.kind == "begin":
                return entry.content
            held = entry.content.get("beginning") if entry.kind == "state" else None
            if isinstance(held, Mapping):
                return held
        return {}

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
        """Journal entries of commands and changed parameters, in order."""
        entries = (each.entry for each in self.entries[1:])
        return tuple(entry for entry in entries if entry.kind not in _NO_COMMANDS)

    def topic(self, name: str) -> str:
        return self.prefix + name

    def history(self, time: int) -> tuple[Recorded, ...]:
        """Return the entries up to an instant [ns], those of runs before as well."""
        # The first entry is the beginning; that of a restored checkpoint has a later time.
        rest = (each for each in self.entries[1:] if each.entry.time <= time)
        return (*self.before, self.entries[0], *rest)

    def necessary(self, time: int) -> list[JournalEntry]:
        """Return the entries from which the state at an instant [ns] follows."""
        entries = [each.entry for each in self.history(time)]
        kinds = [entry.kind for entry in entries]
        last = max((n for n, kind in enumerate(kinds) if kind == "begin"), default=0)
        # A checkpoint may be of a run before.
        return entries[0 if "restore" in kinds[last:] else last :]

    def later(self, time: int) -> list[JournalEntry]:
        """Return the run's entries after an instant [ns], without those that close it."""
        last = len(self.entries) - self.closed
        return [each.entry for each in self.entries[1:last] if each.entry.time > time]

    def digest(self, time: int) -> str:
        """Return a digest of the journal up to an instant [ns]: it identifies the state there."""
        digest = hashlib.sha256()
        for each in self.history(time):
            digest.update(each.message.data)
        return digest.hexdigest()

    def check_engine(self) -> None:
        """Raise an InspectionError if the run cannot be repeated: another engine made it."""
        if not self.beginning:
            raise InspectionError("the journal does not tell how its run began")
        if reason := other_engine(self.beginning):
            raise InspectionError(f"{self.journal}: {reason}")


def find_run(
    bag: BagReader, number: int = 1, topic: str | None = None, damages: Damages | None = None
) -> RecordedDrill:
    """Return a run of a bag by its number, from 1; ``topic`` chooses one of several journals."""
    journal = RecordedJournal(bag, _journal(bag, topic))
    name = journal.name
    entries: list[Recorded] = []
    torn = ""
    try:
        entries.extend(journal.entries())
    except UnverifiableError as error:
        torn = f"{name}: {error}"
    # The first entry is a beginning, or a state from which a late recording goes on.
    kinds = [each.entry.kind for each in entries]
    begins = [n for n, kind in enumerate(kinds) if not n or kind in ("begin", "restore")]
    runs = len(begins)
    if not 1 <= number <= runs:
        raise InspectionError(
            torn
            or f"--run = {number} is outside its range [1, {runs}]: resets and restored "
            "checkpoints begin new ones"
        )
    first, *following = begins[number - 1 :]
    own = entries[first : following[0] if following else None]
    starts = [n for n, each in enumerate(entries[: first + 1]) if each.entry.sequence == 0]
    closed = own[-1].entry.kind in (("end", "flush") if following else ("end",))
    if not closed and following:
        torn = torn or f"{name}: the recording does not tell how run {number} went on"
    found = RecordedDrill(
        os.fspath(bag.path),
        name,
        find_manifest(bag, damages or Damages(bag), name.rpartition("/")[0]),
        _clock(own),
        number,
        runs,
        tuple(entries[max(starts, default=0) : first]),
        tuple(own),
        own[-1].entry.time,
        "" if closed else torn,
        closed,
    )
    return found if closed or torn else _up_to_its_end(journal, found)


def _journal(bag: BagReader, wanted: str | None) -> TopicSummary:
    found = held_journals(bag)
    names = ", ".join(found)
    if wanted is None and len(found) > 1:
        raise InspectionError(f"{bag.path} holds several journals: choose with --topic of {names}")
    if wanted is not None and wanted not in found:
        raise InspectionError(
            f"{bag.path} holds no journal named {wanted}, but {names}{suggestion(wanted, found)}"
        )
    return found[wanted or names]


def _clock(entries: list[Recorded]) -> RunClock:
    """Return the clock of the origins in a journal."""
    clock: RunClock | None = None
    for each in entries:
        if each.entry.kind == "origin":
            origin, time = int(each.entry.content["origin"]), each.entry.time
            clock = clock or RunClock(origin)
            clock.add("origin", origin + time, time, each.message.publish_time)
    return clock or RunClock(0)


def _up_to_its_end(journal: RecordedJournal, drill: RecordedDrill) -> RecordedDrill:
    """Return a run that was not closed with the time that it reached, at the end of a block."""
    for each, wrong in with_wrong_header(drill.entries):
        if wrong:
            raise InspectionError(
                f"{drill.journal}: {wrong.field} of entry {each.entry.sequence} is "
                f"{wrong.value}, not {wrong.right}"
            )
    origins = [e.entry.content["origin"] for e in drill.entries if e.entry.kind == "origin"]
    try:
        if not drill.beginning:
            drill.check_engine()
        rate = int(drill.beginning["parameters"]["telemetry_rate"])
        origin = origins[-1] if origins else 0
        reached = agreed([drill.end + origin, *journal.last]) - origin
        end = boundary(boundaries_until(reached, rate), rate)
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise InspectionError(f"{drill.journal} cannot be understood: {error!r:.100}") from None
    return replace(drill, end=max(drill.end, end))


def find_drill(
    bag: BagReader, damages: Damages, namespace: str | None = None, run: int | None = None
) -> RecordedDrill:
    """Return a run of a drill in a bag: by default of the only drill, and the first.

    Without a journal that shows its runs, the whole bag is one.
    """
    chosen = _choose(bag, namespace)
    journal = f"{chosen}/journal"
    reason = f"{bag.path} holds no journal: commands are unknown, and a reset is not seen"
    if any(s.topic.name == journal and s.message_count for s in bag.readable_topics):
        try:
            found = find_run(bag, run or 1, journal, damages)
        except InspectionError as error:
            reason = f"{bag.path}: {error}"
            if run not in (None, 1):
                raise InspectionError(reason) from error
        else:
            several = (
                f"{bag.path} holds {found.runs} runs: the first is compared; choose with --run"
            )
            warnings = (found.torn, several if found.runs > 1 and run is None else "")
            return replace(found, warnings=tuple(filter(None, warnings)))
    elif run not in (None, 1):
        raise InspectionError(f"{bag.path} holds no journal, so there is no run {run}")
    manifest = find_manifest(bag, damages, chosen)
    codecs = progress_codecs(bag, f"{chosen}/")
    stamps = [int(found["stamp"].min()) for _, found in recorded_progress(bag, codecs, 0, SECOND)]
    clock = RunClock(min(stamps, default=bag.start_time))  # the origin is unknown
    return RecordedDrill(os.fspath(bag.path), journal, manifest, clock, warnings=(reason,))


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
        raise InspectionError(f"{bag.path} holds no topic of a drill")
    names = ", ".join(f"{name:.80}" or "/" for name in found)
    if wanted is None:
        if len(found) > 1:
            raise InspectionError(f"{bag.path} holds several drills: choose --namespace of {names}")
        return found[0]
    space = "" if wanted == "/" else f"/{wanted.strip('/')}"
    if space not in found:
        raise InspectionError(
            f"{bag.path} holds no drill in {wanted!r:.80}, but in {names}{suggestion(space, found)}"
        )
    return space


def find_manifest(bag: BagReader, damages: Damages, namespace: str) -> Manifest | None:
    """Return the manifest of a drill in a bag; None if there is none, or if it is not clear."""
    found = []
    for record in damages.records(bag, MANIFEST):
        try:
            found.append(manifest_from_record(record))
        except BagFormatError as error:
            damages.add_record(MANIFEST, error)
    own = [m for m in found if m.node.rpartition("/")[0] == namespace and m.node]
    return next(iter((*own, *(found if len(found) == 1 else ()))), None)
