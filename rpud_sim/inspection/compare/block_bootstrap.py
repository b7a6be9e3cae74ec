"""Standard errors of correlated series: the stationary bootstrap of Politis and Romano.

Values that follow each other in a run depend on each other. A bootstrap that draws single values
takes them for independent, and its intervals are too short. The stationary bootstrap (Politis and
Romano 1994) draws blocks of random length instead. Its variance of the mean is known in closed
form (their equation 9), so nothing is drawn here: the result is that of infinitely many
repetitions, needs no seed, and is the same each time. The mean length of the blocks follows from
the series by the rule of Politis and White (2004), as corrected by Patton, Politis and White
(2009).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_LONGER = 3.0  # times the rule's length: the rule weighs bias like noise, coverage wants less bias
_FEWEST_BLOCKS = 8  # of the mean length in a series
_MOST_VALUES = 2**16  # of a series whose autocovariances are computed
_SIGNIFICANT = 2.0  # standard errors above which an autocorrelation counts


@dataclass(frozen=True)
class MeanError:
    """Error of the mean of a correlated series."""

    error: float  # standard error, in the unit of the values
    blocks: float  # number of blocks in the series: about so many values are independent


def mean_error(values: np.ndarray) -> MeanError:
    """Return the error of the mean of a stationary series (n,); a long one is grouped first."""
    values = grouped(values, _MOST_VALUES)
    covariances = autocovariances(values)
    longest = max(1.0, len(values) / _FEWEST_BLOCKS)
    length = min(_LONGER * block_length(covariances), longest)
    return MeanError(math.sqrt(mean_variance(covariances, length)), len(values) / length)


def grouped(values: np.ndarray, most: int) -> np.ndarray:
    """Return means of consecutive values, shape (n,), in at most ``most`` groups of one size.

    A remainder at the end that fills no group is left out.
    """
    size = -(-len(values) // most)
    if size <= 1:
        return np.asarray(values, float)
    count = len(values) // size
    groups = np.asarray(values[: count * size], float).reshape(count, size)
    return np.asarray(groups.mean(axis=1))


def autocovariances(values: np.ndarray) -> np.ndarray:
    """Return the autocovariance of a stationary series (n,) at each lag; first the variance."""
    count = len(values)
    deviations = values - values.mean()
    # Zeros after the end keep the series from being taken for a circle.
    length = 2 ** math.ceil(math.log2(max(2 * count, 2)))
    spectrum = np.fft.rfft(deviations, length)
    return np.fft.irfft(np.abs(spectrum) ** 2, length)[:count] / count


def block_length(covariances: np.ndarray) -> float:
    """Return the mean length of blocks that makes the error of the variance least, from 1 on.

    ``covariances`` are the autocovariances at each lag, shape (n,).
    """
    count = len(covariances)
    if count < 4 or not covariances[0] > 0.0:
        return 1.0
    longest = max(1.0, min(3.0 * math.sqrt(count), count / 3.0))
    correlations = covariances / covariances[0]
    lag = _last_significant_lag(correlations)
    reach = min(2 * lag, count - 1)
    lags = np.arange(1, reach + 1)
    # The flat top keeps the significant lags whole, and fades the next ones out.
    weights = np.minimum(1.0, 2.0 * (1.0 - lags / max(2 * lag, 1)))
    # Squares of correlations stay in the range of floats where those of covariances may not.
    weighted = weights * correlations[1 : reach + 1]
    slope = 2.0 * float((lags * weighted).sum())
    density = 1.0 + 2.0 * float(weighted.sum())
    if not density > 0.0:
        return longest
    # Not the third root of squares, which may be no floats any more.
    best = float(abs(slope / density) ** (2.0 / 3.0) * count ** (1.0 / 3.0))
    return min(max(best, 1.0), longest)


def _last_significant_lag(correlations: np.ndarray) -> int:
    count = len(correlations)
    bound = _SIGNIFICANT * math.sqrt(math.log10(count) / count)
    row = max(5, math.ceil(math.sqrt(math.log10(count))))
    most = min(count - 1, math.ceil(math.sqrt(count)) + row)
    quiet = np.abs(correlations[1 : most + 1]) < bound
    for lag in range(max(len(quiet) - row + 1, 0)):
        if quiet[lag : lag + row].all():
            return max(lag, 1)
    loud = np.flatnonzero(~quiet)
    return int(loud[-1]) + 1 if len(loud) else 1


def mean_variance(covariances: np.ndarray, length: float) -> float:
    """Return the variance of the mean by the stationary bootstrap of autocovariances (n,)."""
    count = len(covariances)
    lags = np.arange(1, count)
    stays = 1.0 - 1.0 / length  # chance that the next value is of the same block
    # The series closes to a circle, so each lag also occurs the other way round.
    weights = (1.0 - lags / count) * stays**lags + lags / count * stays ** (count - lags)
    total = float(covariances[0]) + 2.0 * float((weights * covariances[1:]).sum())
    return max(total, 0.0) / count
