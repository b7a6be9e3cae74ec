"""One run of a bag as its journal has it: what came before, what changed it, and its end."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rpud_sim.bag import BagFormatError, BagReader, Message, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.quantities import suggestion
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.inspection.verify.installed_types import JOURNAL, journal_codec
from rpud_sim.inspection.verify.recorded_journal import UnverifiableError, journal_entries
from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.fields import Fields
from rpud_sim.simulation.journal import JournalEntry
from rpud_sim.simulation.topics import PROVED
from rpud_sim.simulation.versions import other_engine

# Length of the end of a bag that shows how far its last run came [ns].
_END_LENGTH = 10 * SECOND
_RATE = "telemetry_rate"

Recorded = tuple[Message, JournalEntry]


class ForkError(Exception):
    """Fork that is not possible; the text gives the reason in one line."""


@dataclasses.dataclass(frozen=True)
class RecordedRun:
    """One run of a bag."""

    journal: str  # topic of its journal
    number: int  # of the run, from 1; a reset or a restored checkpoint begins the next one
    runs: int  # number of runs that the bag holds
    before: tuple[Recorded, ...]  # entries of the same start of the node before this run
    entries: tuple[Recorded, ...]  # of the run itself, from its beginning on
    codec: Codec  # of the entries' messages
    start: int  # simulation time at which it begins [ns]
    end: int  # simulation time up to which the journal is complete [ns]
    torn: str  # why the run cannot be told beyond its end; empty if it ended there
    closed: bool  # whether its last entry is the end of the drill, or the flush before the next run

    @property
    def prefix(self) -> str:
        """Namespace of the drill, with a slash at its end."""
        return self.journal[: -len("journal")]

    def history(self, time: int) -> tuple[Recorded, ...]:
        """Return the entries up to an instant [ns], those of runs before as well."""
        # The first entry is the beginning; that of a restored checkpoint has a later time.
        rest = (each for each in self.entries[1:] if each[1].time <= time)
        return (*self.before, self.entries[0], *rest)

    def necessary(self, time: int) -> list[JournalEntry]:
        """Return the entries from which the state at an instant [ns] follows."""
        entries = [entry for _, entry in self.history(time)]
        begins = [place for place, entry in enumerate(entries) if entry.kind == "begin"]
        # A checkpoint may be of a run before.
        first = next(
            place
            for place in (*reversed(begins), 0)
            if place == 0 or all(entry.kind != "restore" for entry in entries[place:])
        )
        return entries[first:]

    def later(self, time: int) -> list[JournalEntry]:
        """Return the run's entries after an instant [ns], without those that close it."""
        last = len(self.entries) - self.closed
        return [entry for _, entry in self.entries[1:last] if entry.time > time]

    def digest(self, time: int) -> str:
        """Return a digest of the journal up to an instant [ns]: it identifies the state there."""
        digest = hashlib.sha256()
        for message, _ in self.history(time):
            digest.update(message.data)
        return digest.hexdigest()

    def fields(self, message: Message) -> Fields:
        decoded = self.codec.decode(message.data)
        stamp = decoded.header.stamp
        return {
            "header": {
                "stamp": {"sec": stamp.sec, "nanosec": stamp.nanosec},
                "frame_id": decoded.header.frame_id,
            },
            "sequence": decoded.sequence,
            "kind": decoded.kind,
            "content": decoded.content,
        }

    def check_engine(self) -> None:
        """Raise a ForkError if another engine made the run, so that it cannot be repeated."""
        if reason := other_engine(_begin_of(self.before, self.entries)):
            raise ForkError(f"{self.journal}: {reason}")


