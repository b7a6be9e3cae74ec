"""Baselines: detectors of faults that score each window from what was published up to its end."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from rpud_sim.simulation.channels import CHANNELS

# Score of a window in which a feature is missing that never was in training.
_NEVER_SEEN = 1e9
# Spread of a feature, as a share of its value, below which it is constant.
_TINY = 1e-12


class Detector(Protocol):
    """Detector that is fitted to healthy windows, and gives each window of a run a score."""

    name: str

    def wants(self, feature: str) -> bool:
        """Whether it uses a feature, such as ``wrench.wrench.force.z.mean``."""

    def fit(self, runs: Sequence[np.ndarray]) -> None:
        """Fit to the features of healthy windows of each run, shape (windows, features)."""

    def scores(self, run: np.ndarray) -> np.ndarray:
        """Return the score of each window; none depends on a later window."""


class Threshold:
    """Threshold: the greatest distance of a feature from its mean in healthy training windows.

    Distances are in standard deviations. A feature that was constant in training has none and does
    not count. One that is missing though it never was in training counts as never seen.
    """

    name = "threshold"

    def wants(self, feature: str) -> bool:
        """Return that it uses all features."""
        return True

    def fit(self, runs: Sequence[np.ndarray]) -> None:
        """Fit mean and standard deviation of each feature; infinite where it is constant."""
        values = np.concatenate(list(runs))
        finite = np.isfinite(values)
        self._always = finite.all(axis=0)
        counts = np.maximum(finite.sum(axis=0), 1)
        held = np.where(finite, values, 0.0)
        self._mean = held.sum(axis=0) / counts
        squares = np.where(finite, (held - self._mean) ** 2, 0.0)
        deviation = np.sqrt(squares.sum(axis=0) / counts)
        varies = deviation > _TINY * np.maximum(np.abs(self._mean), _TINY)
        self._deviation = np.where(varies, deviation, np.inf)

    def scores(self, run: np.ndarray) -> np.ndarray:
        """Return the greatest distance in each window."""
        finite = np.isfinite(run)
        scores = np.abs(np.where(finite, run, self._mean) - self._mean) / self._deviation
        scores[~finite & self._always] = _NEVER_SEEN
        return np.asarray(np.minimum(scores, _NEVER_SEEN).max(axis=1))


class Changepoynt:
    """ESST of the package changepoynt: how much the subspace of a feature's course changes.

    S. Boelter, L. Weber et al., "Fault prediction in planetary drilling using subspace analysis
    techniques", IAS-19, 2025. Each feature is brought to its range in healthy training windows, and
    its score to the greatest one there. A window has the greatest score of all features. The
    package gives a score to the middle of the windows that it is computed from; here it counts when
    the last one of them is known.

    Raises:
        ModuleNotFoundError: if the package is not installed.
    """

    name = "changepoynt"
    WINDOW = 10
    """Windows in a row of the algorithm's matrices, assumed."""

    def __init__(self) -> None:
        from changepoynt.algorithms.esst import ESST

        self._algorithm = ESST(self.WINDOW, scale=False)
        self._before = self._algorithm.covered_regions()[0]
        self._offset = self._algorithm.compute_offset()

    def wants(self, feature: str) -> bool:
        """Whether it uses a feature: counts, and means of the channels' main quantities.

        Of topics that are no channels it uses all means. To score all features takes minutes.
        """
        topic, _, rest = feature.partition(".")
        field, _, statistic = rest.rpartition(".")
        if topic not in CHANNELS:
            return statistic == "mean"
        main = ".".join(CHANNELS[topic].numbers[0])
        return rest == "count" or (statistic == "mean" and field == main)

    def fit(self, runs: Sequence[np.ndarray]) -> None:
        """Fit the range of each feature, and its greatest score in long enough healthy parts."""
        values = np.concatenate(list(runs))
        usable = np.isfinite(values).any(axis=0)
        held = np.where(np.isfinite(values), values, np.nan)
        self._low = np.zeros(values.shape[1])
        self._width = np.zeros(values.shape[1])
        self._low[usable] = np.nanmin(held[:, usable], axis=0)
        self._width[usable] = np.nanmax(held[:, usable], axis=0) - self._low[usable]
        self._chosen = np.flatnonzero(self._width > _TINY * np.maximum(np.abs(self._low), _TINY))
        found = [self._scores(run) for run in runs if len(run) >= self._before]
        greatest = [scores.max(axis=0) for scores in found]
        self._greatest = np.maximum(np.max(greatest, axis=0, initial=_TINY), _TINY)

    def scores(self, run: np.ndarray) -> np.ndarray:
        """Return the greatest score in each window; zero until enough windows are known."""
        if len(run) < self._before or not len(self._chosen):
            return np.zeros(len(run))
        return np.asarray((self._scores(run) / self._greatest).max(axis=1))

    def _scores(self, run: np.ndarray) -> np.ndarray:
        """Return the scores of the features that vary, shape (windows, features)."""
        scores = np.zeros((len(run), len(self._chosen)))
        for i, feature in enumerate(self._chosen.tolist()):
            share = (_held(run[:, feature]) - self._low[feature]) / self._width[feature]
            # From 1 to 2, as the package's own scaling, which would look at later windows.
            course = 1.0 + np.clip(share, -1.0, 2.0)
            # The score of a place needs those before it: one more place gives the last window its.
            # Where a course does not vary at all, the package divides zero by zero: no change.
            with _fixed_random_numbers(), np.errstate(invalid="ignore"):
                found = np.nan_to_num(self._algorithm.transform(np.append(course, course[-1])))
            first = self._before - self._offset
            scores[self._before - 1 :, i] = found[first : len(run) + 1 - self._offset]
        return scores


def _held(values: np.ndarray) -> np.ndarray:
    """Return values whose gaps have the value before; zero before the first."""
    finite = np.isfinite(values)
    last = np.maximum.accumulate(np.where(finite, np.arange(len(values)), -1))
    return np.where(last >= 0, np.where(finite, values, 0.0)[last], 0.0)


@contextlib.contextmanager
def _fixed_random_numbers() -> Iterator[None]:
    """Give the package the same random numbers at each call: it draws from NumPy's global ones."""
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(state)  # noqa: NPY002
