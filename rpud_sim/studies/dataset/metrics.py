"""Metrics of a detector of faults: delay of detection, F1 and false alarms per hour.

An alarm is a maximal row of windows whose score is above the limit. It is raised at the end of its
first window, when its features are known.

- An alarm that is raised while a fault lasts belongs to the fault. The first one detects it, and
  its delay counts from the onset.
- An alarm within ``RECOVERY`` after a fault is neither right nor wrong: the drill settles.
- Every other alarm is false. The hours for false alarms are those in which an alarm would be false.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence

import numpy as np

RECOVERY = 2.0
"""Time after a fault in which an alarm counts neither way, assumed [s]."""


@dataclasses.dataclass(frozen=True)
class ScoredRun:
    """Scores of the windows of a run, with its labels. Times count from the run's beginning [s]."""

    begin: float  # beginning of the first window
    ends: np.ndarray  # end of each window, increasing
    scores: np.ndarray  # of a detector, by window; NaN counts as no alarm
    kind: str = ""  # of the fault, empty in a healthy run
    severity: int = 0  # of the fault, zero in a healthy run
    onset: float = math.nan  # of the fault, NaN in a healthy run
    clear: float = math.inf  # of the fault, infinite if it lasts to the end


@dataclasses.dataclass(frozen=True)
class Judgement:
    """Alarms of a detector on one run."""

    detected: bool  # whether the fault was detected; False in a healthy run
    delay: float  # from onset to detection [s]; NaN without one
    false_alarms: int  # number of them
    hours: float  # in which an alarm would be false [h]


@dataclasses.dataclass(frozen=True)
class Metrics:
    """Metrics of a detector on several runs; what cannot be computed is NaN."""

    faults: int  # number of faults
    detected: int  # number of those that were detected
    false_alarms: int  # number of them
    hours: float  # in which an alarm would be false [h]
    delay_mean: float  # of the detected faults [s]
    delay_median: float  # of the detected faults [s]
    delay_greatest: float  # of the detected faults [s]

    @property
    def precision(self) -> float:
        """Share of detections among detections and false alarms."""
        return _ratio(self.detected, self.detected + self.false_alarms)

    @property
    def recall(self) -> float:
        """Share of the faults that were detected."""
        return _ratio(self.detected, self.faults)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall: 2 d / (faults + d + false alarms)."""
        return _ratio(2 * self.detected, self.faults + self.detected + self.false_alarms)

    @property
    def false_alarms_per_hour(self) -> float:
        """Number of false alarms in an hour in which an alarm would be false [1/h]."""
        return self.false_alarms / self.hours if self.hours > 0.0 else math.nan


def judge(run: ScoredRun, limit: float) -> Judgement:
    """Return the judgement of the alarms on a run; scores above the limit raise one."""
    above = run.scores > limit
    raised = run.ends[above & ~np.concatenate([[False], above[:-1]])]
    whole = float(run.ends[-1]) - run.begin if len(run.ends) else 0.0
    if math.isnan(run.onset):
        return Judgement(False, math.nan, len(raised), whole / 3600.0)
    during = raised[(raised >= run.onset) & (raised < run.clear)]
    wrong = raised[(raised < run.onset) | (raised >= run.clear + RECOVERY)]
    end = min(float(run.ends[-1]), run.clear + RECOVERY) if len(run.ends) else run.onset
    healthy = max(whole - max(end - max(run.onset, run.begin), 0.0), 0.0)
    delay = float(during[0]) - run.onset if len(during) else math.nan
    return Judgement(len(during) > 0, delay, len(wrong), healthy / 3600.0)


def evaluate(runs: Iterable[ScoredRun], limit: float) -> Metrics:
    """Return the metrics of a detector whose scores above the limit raise alarms."""
    runs = list(runs)
    judged = [judge(run, limit) for run in runs]
    delays = [item.delay for item in judged if item.detected]
    return Metrics(
        faults=sum(bool(run.kind) for run in runs),
        detected=len(delays),
        false_alarms=sum(item.false_alarms for item in judged),
        hours=math.fsum(item.hours for item in judged),
        delay_mean=math.fsum(delays) / len(delays) if delays else math.nan,
        delay_median=float(np.median(delays)) if delays else math.nan,
        delay_greatest=max(delays, default=math.nan),
    )


def choose_limit(runs: Sequence[ScoredRun], most: int = 200) -> float:
    """Return the limit with the greatest F1; of several the one with the fewest false alarms.

    If several remain, those with the shortest delay count, and the middle one of them is returned:
    it is the farthest from limits that are worse.

    Args:
        most: half the number of limits to try: quantiles of the scores, finer near the greatest.
    """
    scores = np.concatenate([run.scores for run in runs])
    finite = np.unique(scores[np.isfinite(scores)])
    if not len(finite):
        return math.inf
    near = 1.0 - np.geomspace(0.5 / len(finite), 0.5, most)
    levels = np.concatenate([np.linspace(0.0, 1.0, most), near])
    limits = np.unique(np.quantile(finite, levels, method="lower"))

    def worth(limit: float) -> tuple[float, int, float]:
        metrics = evaluate(runs, limit)
        delay = 0.0 if math.isnan(metrics.delay_mean) else metrics.delay_mean
        return (0.0 if math.isnan(metrics.f1) else metrics.f1, -metrics.false_alarms, -delay)

    worths = {limit: worth(limit) for limit in limits.tolist()}
    greatest = max(worths.values())
    best = [limit for limit, found in worths.items() if found == greatest]
    return best[len(best) // 2]


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else math.nan
