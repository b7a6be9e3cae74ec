"""Evaluation of the baselines on a data set: fitted to train, limits from validation, on test."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from rpud_sim.studies.dataset.detectors import Changepoynt, Detector, Threshold
from rpud_sim.studies.dataset.folder import RUNS, read_content, read_table
from rpud_sim.studies.dataset.metrics import Metrics, ScoredRun, choose_limit, evaluate
from rpud_sim.studies.dataset.specification import HEALTHY, SPLITS, DatasetError
from rpud_sim.studies.dataset.tables import WINDOW_LABELS, WINDOWS

MISSING = "changepoynt is not installed, its row is left out: pip install 'rpud_sim[dataset]'"


@dataclasses.dataclass(frozen=True)
class LabelledRun:
    """Features of the windows of a run, with its labels."""

    names: tuple[str, ...]  # of the features
    features: np.ndarray  # of each window, shape (windows, features)
    healthy: np.ndarray  # whether each window is before any fault
    labels: ScoredRun  # of the run, with scores that are all zero


@dataclasses.dataclass(frozen=True)
class Evaluated:
    """Result of a detector."""

    detector: str  # its name
    limit: float  # above which a score raises an alarm, from the validation split
    metrics: Metrics  # on the test split
    by_fault: dict[tuple[str, int], Metrics]  # metrics of the runs of each kind and severity


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Results of the baselines on the test split."""

    results: tuple[Evaluated, ...]  # of each detector
    left_out: tuple[str, ...]  # one line for each detector that was left out
    runs: int  # number of runs of the test split


def baselines() -> tuple[list[Detector], list[str]]:
    """Return the baselines that are installed, and a line for each that is not."""
    found: list[Detector] = [Threshold()]
    try:
        found.append(Changepoynt())
    except ModuleNotFoundError:
        return found, [MISSING]
    return found, []


def evaluate_dataset(path: Path, report: Callable[[int], None] = lambda scored: None) -> Evaluation:
    """Return the results of the baselines on a data set.

    Args:
        report: called with the number of runs that were scored since its last call.

    Raises:
        DatasetError: if the folder holds no complete data set, or a split has no runs.
    """
    content = read_content(path)
    splits = {split: read_runs(path, split, content) for split in SPLITS}
    for split, runs in splits.items():
        if not runs:
            raise DatasetError(f"{path}: no run of the split {split} has windows")
    found, left_out = baselines()
    return Evaluation(
        tuple(_evaluated(detector, splits, report) for detector in found),
        tuple(left_out),
        len(splits["test"]),
    )


def run_count(path: Path) -> int:
    """Return how many runs an evaluation scores."""
    splits = read_content(path)["splits"]
    return len(baselines()[0]) * sum(splits[split]["runs"] for split in ("validation", "test"))


def read_runs(path: Path, split: str, content: dict[str, Any]) -> list[LabelledRun]:
    """Return the runs of a split that have windows.

    Raises:
        DatasetError: if a table is missing or damaged.
    """
    windows = read_table(path, f"{WINDOWS}/{split}.parquet", content)
    runs = read_table(path, f"{RUNS}/{split}.parquet", content).to_pylist()
    if not windows.num_rows:
        return []
    columns = tuple(name for name in windows.column_names if name not in WINDOW_LABELS)
    features = _matrix(windows, columns)
    starts, ends = (windows[name].to_numpy() for name in ("start", "end"))
    names = np.array(windows["run"].to_pylist())
    begins = np.concatenate([[0], np.flatnonzero(names[1:] != names[:-1]) + 1, [len(names)]])
    rows = {names[a]: slice(a, b) for a, b in pairwise(begins.tolist())}
    labelled = []
    for run in runs:
        if run["run"] not in rows:
            continue
        part = rows[run["run"]]
        faulty = run["kind"] != HEALTHY
        labels = ScoredRun(
            float(starts[part][0]),
            ends[part],
            np.zeros(len(ends[part])),
            run["kind"] if faulty else "",
            run["severity"],
            run["onset"] if faulty else math.nan,
            math.inf if run["clear"] is None else run["clear"],
        )
        healthy = ends[part] <= labels.onset if faulty else np.ones(len(ends[part]), bool)
        labelled.append(LabelledRun(columns, features[part], healthy, labels))
    return labelled


def _evaluated(
    detector: Detector,
    splits: dict[str, list[LabelledRun]],
    report: Callable[[int], None],
) -> Evaluated:
    names = splits["train"][0].names
    wanted = [number for number, name in enumerate(names) if detector.wants(name)]
    detector.fit([run.features[run.healthy][:, wanted] for run in splits["train"]])

    def scored(runs: Sequence[LabelledRun]) -> list[ScoredRun]:
        found = []
        for run in runs:
            scores = detector.scores(run.features[:, wanted])
            found.append(dataclasses.replace(run.labels, scores=scores))
            report(1)
        return found

    limit = choose_limit(scored(splits["validation"]))
    test = scored(splits["test"])
    faults = sorted({(run.kind, run.severity) for run in test if run.kind})
    return Evaluated(
        detector.name,
        limit,
        evaluate(test, limit),
        {
            fault: evaluate([run for run in test if (run.kind, run.severity) == fault], limit)
            for fault in faults
        },
    )


def _matrix(table: pa.Table, names: Sequence[str]) -> np.ndarray:
    return np.column_stack([table[name].to_numpy().astype(float) for name in names])
