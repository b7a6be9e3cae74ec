"""Report of a bag: one HTML page without scripts, network or other files."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rpud_sim.bag
from rpud_sim.inspection.output import output_reason
from rpud_sim.inspection.report import pictures, rows
from rpud_sim.inspection.report.power_flow import power_flow
from rpud_sim.inspection.report.survey import Survey, survey
from rpud_sim.inspection.report.template import BODY, HEADINGS
from rpud_sim.inspection.report.topic_survey import MOST_SERIES, TopicSurvey
from rpud_sim.pages.frame import render_page

_MOST_DRAWN = 20  # topics
_MOST_PANELS = 12  # of a picture

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


def write_report(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    report: Callable[[int], object] = lambda messages: None,
) -> Survey:
    """Write the report of a bag; return the survey that it shows.

    Args:
        path: of the bag.
        out: of the new HTML file.
        report: called with the number of messages that were read since its last call.

    Raises:
        BagError: if the bag cannot be read.
        ReportError: if the file exists, its folder does not, or it cannot be written.
    """
    target = Path(out)
    if os.path.lexists(target):
        raise ReportError(output_reason(out, FileExistsError()))
    if not target.parent.is_dir():
        raise ReportError(f"cannot write {out}: there is no folder {target.parent}")
    with rpud_sim.bag.open(path) as bag:
        seen = survey(bag, report)
    page = render(seen)
    try:
        file = target.open("x", encoding="utf-8")
    except OSError as error:
        raise ReportError(output_reason(out, error)) from error
    try:
        with file:
            file.write(page)
    except BaseException as error:
        target.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise ReportError(output_reason(out, error)) from error
        raise
    return seen


def render(seen: Survey) -> str:
    """Return the page of a survey."""
    return render_page(BODY, Path(seen.path).resolve().name, headings=HEADINGS, **_context(seen))


def _context(seen: Survey) -> dict[str, Any]:
    shown, more = _series_topics(seen)
    late = [
        topic
        for topic in seen.topics.values()
        if topic.timing.delay.least < topic.timing.delay.greatest
    ]
    late = sorted(late, key=_rank)[:_MOST_PANELS]
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
        "impacts": [_impacts(seen, name) for name in seen.impacts],
        "waveforms": [_waveform(seen, name) for name in seen.waveforms],
        "series": [_series(topic, seen.span) for topic in shown],
        "series_more": ", ".join(more),
        "timing": rows.timing_rows(seen),
        "statuses": [
            (topic.name, rows.status_rows(topic))
            for topic in seen.topics.values()
            if topic.type == rows.STATUS and topic.find("real_time_factor").count
        ],
        "delays": pictures.encode(pictures.delays, late, seen.span) if late else "",
        "faults": [
            {
                "name": name,
                "rows": rows.fault_rows(log),
                "more": log.unlisted,
                "picture": pictures.encode(pictures.faults, log.faults, seen.span),
            }
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


def _impacts(seen: Survey, name: str) -> dict[str, Any]:
    topic, impacts = seen.topics[name], seen.impacts[name]
    has_impacts = topic.find("peak_force").count and topic.find("energy").count
    powers = rows.mean_powers(seen, name)
    return {
        "name": name,
        "figures": rows.impact_rows(seen, name),
        "energy": rows.energy_rows(seen, name) if has_impacts else [],
        "flow": pictures.encode(power_flow, powers) if powers else "",
        "over_time": has_impacts
        and pictures.encode(pictures.impacts_over_time, impacts, topic, seen.span),
        "distributions": has_impacts and pictures.encode(pictures.distributions, impacts, topic),
    }


def _waveform(seen: Survey, name: str) -> dict[str, Any]:
    waveform = seen.waveforms[name]
    densities = waveform.spectrum.density(waveform.rate) if waveform.rate else None
    return {
        "name": name,
        "spectra": pictures.encode(pictures.spectra, waveform, densities) if densities else "",
        "segments": waveform.spectrum.segments,
        "length": 2 * (len(densities[0]) - 1) if densities else 0,
        "rate": rows.show(waveform.rate, "Hz"),
        "closer": pictures.encode(pictures.closer, waveform) if waveform.closer else "",
    }


def _series(topic: TopicSurvey, span: float) -> dict[str, Any]:
    followed = [item for item in topic.series if item.values.count]
    moving = [item for item in followed if item.values.least < item.values.greatest]
    constant = [item for item in followed if item not in moving]
    drawn = moving[:_MOST_PANELS]
    more = [f"not drawn: {item.column.name}" for item in moving[_MOST_PANELS:]]
    if topic.left_out:
        more.append(f"not followed: {topic.left_out} fields beyond the first {MOST_SERIES}")
    return {
        "name": topic.name,
        "picture": pictures.encode(pictures.series, drawn, span) if drawn else "",
        "constant": ", ".join(
            f"{item.column.name} = {rows.show(item.values.mean, item.column.unit)}"
            for item in constant
        ),
        "more": "; ".join(more),
        "rows": rows.series_rows(topic),
    }


def _series_topics(seen: Survey) -> tuple[list[TopicSurvey], list[str]]:
    """Return the topics whose series are drawn, and the names of further ones with series."""
    found = [
        topic
        for topic in seen.topics.values()
        if any(item.values.count for item in topic.series) and topic.summary.message_count > 1
    ]
    found.sort(key=_rank)
    return found[:_MOST_DRAWN], [topic.name for topic in found[_MOST_DRAWN:]]


def _rank(topic: TopicSurvey) -> tuple[int, str]:
    return (_ORDER.index(topic.type) if topic.type in _ORDER else len(_ORDER), topic.name)
