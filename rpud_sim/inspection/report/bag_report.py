"""Report of a bag: one HTML page without network or other files."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import rpud_sim.bag
from rpud_sim.inspection.output import check_new_file, write_new_file
from rpud_sim.inspection.report import charts, rows
from rpud_sim.inspection.report.account_rows import account_rows, period_rows
from rpud_sim.inspection.report.run_marks import run_marks
from rpud_sim.inspection.report.survey import FORCES, Survey, namespace, survey
from rpud_sim.inspection.report.template import BODY, HEADINGS
from rpud_sim.inspection.report.time_plots import TimePlots, closer
from rpud_sim.inspection.report.topic_survey import MOST_SERIES, TopicSurvey
from rpud_sim.pages.frame import render_page
from rpud_sim.pages.plot import Plot

_MOST_DRAWN = 20  # topics
_MOST_PANELS = 12  # of a topic
_MOST_PLOTS = 90  # of all topics: each takes some 40 kB

# The drill's topics, the most informative first; others follow by name.
_ORDER = (
    "rpud_msgs/msg/Waveform",
    "rpud_msgs/msg/ReactingForce",
    "rpud_msgs/msg/NodalPlane",
    "rpud_msgs/msg/DrillTool",
    "rpud_msgs/msg/Status",
    "rpud_msgs/msg/ContactForce",
)


class ReportError(Exception):
    """Report that cannot be written; the text gives the reason in one line."""


# Types, columns and titles of the slow quantities of a drill on an arm.
_SLOW = (
    ("rpud_msgs/msg/Mount", "force", "force of the arm on the mount"),
    ("rpud_msgs/msg/Mount", "weight_on_bit", "weight on bit"),
    ("rpud_msgs/msg/Mount", "feed", "position of the feed"),
    (rows.BOREHOLE, "depth", "depth of the hole"),
    (rows.BOREHOLE, rows.WALK, "walk of the bit"),
    ("rpud_msgs/msg/Rotation", "rate", "rate of rotation"),
    ("rpud_msgs/msg/Rotation", "torque", "torque of rock and cuttings"),
)


def write_report(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    report: Callable[[int], object] = lambda messages: None,
) -> Survey:
    """Write the report of a bag; return the survey that it shows."""
    check_new_file(out, ReportError)
    with rpud_sim.bag.open(path) as bag:
        seen = survey(bag, report)
    write_new_file(out, render(seen), ReportError)
    return seen


def render(seen: Survey) -> str:
    return render_page(BODY, Path(seen.path).resolve().name, headings=HEADINGS, **_context(seen))


def _context(seen: Survey) -> dict[str, Any]:
    shown, more = _series_topics(seen)
    marks = run_marks(seen)
    plots = TimePlots(seen.span, marks)
    late = [
        topic
        for topic in seen.topics.values()
        if topic.timing.delay.least < topic.timing.delay.greatest
    ]
    late = sorted(late, key=_rank)[:_MOST_PANELS]
    has_faults = any(log.faults for log in seen.faults.values())
    return {
        "tiles": _tiles(seen),
        "warnings": [
            f"Not in this report: {name}: {reason}"
            for name, reason in (*seen.left_out.items(), *seen.damaged.items())
        ],
        "bag": rows.bag_rows(seen),
        "runs": rows.run_rows(seen),
        "topics": rows.topic_rows(seen),
        "topics_more": max(0, len(seen.summaries) - rows.MOST_ROWS),
        "parameters": rows.parameter_rows(seen),
        "journals": [
            (name, [(f"{time:.6f}", *texts) for time, *texts in log.entries], log.unlisted)
            for name, log in seen.journals.items()
        ],
        "impacts": [_impacts(seen, name, plots) for name in seen.impacts],
        "segments": list(_segments(seen)),
        "waveforms": [
            _waveform(seen, name, f"closer-{number}")
            for number, name in enumerate(seen.waveforms, 1)
        ],
        "series": list(_all_series(shown, plots)),
        "series_more": ", ".join(more),
        "timing": rows.timing_rows(seen),
        "statuses": [
            (topic.name, rows.status_rows(topic))
            for topic in seen.topics.values()
            if topic.type == rows.STATUS and topic.find("real_time_factor").count
        ],
        "delays": plots.column([plots.delay(topic) for topic in late]) if late else None,
        "faults_plot": plots.column([plots.faults()]) if has_faults else None,
        "faults": [
            {"name": name, "rows": rows.fault_rows(log), "more": log.unlisted}
            for name, log in seen.faults.items()
        ],
    }


def _tiles(seen: Survey) -> list[tuple[str, str]]:
    losses = [summary.losses.total for summary in seen.summaries if summary.losses]
    lost = [count for count in losses if count is not None]
    tiles = [
        ("duration", f"{seen.duration:.2f} s"),
        ("messages", f"{seen.message_count:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")),
        ("lost", str(sum(lost)) if lost and len(lost) == len(losses) else "unknown"),
    ]
    for name in seen.impacts:
        figures = {figure: value for figure, value, _ in rows.impact_rows(seen, name)}
        for figure, text in (
            ("drill_tool_impact_rate", "impacts on the drill tool"),
            ("contact_force_mean", "mean peak force"),
            ("reacting_force_mean", "mean reacting force"),
        ):
            if figure in figures:
                tiles.append((text, figures[figure]))
    faults = sum(len(log.faults) for log in seen.faults.values())
    return [*tiles[:12], ("faults", str(faults) if seen.faults else "unknown")]


def _impacts(seen: Survey, name: str, plots: TimePlots) -> dict[str, Any]:
    topic, impacts = seen.topics[name], seen.impacts[name]
    has_impacts = topic.find("peak_force").count and topic.find("energy").count
    status = seen.sibling(name, rows.STATUS)
    powers = seen.powers.get(status.name) if status is not None else None
    account = []
    if status is not None and powers is not None:
        account = account_rows(powers, status.find("electrical_power").mean)
    return {
        "name": name,
        "figures": rows.impact_rows(seen, name),
        "energy": rows.energy_rows(seen, name) if has_impacts else [],
        "account": account,
        "reported": rows.show(powers.seconds, "s") if powers is not None else "",
        "flow": charts.power_flow(powers.means()) if account and powers is not None else "",
        "over_time": has_impacts
        and plots.column([*plots.impacts(impacts, topic), *_beside(seen, name, plots)]),
        "distributions": charts.distributions(impacts, topic) if has_impacts else [],
    }


def _beside(seen: Survey, name: str, plots: TimePlots) -> Iterator[Plot]:
    for kind, column in FORCES:
        topic = seen.sibling(name, kind)
        series = topic.series if topic is not None else ()
        found = [item for item in series if item.column.name == column and item.values.count]
        if found:
            yield plots.series(found[0], "reacting force")
            break
    for journal_name, journal in seen.journals.items():
        if namespace(journal_name) == namespace(name):
            yield from plots.weight_on_bit(journal.changes)
    for kind, column, title in _SLOW:
        topic = seen.sibling(name, kind)
        series = topic.series if topic is not None else ()
        for item in series:
            if item.column.name != column or not item.values.count:
                continue
            if column == rows.WALK and not item.values.greatest > 0.0:
                continue  # a bit that stays in its place needs no plot
            yield plots.series(item, title)


def _segments(seen: Survey) -> Iterator[dict[str, Any]]:
    for space, periods in seen.periods.items():
        if any(period.impacts or period.reacting_force.count for period in periods.all):
            topics = (*seen.journals, *seen.faults)
            yield {
                "name": space or "/",
                "rows": period_rows(periods),
                "more": periods.unlisted,
                "known": any(namespace(topic) == space for topic in topics),
            }


def _waveform(seen: Survey, name: str, column: str) -> dict[str, Any]:
    waveform = seen.waveforms[name]
    densities = waveform.spectrum.density(waveform.rate) if waveform.rate else None
    return {
        "name": name,
        "spectra": charts.spectra(densities) if densities else [],
        "segments": waveform.spectrum.segments,
        "length": 2 * (len(densities[0]) - 1) if densities else 0,
        "rate": rows.show(waveform.rate, "Hz"),
        "closer": closer(waveform, column) if waveform.closer else None,
    }


def _all_series(topics: Sequence[TopicSurvey], plots: TimePlots) -> Iterator[dict[str, Any]]:
    left = _MOST_PLOTS
    for topic in topics:
        followed = [item for item in topic.series if item.values.count]
        moving = [item for item in followed if item.values.least < item.values.greatest]
        constant = [item for item in followed if item not in moving]
        most = min(_MOST_PANELS, left)
        drawn = [plots.series(item) for item in moving[:most]]
        left -= len(drawn)
        more = [f"not drawn: {item.column.name}" for item in moving[most:]]
        if topic.left_out:
            more.append(f"not followed: {topic.left_out} fields beyond the first {MOST_SERIES}")
        yield {
            "name": topic.name,
            "column": plots.column(drawn) if drawn else None,
            "constant": ", ".join(
                f"{item.column.name} = {rows.show(item.values.mean, item.column.unit)}"
                for item in constant
            ),
            "more": "; ".join(more),
            "rows": rows.series_rows(topic),
        }


def _series_topics(seen: Survey) -> tuple[list[TopicSurvey], list[str]]:
    found = [
        topic
        for topic in seen.topics.values()
        if any(item.values.count for item in topic.series) and topic.summary.message_count > 1
    ]
    found.sort(key=_rank)
    return found[:_MOST_DRAWN], [topic.name for topic in found[_MOST_DRAWN:]]


def _rank(topic: TopicSurvey) -> tuple[int, str]:
    return (_ORDER.index(topic.type) if topic.type in _ORDER else len(_ORDER), topic.name)
