"""Survey of one topic of any type: its timing, and its numbers over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rpud_sim.bag import TopicSummary
from rpud_sim.bag.columns import Column, Kind
from rpud_sim.bag.tables import Batch
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.report.changing_value import ChangingValue
from rpud_sim.inspection.report.gaps import Gaps
from rpud_sim.inspection.report.running_statistics import Distribution, Envelope, Intervals, usable
from rpud_sim.inspection.report.timeline import Timeline

MOST_SERIES = 40  # number of columns of a topic that are surveyed; further ones are only counted

# Fields that number messages, or that only help to read them.
_NO_SERIES = {"sequence", "sample_period"}


@dataclass
class Series:
    """Column of numbers over time."""

    column: Column  # of the topic's table
    envelope: Envelope  # of its values over time
    # its exact changes, if they are few
    changing: ChangingValue = field(default_factory=ChangingValue)
    values: Distribution = field(default_factory=Distribution)  # their distribution


@dataclass
class Timing:
    """Timing of a topic's messages."""

    # from stamp to log time, over time [s]; for a block, from its last row's stamp
    delays: Envelope
    delay: Distribution = field(default_factory=Distribution)  # distribution of the same [s]
    intervals: Intervals = field(default_factory=Intervals)  # between the log times of messages [s]
    gaps: Gaps | None = None  # in ``sequence``; None if there is no such field
    stamped: bool = False  # whether messages have stamps

    @property
    def missing(self) -> int | None:
        """Number of messages that ``sequence`` skips; None if there is no such field."""
        return None if self.gaps is None else self.gaps.missing


def stamp_column(columns: Sequence[Column]) -> str:
    """Return the column with the times of a topic's rows: log_time if there is no stamp."""
    if columns[0].name == "time":
        return "time"
    stamped = any(column.name == "header.stamp" and column.kind is Kind.TIME for column in columns)
    return "header.stamp" if stamped else "log_time"


def is_latched(summary: TopicSummary) -> bool:
    """Whether a topic's first messages may be older than the bag."""
    return any(offer.durability == "transient_local" for offer in summary.topic.offered_qos)


class TopicSurvey:
    """Survey of one topic of a bag that begins at a log time [ns] and has a duration [s].

    ``zero`` is the stamp at its beginning, if another topic of the same clock shows it [ns].
    """

    def __init__(
        self,
        summary: TopicSummary,
        columns: tuple[Column, ...],
        begin: int,
        duration: float,
        zero: int | None = None,
    ) -> None:
        self.summary = summary
        self.end = 0.0  # last time since the bag began [s]
        self.timing = Timing(Envelope(duration))  # of its messages
        self._blocks = columns[0].name == "time"
        times = {column.name for column in columns if column.kind is Kind.TIME}
        self._stamped_blocks = self._blocks and "header.stamp" in times
        self._stamp = stamp_column(columns)
        # conversion of its stamps to times since the bag began
        self.timeline = (
            Timeline(begin)
            if self._stamp == "log_time"
            else Timeline(begin, zero, latched=is_latched(summary))
        )
        self.timing.stamped = self._stamp != "log_time"
        numbers = [
            column
            for column in columns
            if column.kind is Kind.NUMBER and column.name not in _NO_SERIES
        ]
        if summary.topic.type == "rpud_msgs/msg/Trajectory":
            numbers = []  # a drawing of its coefficients would show nothing
        # columns of numbers, at most ``MOST_SERIES``
        self.series = [Series(column, Envelope(duration)) for column in numbers[:MOST_SERIES]]
        self.left_out = len(numbers) - len(self.series)  # number of further ones
        if any(
            column.name == "sequence" and column.kind is Kind.NUMBER and column.dtype.kind in "iu"
            for column in columns
        ):
            self.timing.gaps = Gaps()
        self._last_log_time: int | None = None

    @property
    def name(self) -> str:
        return self.summary.topic.name

    @property
    def type(self) -> str:
        return self.summary.topic.type

    def add(self, batch: Batch) -> np.ndarray:
        """Add rows; return their times since the bag began, shape (n,) [s]."""
        columns = batch.columns
        times = self.timeline.elapsed(columns[self._stamp], columns["log_time"])
        for series in self.series:
            values = columns[series.column.name].astype(float, copy=False)
            series.values.add(values)
            valid = usable(values)
            chosen = slice(None) if valid.all() else valid  # nearly always all: no copies
            series.envelope.add(times[chosen], values[chosen])
            series.changing.add(times[chosen], values[chosen])
        if len(batch):
            self.end = max(self.end, float(times.max()))
            self._add_timing(columns, times)
        return times

    def find(self, column: str) -> Distribution:
        """Return the values of a column; empty if it is not surveyed."""
        found = (series.values for series in self.series if series.column.name == column)
        return next(found, Distribution())

    def _add_timing(self, columns: Mapping[str, np.ndarray], times: np.ndarray) -> None:
        last = np.arange(len(times))  # rows that are the last of their message
        if self._blocks:
            ends = np.diff(columns["log_time"]) != 0
            if self._stamped_blocks:
                ends |= np.diff(columns["header.stamp"]) != 0
            last = np.append(np.flatnonzero(ends), len(times) - 1)
        log_times = columns["log_time"][last]
        before = log_times[0] if self._last_log_time is None else self._last_log_time
        steps = np.diff(log_times, prepend=before) / SECOND
        self.timing.intervals.add(steps[1:] if self._last_log_time is None else steps)
        self._last_log_time = int(log_times[-1])
        if self.timing.stamped:
            delays = (log_times - columns[self._stamp][last]) / SECOND
            self.timing.delay.add(delays)
            self.timing.delays.add(times[last], delays)
        if self.timing.gaps is not None:
            self.timing.gaps.add(columns["sequence"].astype(np.int64), times)
