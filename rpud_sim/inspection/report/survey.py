"""Survey of a bag in one pass: everything that a report shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from rpud_sim.bag import BagFormatError, BagReader, TopicSummary
from rpud_sim.bag.columns import Column, Kind
from rpud_sim.bag.manifest import RECORD_NAME as MANIFEST
from rpud_sim.bag.manifest import Manifest, manifest_from_record
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.damages import Damages
from rpud_sim.inspection.report.drill_topics import (
    CHANNELS,
    FaultLog,
    Impacts,
    Journal,
    Powers,
    Segments,
    Waveform,
)
from rpud_sim.inspection.report.periods import Periods, to_periods
from rpud_sim.inspection.report.power_flow import FEED_POWERS, INFLOWS, OUTFLOWS
from rpud_sim.inspection.report.timeline import zero_stamp
from rpud_sim.inspection.report.topic_survey import TopicSurvey, is_latched, stamp_column

POWERS = (*INFLOWS, *OUTFLOWS)  # fields of a status that the flow of power shows

# Types and columns with the reacting force of a drill, the better one first.
FORCES = (
    ("rpud_msgs/msg/Waveform", "reacting_force"),
    ("rpud_msgs/msg/ReactingForce", "force"),
)

# Number of topics that are surveyed; of others the report only shows the bag's index.
MOST_TOPICS = 200

# Columns that a topic of ours has, since other types may have the same name: the kind of the dtype
# of numbers, and the kind of other columns.
_NEEDED = {
    "rpud_msgs/msg/ContactForce": {"header.stamp": "time", "energy": "f", "peak_force": "f"},
    "rpud_msgs/msg/Trajectory": {"time": "time", "event": "u", "duration": "f"},
    "rpud_msgs/msg/Waveform": {
        "time": "time",
        "sample_period": "f",
        "sequence": "u",
        **dict.fromkeys(CHANNELS, "f"),
    },
    "rpud_msgs/msg/Faults": {"header.stamp": "time", "faults": "nested"},
    "rpud_msgs/msg/Status": {"header.stamp": "time", **dict.fromkeys(POWERS, "f")},
    "rpud_msgs/msg/JournalEntry": {"header.stamp": "time", "kind": "text", "content": "text"},
}


@dataclass
class Survey:
    """Content of a bag, as far as a report shows it."""

    path: str
    start: int  # log time of its beginning [ns]
    duration: float  # [s]
    size: int  # of its files [bytes]
    message_count: int
    compression: str
    manifests: list[Manifest]
    summaries: tuple[TopicSummary, ...]
    left_out: dict[str, str]  # topics that are not surveyed, with the reason
    topics: dict[str, TopicSurvey] = field(default_factory=dict)  # surveyed topics, by name
    # impacts, segments, waveforms, powers, faults, journals: content of the drill's own topics, by
    # name.
    impacts: dict[str, Impacts] = field(default_factory=dict)
    segments: dict[str, Segments] = field(default_factory=dict)
    waveforms: dict[str, Waveform] = field(default_factory=dict)
    powers: dict[str, Powers] = field(default_factory=dict)
    faults: dict[str, FaultLog] = field(default_factory=dict)
    journals: dict[str, Journal] = field(default_factory=dict)
    # Segments of each drill between its commands and faults, by namespace.
    periods: dict[str, Periods] = field(default_factory=dict)
    # Amount and reason of the damaged parts that were skipped, by topic or record.
    damaged: dict[str, str] = field(default_factory=dict)

    @property
    def span(self) -> float:
        """Time from the bag's beginning to the last of all stamps and log times [s].

        It exceeds the duration if simulation time passes faster than the recorder's clock.
        """
        return max([self.duration, *(topic.end for topic in self.topics.values())])

    def sibling(self, topic: str, kind: str) -> TopicSurvey | None:
        """Return the topic of a type in the same namespace as another topic."""
        for name, found in self.topics.items():
            if namespace(name) == namespace(topic) and found.type == kind:
                return found
        return None


def survey(bag: BagReader, report: Callable[[int], object] = lambda messages: None) -> Survey:
    """Read a bag once and return its survey."""
    damages = Damages(bag)
    seen = Survey(
        str(bag.path),
        bag.start_time,
        bag.duration / SECOND,
        bag.size,
        bag.message_count,
        bag.compression,
        _manifests(bag, damages),
        bag.readable_topics,
        dict(bag.left_out),
    )
    zeros = _zeros(bag)
    _choose_topics(seen, bag, zeros)
    _read_changes(seen, bag, zeros)
    forces = _force_columns(seen)
    for batch in bag.batches([*seen.topics], leave_out=damages.add):
        times = seen.topics[batch.topic].add(batch)
        for kept in (seen.impacts, seen.segments, seen.waveforms, seen.powers):
            if batch.topic in kept:
                kept[batch.topic].add(batch.columns, times)
        if batch.topic in seen.impacts:
            seen.periods[namespace(batch.topic)].add_impacts(batch.columns, times)
        if batch.topic in forces:
            forces_now = batch.columns[forces[batch.topic]]
            seen.periods[namespace(batch.topic)].add_force(forces_now, times)
        report(batch.message_count)
    for periods in seen.periods.values():
        periods.end_at(seen.span)
    seen.damaged.update(damages.texts)
    return seen


def _read_changes(seen: Survey, bag: BagReader, zeros: Mapping[str, int]) -> None:
    """Read journals and faults first: they say where the segments of the run begin.

    They are few messages, which the bag's index finds; what is damaged is counted later.
    """
    topics = {
        name: TopicSurvey(
            found.summary, bag.columns(name), seen.start, seen.duration, zeros.get(namespace(name))
        )
        for name, found in seen.topics.items()
        if name in seen.journals or name in seen.faults
    }
    for batch in bag.batches([*topics], leave_out=lambda topic, reason: None) if topics else ():
        times = topics[batch.topic].add(batch)
        if batch.topic in seen.journals:
            seen.journals[batch.topic].add(batch.columns, times)
        else:
            jumps = topics[batch.topic].timeline.jumps
            seen.faults[batch.topic].add(batch.columns, times, jumps)
    for space in {namespace(name) for name in seen.topics}:
        changes = [
            change
            for name, journal in seen.journals.items()
            if namespace(name) == space
            for change in journal.changes
        ]
        faults = [
            fault
            for name, log in seen.faults.items()
            if namespace(name) == space
            for fault in log.faults.values()
        ]
        seen.periods[space] = to_periods(changes, faults)


def _force_columns(seen: Survey) -> dict[str, str]:
    found: dict[str, str] = {}
    for name in seen.impacts:
        for kind, column in FORCES:
            topic = seen.sibling(name, kind)
            if topic is not None and any(item.column.name == column for item in topic.series):
                found[topic.name] = column
                break
    return found


def _choose_topics(seen: Survey, bag: BagReader, zeros: Mapping[str, int]) -> None:
    for summary in bag.readable_topics:
        name = summary.topic.name
        if name in seen.left_out:
            continue
        if len(seen.topics) >= MOST_TOPICS:
            seen.left_out[name] = f"the bag has more than {MOST_TOPICS} topics"
            continue
        columns = bag.columns(name)
        zero = zeros.get(namespace(name))
        seen.topics[name] = TopicSurvey(summary, columns, seen.start, seen.duration, zero)
        _add_drill_topic(seen, summary, columns)


def namespace(topic: str) -> str:
    return topic.rpartition("/")[0]


def _zeros(bag: BagReader) -> dict[str, int]:
    """Return the stamp of each namespace's clock at the bag's beginning [ns].

    The first message of a topic that is not latched shows it: latched ones may be older.
    """
    begin = bag.start_time
    stamped = [
        summary
        for summary in bag.readable_topics
        if summary.topic.name not in bag.left_out
        and summary.first_time is not None
        and not is_latched(summary)
        and stamp_column(bag.columns(summary.topic.name)) != "log_time"
    ]
    zeros: dict[str, int] = {}
    for summary in sorted(stamped, key=lambda summary: summary.first_time or 0):
        name = summary.topic.name
        if namespace(name) in zeros:
            continue
        skipped = (summary.first_time or 0) - begin
        for batch in bag.batches(name, skipped, 1, leave_out=lambda topic, reason: None):
            if len(batch):
                columns = batch.columns
                stamps = columns[stamp_column(bag.columns(name))]
                zeros[namespace(name)] = zero_stamp(stamps, columns["log_time"], begin)
    return zeros


def _manifests(bag: BagReader, damages: Damages) -> list[Manifest]:
    found = []
    for record in damages.records(bag, MANIFEST):
        try:
            found.append(manifest_from_record(record))
        except BagFormatError as error:
            damages.add_record(MANIFEST, error)
    return found


def _add_drill_topic(seen: Survey, summary: TopicSummary, columns: Sequence[Column]) -> None:
    name, kind = summary.topic.name, summary.topic.type
    held = {
        (column.name, column.dtype.kind if column.kind is Kind.NUMBER else column.kind.value)
        for column in columns
    }
    if kind not in _NEEDED or not _NEEDED[kind].items() <= held:
        return
    if kind == "rpud_msgs/msg/ContactForce":
        seen.impacts[name] = Impacts(seen.duration)
    elif kind == "rpud_msgs/msg/Trajectory":
        seen.segments[name] = Segments()
    elif kind == "rpud_msgs/msg/Waveform":
        seen.waveforms[name] = Waveform(seen.duration)
    elif kind == "rpud_msgs/msg/Status":
        seen.powers[name] = Powers(POWERS, FEED_POWERS)
    elif kind == "rpud_msgs/msg/Faults":
        seen.faults[name] = FaultLog()
    else:
        seen.journals[name] = Journal()
