"""Records of attempts: what nodes under test have published; and the first difference of two."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.serialization import deserialize_message

from rpud_sim.foundation.quantities import counted
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.simulation.plan import JournalEntry
from rpud_sim.testing.disturbances import DisturbedStep
from rpud_sim.verdicts import Verdict

if TYPE_CHECKING:
    from rpud_sim.testing.collector import Collector
    from rpud_sim.testing.computed import ComputedDrill

TEST_CLIENT = "drill_test_client"  # node that gives the commands of the test
_OWN_COMMAND = f"{TEST_CLIENT}-".encode()  # in the frame of each of them, with a number
# Topics that no node under test alone publishes, or that have times of the machine.
_OTHERS = {"/clock", "/diagnostics", "/rosout", "/parameter_events"}
_BEGINNING = ("begin", "origin")  # entries of the journal that a reset makes
_MOST = 3  # fields that a difference shows
_LONGEST = 60  # characters of a value


class HeardMessages(NamedTuple):
    """Messages of a topic of nodes under test, in order."""

    kind: Any  # class of the messages
    stamped: bool  # whether they have stamps of their own
    payloads: tuple[bytes, ...]
    stamps: tuple[int, ...]  # [ns]; without one, the drill's time when a message came


class Heard(NamedTuple):
    """What nodes under test have published from a reset to the next, and what the drill took."""

    topics: Mapping[str, HeardMessages]
    entries: tuple[tuple[int, str], ...]  # of the drill's journal: time [ns] and text, sorted


class DrillRecord(NamedTuple):
    """Attempt of one drill."""

    heard: tuple[Heard, ...]  # one for each reset and the end
    verdicts: tuple[Verdict, ...]
    steps: tuple[DisturbedStep, ...]
    subscribed: tuple[str, ...] = ()  # topics of the drill that nodes under test subscribe to
    rate: int = 0  # of the telemetry [Hz]


class Difference(NamedTuple):
    """First difference of two attempts; they are ordered by what comes first."""

    part: int  # number of resets before
    stamp: int  # [ns]
    topic: str
    text: str

    def __str__(self) -> str:
        return f"{self.topic} at {self.stamp / SECOND:.3f} s: {self.text}"


def heard_of(collector: Collector, computed: ComputedDrill) -> Heard:
    """Return what nodes under test have published since the latest reset."""
    own = f"{collector.node.get_namespace().rstrip('/')}/"
    found = {}
    for name, topic in collector.topics.items():
        if topic.numbered_alone or name in _OTHERS or name == f"{own}command_results":
            continue
        rows = [
            (payload, stamp)
            for payload, stamp in zip(topic.payloads, topic.stamps, strict=True)
            if _OWN_COMMAND not in payload
        ]
        payloads, stamps = tuple(row[0] for row in rows), tuple(row[1] for row in rows)
        messages = HeardMessages(topic.kind, topic.stamped, payloads, stamps)
        found[name.removeprefix(own)] = messages
    entries = [_entry(each) for each in computed.entries if each.kind not in _BEGINNING]
    return Heard(found, tuple(sorted(entries)))


def first_difference(first: DrillRecord, there: DrillRecord) -> Difference | None:
    """Return the first difference of a shaken run from the first one, by stamp and topic."""
    for part, (ours, theirs) in enumerate(zip(there.heard, first.heard, strict=False)):
        found = [
            *(
                _of_topic(part, name, ours.topics.get(name), theirs.topics.get(name))
                for name in sorted({*ours.topics, *theirs.topics})
            ),
            _of_journals(part, ours.entries, theirs.entries),
        ]
        if differences := list(filter(None, found)):
            return min(differences)
    return None


def verdict_differences(first: Sequence[Verdict], there: Sequence[Verdict]) -> list[str]:
    """Return a line for each verdict with another outcome or margin."""
    lines = []
    for ours, theirs in zip(there, first, strict=False):
        mine, before = _verdict(ours), _verdict(theirs)
        if mine != before:
            lines.append(f"verdict {ours.name}: {mine}, in the first run {before}")
    if len(there) != len(first):
        lines.append(f"{len(there)} verdicts, in the first run {len(first)}")
    return lines


def _verdict(verdict: Verdict) -> str:
    margin = "" if verdict.margin is None else f", margin {verdict.margin!r} {verdict.unit}"
    return f"{verdict.outcome}{margin.rstrip()}"


def _entry(entry: JournalEntry) -> tuple[int, str]:
    content = ", ".join(f"{name} {value}" for name, value in sorted(entry.content.items()))
    return entry.time, f"{entry.kind} {content}".rstrip()


def _of_topic(
    part: int, name: str, there: HeardMessages | None, first: HeardMessages | None
) -> Difference | None:
    if there is None or first is None:
        only = there or first
        if only is None or not only.payloads:
            return None
        where = "only there" if first is None else "only in the first run"
        return Difference(part, only.stamps[0], name, f"is published {where}")
    place = _first_other(there.payloads, first.payloads)
    if place is None:
        return None
    missing = f"{_count(there, place)}, in the first run {_count(first, place)}"
    if place == len(first.payloads):
        return Difference(part, there.stamps[place], name, missing)
    if place == len(there.payloads):
        return Difference(part, first.stamps[place], name, missing)
    stamp, before = there.stamps[place], first.stamps[place]
    if there.stamped and stamp != before:
        if before in there.stamps[place:]:
            return Difference(part, stamp, name, "a message, in the first run none")
        if stamp in first.stamps[place:]:
            return Difference(part, before, name, "no message, in the first run one")
    text = fields_that_differ(
        deserialize_message(there.payloads[place], there.kind),
        deserialize_message(first.payloads[place], first.kind),
    )
    return Difference(part, min(stamp, before), name, text)


def _count(heard: HeardMessages, place: int) -> str:
    more = len(heard.payloads) - place
    return counted(more, "more message") if more else "no more message"


def _of_journals(
    part: int, there: Sequence[tuple[int, str]], first: Sequence[tuple[int, str]]
) -> Difference | None:
    place = _first_other(there, first)
    if place is None:
        return None
    ours, theirs = ([*each, None][place] for each in (there, first))
    stamp = min(each[0] for each in (ours, theirs) if each)
    ours, theirs = (each if each and each[0] == stamp else None for each in (ours, theirs))
    text = ", in the first run ".join(each[1] if each else "nothing" for each in (ours, theirs))
    return Difference(part, stamp, "what the drill did", text)


def _first_other(there: Sequence[Any], first: Sequence[Any]) -> int | None:
    for place, (ours, theirs) in enumerate(zip(there, first, strict=False)):
        if ours != theirs:
            return place
    return None if len(there) == len(first) else min(len(there), len(first))


def fields_that_differ(there: Any, first: Any) -> str:
    """Return the fields of two messages that differ, some of them, with their values."""
    ours, theirs = dict(_fields("", there)), dict(_fields("", first))
    names = [name for name in {**theirs, **ours} if ours.get(name) != theirs.get(name)]
    pairs = [(name, *_shown(ours.get(name), theirs.get(name))) for name in names[:_MOST]]
    lines = [f"{name} is {mine} there, {before} in the first run" for name, mine, before in pairs]
    if len(names) > _MOST:
        lines.append(f"and {len(names) - _MOST} more fields")
    return "; ".join(lines) or "other bits of the same values"


def _fields(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the values of a message by their paths."""
    if hasattr(value, "nanosec") and hasattr(value, "sec"):
        yield name, f"{join_seconds(value.sec, value.nanosec) / SECOND:.9f} s"
    elif hasattr(value, "get_fields_and_field_types"):
        for field in value.get_fields_and_field_types():
            yield from _fields(f"{name}.{field}".lstrip("."), getattr(value, field))
    elif isinstance(value, array) or hasattr(value, "tolist"):
        yield name, value.tolist()
    elif isinstance(value, list | tuple):
        for number, each in enumerate(value):
            yield from _fields(f"{name}[{number}]", each)
    else:
        yield name, value


def _shown(there: Any, first: Any) -> tuple[str, str]:
    """Return two values as short texts that differ."""
    for form in (_short, repr):
        ours, theirs = form(there), form(first)
        if ours != theirs:
            break
    return ours[:_LONGEST], theirs[:_LONGEST]


def _short(value: Any) -> str:
    if value is None:
        return "nothing"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
