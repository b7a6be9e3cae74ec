"""Rows of a report's tables: texts from the survey of a bag."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import datetime, timezone

from rpud_sim.bag.manifest import Manifest
from rpud_sim.inspection.report.drill_topics import FaultLog
from rpud_sim.inspection.report.running_statistics import Distribution
from rpud_sim.inspection.report.survey import Survey
from rpud_sim.inspection.report.topic_survey import TopicSurvey

Rows = list[tuple[str, ...]]

MOST_ROWS = 300  # number of rows in a table of topics

STATUS = "rpud_msgs/msg/Status"
BOREHOLE = "rpud_msgs/msg/Borehole"
# Column of a borehole: how far the bit has walked. Bags of earlier versions do not have it.
WALK = "side_offset"
_UNSET = "–"

# Counters of a status, and their names in the report.
_COUNTERS = (
    ("deadlines_missed", "deadlines missed"),
    ("messages_dropped", "messages dropped"),
    ("commands_accepted", "commands accepted"),
    ("commands_rejected", "commands refused"),
)


def show(value: float | None, unit: str = "") -> str:
    """Return a number with four digits and its unit; a dash for None, NaN and infinity."""
    if value is None or not math.isfinite(value):
        return _UNSET
    return f"{value:.4g} {unit}".rstrip()


def bag_rows(seen: Survey) -> Rows:
    start = datetime.fromtimestamp(seen.start / 1e9, tz=timezone.utc)
    return [
        ("bag", seen.path),
        ("begins", f"{start:%Y-%m-%d %H:%M:%S.%f} UTC" if seen.message_count else _UNSET),
        ("duration", f"{seen.duration:.3f} s"),
        ("messages", f"{seen.message_count} on {len(seen.summaries)} topics"),
        ("size", f"{seen.size / 1e6:.2f} MB, compression {seen.compression}"),
    ]


def _fork_rows(manifest: Manifest) -> Rows:
    """Return where a fork came from; nothing for a run that is none."""
    origin = manifest.forked_from
    if not origin:
        return []
    return [
        (
            "forked from",
            f"{origin.get('bag', _UNSET)}, run {origin.get('run', _UNSET)} "
            f"at {origin.get('at', _UNSET)} s",
        )
    ]


def run_rows(seen: Survey) -> list[Rows]:
    return [
        [
            ("drill", manifest.node or _UNSET),
            *_fork_rows(manifest),
            ("seed", _UNSET if manifest.seed is None else str(manifest.seed)),
            ("command", " ".join(manifest.command) or _UNSET),
            ("machine", manifest.machine or _UNSET),
            ("versions", ", ".join(f"{k} {v}" for k, v in manifest.versions.items()) or _UNSET),
        ]
        for manifest in seen.manifests
    ]


def parameter_rows(seen: Survey) -> Rows:
    """Return the parameters of the first run, from the manifest or else from the journal."""
    found = [dict(manifest.parameters) for manifest in seen.manifests]
    found += [journal.parameters for journal in seen.journals.values()]
    parameters = next(filter(None, found), {})
    return [
        (str(name), f"{value:g}" if isinstance(value, float) else f"{value!s:.200}")
        for name, value in sorted(parameters.items())
    ]


def topic_rows(seen: Survey) -> Rows:
    return [
        (
            summary.topic.name,
            summary.topic.type,
            str(summary.message_count),
            _UNSET if summary.rate is None else f"{summary.rate:.2f}",
            _lost(summary.losses.total if summary.losses else None),
        )
        for summary in seen.summaries[:MOST_ROWS]
    ]


def series_rows(topic: TopicSurvey) -> Rows:
    return [
        (
            item.column.name,
            item.column.unit,
            str(item.values.count),
            *_figures(item.values),
            str(item.values.others or ""),
        )
        for item in topic.series
    ]


def impact_rows(seen: Survey, name: str) -> Rows:
    """Return the figures of ``rpud simulate``, as far as the topics of one drill give them."""
    topic, impacts = seen.topics[name], seen.impacts[name]
    count = topic.find("peak_force").count
    span = impacts.intervals.total
    rate = impacts.intervals.count / span if span > 0.0 else None
    rows: Rows = [
        ("drill_tool_impacts", str(topic.summary.message_count), "in the bag"),
        ("drill_tool_impacts_missing", _lost(topic.timing.missing), "by their sequence"),
        ("drill_tool_impact_rate", show(rate, "1/s"), "of the intervals between impacts"),
        ("impact_velocity_mean", show(topic.find("impact_velocity").mean, "m/s"), ""),
        ("contact_force_mean", show(topic.find("peak_force").mean, "N"), "of the peaks"),
        ("contact_force_p99", show(topic.find("peak_force").quantile(0.99), "N"), "99 % quantile"),
        ("contact_force_max", show(topic.find("peak_force").greatest, "N"), ""),
        ("contact_duration_mean", show(topic.find("contact_duration").mean, "s"), ""),
    ]
    segments = seen.sibling(name, "rpud_msgs/msg/Trajectory")
    if segments is not None and segments.name in seen.segments:
        exact = seen.segments[segments.name]
        actuator = exact.actuator_impacts / exact.duration if exact.duration > 0.0 else None
        rows += [
            ("events", str(exact.events), "impacts and ends of contacts, by the trajectory"),
            ("actuator_impact_rate", show(actuator, "1/s"), "by the trajectory"),
        ]
    for kind, column in (
        ("rpud_msgs/msg/Waveform", "reacting_force"),
        ("rpud_msgs/msg/ReactingForce", "force"),
    ):
        force = seen.sibling(name, kind)
        if force is not None and force.find(column).count:
            mean = force.find(column).mean
            rows.append(("reacting_force_mean", show(mean, "N"), f"of the samples in {force.name}"))
            break
    return rows if count else rows[:2]


def energy_rows(seen: Survey, name: str) -> Rows:
    """Return energies and powers, as far as the topics of one drill give them."""
    topic, impacts = seen.topics[name], seen.impacts[name]
    energy, span = topic.find("energy"), impacts.intervals.total
    power = energy.mean * impacts.intervals.count / span if span > 0.0 else math.nan
    rows: Rows = [
        ("energy of an impact", show(energy.mean, "J"), "kinetic, of the arriving free mass"),
        ("energy of all impacts", show(energy.total, "J"), ""),
        ("kinetic_energy_rate", show(power, "W"), "power that arrives at the drill tool"),
        ("impulse of an impact", show(topic.find("impulse").mean, "N s"), "on the drill tool"),
    ]
    transferred = topic.find("energy_transferred")
    if transferred.count:
        stayed = transferred.mean * impacts.intervals.count / span if span > 0.0 else math.nan
        text = "power that stays in drill tool and rock"
        rows.append(("energy_transferred_rate", show(stayed, "W"), text))
    status = seen.sibling(name, STATUS)
    if status is None:
        return rows + _walk_rows(seen, name)
    electrical = status.find("electrical_power")
    if electrical.count:
        part = power / electrical.mean if electrical.mean > 0.0 else math.nan
        rows += [
            ("electrical power", show(electrical.mean, "W"), "mean of the reports in status"),
            ("part that arrives", show(100.0 * part, "%"), "of the electrical power"),
        ]
    else:
        rows.append(("electrical power", _UNSET, "actuator_model is gain: it is not modelled"))
    depth = status.find("depth")
    if depth.count:
        speed = status.find("penetration_rate").mean
        rows += [
            ("depth", show(1e3 * depth.greatest, "mm"), "of the hole, greatest"),
            ("penetration rate", show(1e3 * speed, "mm/s"), "mean of the reports in status"),
        ]
    else:
        rows.append(("depth", _UNSET, "rock_model is none: it is not modelled"))
    return rows + _walk_rows(seen, name)


def _walk_rows(seen: Survey, name: str) -> Rows:
    """Return how far the bit of a drill has walked; nothing if it has not, or nothing says so."""
    hole = seen.sibling(name, BOREHOLE)
    walked = hole.find(WALK).greatest if hole is not None else math.nan
    if not walked > 0.0:
        return []
    return [("walk of the bit", show(1e3 * walked, "mm"), "from the intended place of the hole")]


def timing_rows(seen: Survey) -> Rows:
    """Return losses, intervals and delays of the messages of each topic."""
    rows = []
    for topic in [*seen.topics.values()][:MOST_ROWS]:
        timing = topic.timing
        losses = topic.summary.losses
        late, gaps = timing.delay, timing.intervals
        jitter = late.quantile(0.99) - late.quantile(0.01)
        rows.append(
            (
                topic.name,
                str(topic.summary.message_count),
                _lost(losses.total if losses else None),
                "" if timing.missing is None else str(timing.missing),
                *(show(1e3 * gaps.quantile(part)) for part in (0.5, 0.99)),
                show(1e3 * gaps.greatest),
                *(
                    (show(1e3 * late.mean), show(1e3 * late.greatest))
                    if timing.stamped
                    else ("",) * 2
                ),
                show(1e3 * jitter) if timing.stamped else "",
                str(topic.timeline.jumps or ""),
            )
        )
    return rows


def status_rows(topic: TopicSurvey) -> Rows:
    speed = topic.find("real_time_factor")
    rows = [
        ("real_time_factor", f"mean {show(speed.mean)}, least {show(speed.least)}"),
        ("latest block", show(1e3 * topic.find("lateness_max").greatest, "ms")),
        ("greatest lag", show(1e3 * topic.find("lag").greatest, "ms")),
    ]
    rows += [(text, show(topic.find(name).greatest)) for name, text in _COUNTERS]
    lost = topic.find("commands_lost").greatest
    return [*rows, ("commands lost", "yes" if lost == 1.0 else "no")]


def fault_rows(log: FaultLog) -> Rows:
    """Return every fault with its times since the bag began."""
    return [
        (
            str(fault.number),
            fault.kind,
            fault.channel or "physics",
            show(fault.magnitude),
            f"{fault.onset:.6f}",
            "lasts" if fault.clear is None else f"{fault.clear:.6f}",
        )
        for fault in sorted(log.faults.values(), key=lambda fault: fault.onset)
    ]


def _figures(values: Distribution) -> Iterator[str]:
    yield from map(show, (values.mean, values.deviation, values.least))
    yield from (show(values.quantile(part)) for part in (0.05, 0.5, 0.95))
    yield show(values.greatest)


def _lost(count: int | None) -> str:
    return "unknown" if count is None else str(count)
