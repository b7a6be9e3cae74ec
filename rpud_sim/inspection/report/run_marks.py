"""Marks of a run on all plots over time: its commands, its faults, and the gaps of its messages."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rpud_sim.inspection.report.changing_value import ChangingValue
from rpud_sim.inspection.report.drill_topics import Fault
from rpud_sim.inspection.report.gaps import Gap, merged, pauses
from rpud_sim.inspection.report.running_statistics import Envelope
from rpud_sim.inspection.report.survey import Survey, namespace
from rpud_sim.inspection.report.topic_survey import Series
from rpud_sim.pages.plot import COMMAND, FAULT, GAP, Mark

MOST_MARKS = 300  # number of marks of one kind
_FEWEST = 10  # messages of a topic whose pauses are gaps
_MOST_NAMES = 4  # topics that the text of a gap names


def run_marks(seen: Survey) -> list[Mark]:
    """Return the marks of a run: at most ``MOST_MARKS`` of each kind."""
    kinds = (_commands(seen), _faults(seen), _gaps(seen))
    return [
        mark for found in kinds for mark in sorted(found, key=lambda mark: mark.time)[:MOST_MARKS]
    ]


def fault_name(fault: Fault) -> str:
    """Return what a fault is called: its kind, and its channel if it has one."""
    return f"{fault.kind} {fault.channel}".strip()


def series_steps(series: Series, factor: float = 1.0) -> tuple[np.ndarray, np.ndarray] | None:
    """Return times [s] and values of a series, NaN in gaps; None if there are too many changes."""
    return exact_steps(series.changing, series.envelope, factor)


def exact_steps(
    changing: ChangingValue, envelope: Envelope, factor: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the steps of a value in the shown unit, without those in a gap of its envelope."""
    steps = changing.steps()
    if steps is None:
        return None
    times, values = steps
    for gap in pauses(*_means(envelope)):
        if gap.end <= times[0] or gap.begin >= times[-1]:
            continue
        held = values[max(int(np.searchsorted(times, gap.end, side="right")) - 1, 0)]
        kept = (times <= gap.begin) | (times >= gap.end)
        times, values = times[kept], values[kept]
        place = int(np.searchsorted(times, gap.begin, side="right"))
        times = np.insert(times, place, [gap.begin, gap.end])
        values = np.insert(values, place, [np.nan, held])
    return times, factor * values


def _commands(seen: Survey) -> Iterator[Mark]:
    several = len(seen.journals) > 1
    for name, journal in seen.journals.items():
        for change in journal.changes:
            if change.time > 0.0:
                where = f"{namespace(name)}: " if several else ""
                yield Mark(COMMAND, change.time, f"{where}{change.text}")


def _faults(seen: Survey) -> Iterator[Mark]:
    several = len(seen.faults) > 1
    for name, log in seen.faults.items():
        for fault in log.faults.values():
            where = f"{namespace(name)}: " if several else ""
            yield Mark(FAULT, fault.onset, f"{where}{fault_name(fault)}", fault.clear)


def _gaps(seen: Survey) -> Iterator[Mark]:
    for begin, end, texts in merged(_all_gaps(seen)):
        more = f" and {len(texts) - _MOST_NAMES} more" if len(texts) > _MOST_NAMES else ""
        yield Mark(GAP, begin, f"missing: {', '.join(texts[:_MOST_NAMES])}{more}", end)


def _all_gaps(seen: Survey) -> Iterator[tuple[str, Gap]]:
    for name, topic in seen.topics.items():
        if topic.timing.gaps is not None:
            for gap in topic.timing.gaps.found:
                yield f"{name} ({gap.missing})", gap
        elif topic.summary.message_count > _FEWEST and topic.series:
            for gap in pauses(*_means(topic.series[0].envelope)):
                yield name, gap


def _means(envelope: Envelope) -> tuple[np.ndarray, np.ndarray]:
    times, values = envelope.steps()
    return times, values[1]