def find_run(bag: BagReader, number: int = 1, topic: str | None = None) -> RecordedRun:
    """Return a run of a bag by its number, from 1; ``topic`` chooses one of several journals."""
    summary = _journal(bag, topic)
    name = summary.topic.name
    try:
        codec = journal_codec(summary)
    except UnverifiableError as error:
        raise ForkError(str(error)) from None
    entries: list[Recorded] = []
    torn = ""
    try:
        entries.extend(journal_entries(bag.messages({name}), codec))
    except UnverifiableError as error:
        torn = f"{name}: {error}"
    # The first entry is a beginning, or a state from which a late recording goes on.
    begins = [place for place, (_, entry) in enumerate(entries) if not place or _begins(entry)]
    if not begins:
        raise ForkError(torn or f"{name} holds no beginning of a run")
    if not 1 <= number <= len(begins):
        raise ForkError(
            torn
            or f"--run = {number} is outside its range [1, {len(begins)}]: resets and restored "
            "checkpoints begin new ones"
        )
    first = begins[number - 1]
    last = number == len(begins)
    own = entries[first:] if last else entries[first : begins[number]]
    starts = (place for place in range(first + 1) if entries[place][1].sequence == 0)
    node = max(starts, default=0)
    before = entries[node:first]
    closed = own[-1][1].kind == "end" or (not last and own[-1][1].kind == "flush")
    end = own[-1][1].time
    if not closed and last and not torn:
        try:
            end = _last_time(bag, name, own, int(_begin_of(before, own)["parameters"][_RATE]))
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            raise ForkError(f"{name} cannot be understood: {error!r:.100}") from None
    elif not closed and not torn:
        torn = f"{name}: the recording does not tell how run {number} went on"
    return RecordedRun(
        name,
        number,
        len(begins),
        tuple(before),
        tuple(own),
        codec,
        _start(own),
        end,
        "" if closed else torn,
        closed,
    )


def _journal(bag: BagReader, wanted: str | None) -> TopicSummary:
    found = {
        summary.topic.name: summary
        for summary in bag.topics
        if summary.topic.type == JOURNAL and summary.message_count
    }
    if not found:
        raise ForkError(
            f"{bag.path} holds no journal; record the topic journal, or all of the namespace"
        )
    names = ", ".join(found)
    if wanted is not None and wanted not in found:
        raise ForkError(
            f"{bag.path} holds no journal named {wanted}, but {names}{suggestion(wanted, found)}"
        )
    if wanted is None and len(found) > 1:
        raise ForkError(f"{bag.path} holds several journals: choose with --topic of {names}")
    return found[wanted] if wanted is not None else next(iter(found.values()))


def _begins(entry: JournalEntry) -> bool:
    return entry.kind in ("begin", "restore")


def _begin_of(before: Sequence[Recorded], own: Sequence[Recorded]) -> Mapping[str, Any]:
    for _, entry in reversed((*before, *own[:1])):
        if entry.kind == "begin":
            return entry.content
        if entry.kind == "state" and isinstance(entry.content.get("beginning"), Mapping):
            return entry.content["beginning"]
    raise ForkError("the journal does not tell how its run began")


def _start(own: list[Recorded]) -> int:
    """Return the simulation time at which a run begins: that of its first origin."""
    if own[0][1].kind == "state":
        return own[0][1].time
    return next((entry.time for _, entry in own if entry.kind == "origin"), 0)


def _last_time(bag: BagReader, journal: str, own: list[Recorded], rate: int) -> int:
    """Return the simulation time that a bag's last run reached, at the end of a block [ns]."""
    origin = next((e.content["origin"] for _, e in reversed(own) if e.kind == "origin"), 0)
    end = own[-1][1].time
    latest = {"": end}
    for stamp, topic in _last_stamps(bag, journal[: -len("journal")]):
        latest[topic] = max(stamp - origin, latest.get(topic, end))
    # Two topics have to agree, so that one altered stamp changes nothing.
    reached = min(sorted(latest.values())[-2:])
    return max(end, boundary(boundaries_until(reached, rate), rate))


def _last_stamps(bag: BagReader, prefix: str) -> Iterator[tuple[int, str]]:
    codecs: dict[str, Codec] = {}
    for summary in bag.topics:
        name = summary.topic.name
        if name.startswith(prefix) and name[len(prefix) :] in PROVED and summary.definition:
            try:
                codecs[name] = Codec(summary.topic.type, summary.definition)
            except BagFormatError:
                continue
    for message in bag.messages(codecs.keys(), max(0, bag.duration - _END_LENGTH)):
        try:
            stamp = codecs[message.topic].decode(message.data).header.stamp
        except (AttributeError, BagFormatError):
            continue
        yield join_seconds(stamp.sec, stamp.nanosec), message.topic
