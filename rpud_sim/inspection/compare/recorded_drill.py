"""One run of one drill in a bag: which it is, when it began, and what was changed meanwhile."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader, TopicSummary
from rpud_sim.bag.manifest import MANIFEST_RECORD as MANIFEST
from rpud_sim.bag.manifest import Manifest, manifest_from_record
from rpud_sim.foundation.quantities import suggestion
from rpud_sim.inspection.damages import Damages
from rpud_sim.inspection.recorded_run import ForkError, RecordedRun, find_run
from rpud_sim.simulation.journal import JournalEntry
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.simulation.versions import engine_of

_NO_COMMANDS = ("begin", "origin", "stop", "flush", "save", "state", "end")
_LATEST = 2**62  # later than every time [ns]


class CompareError(Exception):
    """Comparison that is not possible; the text gives the reason in one line."""


@dataclass(frozen=True)
class Origins:
    """Stamps of simulation time zero, each from a publishing time on."""

    published: np.ndarray  # publishing times, shape (n,) [ns]
    stamps: np.ndarray  # of simulation time zero, shape (n,) [ns]

    def elapsed(self, stamps: np.ndarray, published: np.ndarray) -> np.ndarray:
        """Return simulation times [ns] of messages with these stamps and publishing times [ns]."""
        places = np.searchsorted(self.published, published, side="right") - 1
        return stamps - self.stamps[np.maximum(places, 0)]


@dataclass(frozen=True)
class RecordedDrill:
    """Run of a drill in a bag."""

    path: str
    namespace: str
    number: int  # of the run, from 1
    runs: int  # number of runs of this drill in the bag
    begin: int  # begin, end: publishing times of its first and after its last message [ns]
    end: int
    origins: Origins
    parameters: Mapping[str, Any] = field(default_factory=dict)  # at its beginning, by name
    versions: Mapping[str, str] = field(default_factory=dict)  # of what computed it, by name
    seed: int | None = None  # of all random numbers; None if it is unknown
    # Journal entries of commands and changed parameters, in order.
    commands: tuple[JournalEntry, ...] = ()
    journal: bool = True  # whether the bag holds its journal
    warnings: tuple[str, ...] = ()

    def topic(self, name: str) -> str:
        return f"{self.namespace}/{name}"


def find_drill(
    bag: BagReader, damages: Damages, namespace: str | None = None, run: int | None = None
) -> RecordedDrill:
    """Return a run of a drill in a bag: by default of the only drill, and the first."""
    chosen = _choose(bag, namespace)
    manifest = _manifest(bag, damages, chosen)
    journal = f"{chosen}/journal"
    held = {s.topic.name: s for s in bag.readable_topics if s.message_count}
    if journal not in held:
        if run not in (None, 1):
            raise CompareError(f"{bag.path} holds no journal, so there is no run {run}")
        return _without_journal(bag, chosen, manifest)
    try:
        recorded = find_run(bag, run or 1, journal)
    except ForkError as error:
        if run not in (None, 1):
            raise CompareError(f"{bag.path}: {error}") from error
        return _without_journal(bag, chosen, manifest, f"{bag.path}: {error}")
    return _from_journal(bag, chosen, recorded, manifest, chosen_by_user=run is not None)


def namespaces(bag: BagReader) -> tuple[str, ...]:
    """Return the namespaces of the drills in a bag."""
    found: dict[str, None] = {}
    for summary in bag.readable_topics:
        space, _, name = summary.topic.name.rpartition("/")
        known = TOPICS.get(name)
        own = known is not None and known.type == summary.topic.type
        if own and summary.topic.type.startswith("rpud_msgs/") and summary.message_count:
            found[space] = None
    return tuple(sorted(found))


def _choose(bag: BagReader, wanted: str | None) -> str:
    found = namespaces(bag)
    if not found:
        raise CompareError(f"{bag.path} holds no topic of a drill")
    names = ", ".join(f"{name:.80}" or "/" for name in found)
    if wanted is None:
        if len(found) > 1:
            raise CompareError(f"{bag.path} holds several drills: choose --namespace of {names}")
        return found[0]
    space = "" if wanted == "/" else f"/{wanted.strip('/')}"
    if space not in found:
        raise CompareError(
            f"{bag.path} holds no drill in {wanted!r:.80}, but in {names}{suggestion(space, found)}"
        )
    return space


def _manifest(bag: BagReader, damages: Damages, namespace: str) -> Manifest | None:
    found = []
    for record in damages.records(bag, MANIFEST):
        try:
            found.append(manifest_from_record(record))
        except BagFormatError as error:
            damages.add_record(MANIFEST, error)
    own = [m for m in found if m.node.rpartition("/")[0] == namespace and m.node]
    single = found if len(found) == 1 else []
    return next(iter((*own, *single)), None)


def _without_journal(
    bag: BagReader, namespace: str, manifest: Manifest | None, reason: str = ""
) -> RecordedDrill:
    """Return a run whose time counts from the first stamp, since its origin is unknown."""
    first = _first_stamp(bag, namespace)
    return RecordedDrill(
        os.fspath(bag.path),
        namespace,
        1,
        1,
        0,
        _LATEST,
        Origins(np.zeros(1, np.int64), np.array([first], np.int64)),
        dict(manifest.parameters) if manifest else {},
        _texts(manifest.versions) if manifest else {},
        manifest.seed if manifest else None,
        journal=False,
        warnings=(
            reason or f"{bag.path} holds no journal: commands are unknown, and a reset is not seen",
        ),
    )


def _first_stamp(bag: BagReader, namespace: str) -> int:
    stamps = []
    for name, topic in TOPICS.items():
        full = f"{namespace}/{name}"
        if topic.latched or full not in _readable(bag):
            continue
        for batch in bag.batches(full, 0, 1_000_000_000, leave_out=lambda topic, reason: None):
            if len(batch) and "header.stamp" in batch.columns:
                stamps.append(int(batch.columns["header.stamp"].min()))
                break
    return min(stamps, default=bag.start_time)


def _readable(bag: BagReader) -> dict[str, TopicSummary]:
    return {s.topic.name: s for s in bag.readable_topics if s.topic.name not in bag.left_out}


def _from_journal(
    bag: BagReader,
    namespace: str,
    recorded: RecordedRun,
    manifest: Manifest | None,
    *,
    chosen_by_user: bool,
) -> RecordedDrill:
    entries = [entry for _, entry in recorded.entries]
    origins = [
        (message.publish_time, int(entry.content["origin"]))
        for message, entry in recorded.entries
        if entry.kind == "origin" and isinstance(entry.content.get("origin"), int)
    ]
    origins = origins or [(0, 0)]
    begun = next(
        (e.content for _, e in reversed((*recorded.before, *recorded.entries[:1]))
         if e.kind == "begin"),
        {},
    )  # fmt: skip
    parameters = begun.get("parameters")
    made_by = begun.get("made_by")
    versions = made_by if isinstance(made_by, dict) else {}
    if begun:
        versions = {**versions, "engine": engine_of(begun)}
    if manifest:
        versions = {**manifest.versions, **versions}
    warnings = [recorded.torn] if recorded.torn else []
    if recorded.runs > 1 and not chosen_by_user:
        warnings.append(
            f"{bag.path} holds {recorded.runs} runs: the first is compared; choose with --run"
        )
    first, last = _bounds(recorded)
    parameters = {**parameters} if isinstance(parameters, dict) else {}
    parameters |= {name: begun[name] for name in ("initial_phase",) if name in begun}
    seed = begun.get("seed", parameters.get("seed"))
    return RecordedDrill(
        os.fspath(bag.path),
        namespace,
        recorded.number,
        recorded.runs,
        first,
        last,
        Origins(*(np.array(column, np.int64) for column in zip(*origins, strict=True))),
        parameters,
        _texts(versions),
        seed if isinstance(seed, int) else manifest.seed if manifest else None,
        tuple(entry for entry in entries[1:] if entry.kind not in _NO_COMMANDS),
        warnings=tuple(warnings),
    )


def _bounds(recorded: RecordedRun) -> tuple[int, int]:
    """Return the publishing times between which the messages of a run lie [ns]."""
    first, last = 0, _LATEST
    if recorded.number > 1:
        # A run is flushed before the next begins, whose first messages may precede its entry.
        before = recorded.before[-1:] or recorded.entries[:1]
        flushed = before[0][1].kind == "flush"
        first = before[0][0].publish_time if flushed else recorded.entries[0][0].publish_time
    if recorded.number < recorded.runs:
        last = recorded.entries[-1][0].publish_time
    return first, last


def _texts(values: Mapping[str, Any]) -> dict[str, str]:
    return {str(name)[:80]: f"{value!s:.200}" for name, value in values.items()}
