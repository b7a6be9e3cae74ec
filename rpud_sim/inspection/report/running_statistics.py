"""Running statistics in bounded memory: envelopes, distributions and spectra of streams."""

from __future__ import annotations

import math

import numpy as np

_BINS = 1000  # of an envelope
_CLASSES = 2048  # of a distribution
_GREATEST = 1e150  # squares of values beyond would overflow
_GAP = 3  # in usual distances between messages
_INSTANT = 1e-9  # s; log times are integer nanoseconds


def usable(values: np.ndarray) -> np.ndarray:
    """Return which values can be counted and drawn: finite ones, and not beyond 1e150."""
    return np.abs(values.astype(float, copy=False)) < _GREATEST


class Envelope:
    """Least, greatest and sum of values in equal parts of the time; parts double as time grows.

    ``duration`` is the expected length of the time [s].
    """

    def __init__(self, duration: float) -> None:
        self.width = max(duration, 1e-3) * 1.001 / _BINS  # of a part [s]
        # least, greatest, total, count: of the values in each part, shape (1000,).
        self.least = np.full(_BINS, np.inf)
        self.greatest = np.full(_BINS, -np.inf)
        self.total = np.zeros(_BINS)
        self.count = np.zeros(_BINS)

    def add(self, times: np.ndarray, values: np.ndarray) -> None:
        """Add usable values at times since the beginning, both of shape (n,)."""
        if not len(times):
            return
        while times.max() >= self.width * _BINS:
            self._double()
        parts = np.maximum(times / self.width, 0.0).astype(np.intp)
        if (parts[1:] >= parts[:-1]).all():  # a few runs are faster than many single values
            firsts = np.flatnonzero(np.diff(parts, prepend=-1))
            places = parts[firsts]
            least, greatest = (f.reduceat(values, firsts) for f in (np.minimum, np.maximum))
            self.least[places] = np.minimum(self.least[places], least)
            self.greatest[places] = np.maximum(self.greatest[places], greatest)
        else:
            np.minimum.at(self.least, parts, values)
            np.maximum.at(self.greatest, parts, values)
        self.total += np.bincount(parts, values, _BINS)
        self.count += np.bincount(parts, minlength=_BINS)

    def _double(self) -> None:
        half = np.zeros(_BINS // 2)
        self.width *= 2.0
        self.least = np.append(self.least.reshape(-1, 2).min(1), half + np.inf)
        self.greatest = np.append(self.greatest.reshape(-1, 2).max(1), half - np.inf)
        self.total = np.append(self.total.reshape(-1, 2).sum(1), half)
        self.count = np.append(self.count.reshape(-1, 2).sum(1), half)

    @property
    def times(self) -> np.ndarray:
        """Middle of each part, since the beginning [s]."""
        return (np.arange(_BINS) + 0.5) * self.width

    def steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times, shape (n,) [s], and least, mean and greatest from each on, shape (3, n).

        A value holds until the next one. If that is much later than usual, the value holds for the
        usual time, and NaN follow.
        """
        used = np.flatnonzero(self.count)
        values = np.array(
            [self.least[used], self.total[used] / self.count[used], self.greatest[used]]
        )
        apart = np.diff(used)
        usual = int(np.quantile(apart, 0.9, method="lower")) if len(apart) else 1
        ends = np.flatnonzero(np.append(apart > _GAP * usual, [True] * min(len(used), 1)))
        held = (used[ends] + usual) * self.width
        places = np.repeat(ends + 1, 2)
        more = np.array([values[:, ends], np.full((3, len(ends)), np.nan)])
        return (
            np.insert(used * self.width, places, np.repeat(held, 2)),
            np.insert(values, places, more.transpose(1, 2, 0).reshape(3, -1), axis=1),
        )


class Distribution:
    """Distribution of values: exact moments and extremes, and counts in equal classes.

    The classes double in width as the range grows, so that at least a thousand lie between the
    least and the greatest value.
    """

    def __init__(self) -> None:
        self.count = self.others = 0  # number of usable values, and of others
        # Of the usable values; NaN if there are none.
        self.mean = self.least = self.greatest = math.nan
        self._squares = 0.0  # sum of the squares of the deviations from the mean
        self._low, self._width = 0.0, 0.0
        self._counts = np.zeros(_CLASSES, np.int64)

    def add(self, values: np.ndarray) -> None:
        """Add values, shape (n,)."""
        valid = usable(values)
        found = values if valid.all() else values[valid]
        found = found.astype(float, copy=False)
        self.others += len(values) - len(found)
        if not len(found):
            return
        least, greatest = float(found.min()), float(found.max())
        if not self.count:
            self.mean, self.least, self.greatest = 0.0, least, greatest
            self._low = least
            tiny = max(abs(least), abs(greatest), 1e-290) * 1e-12
            self._width = max(greatest - least, tiny) * 1.001 / _CLASSES
        self.least, self.greatest = min(self.least, least), max(self.greatest, greatest)
        between = float(found.mean()) - self.mean
        together = self.count + len(found)
        self._squares += float(((found - found.mean()) ** 2).sum())
        self._squares += between**2 * self.count * len(found) / together
        self.mean += between * len(found) / together
        self.count = together
        while self.least < self._low:
            self._double(down=True)
        while self.greatest >= self._low + self._width * _CLASSES:
            self._double(down=False)
        classes = ((found - self._low) / self._width).astype(np.intp)
        self._counts += np.bincount(np.minimum(classes, _CLASSES - 1), minlength=_CLASSES)

    def _double(self, *, down: bool) -> None:
        halves = self._counts.reshape(-1, 2).sum(1)
        rest = np.zeros(_CLASSES // 2, np.int64)
        if down:
            self._low -= self._width * _CLASSES
        self._counts = np.append(rest, halves) if down else np.append(halves, rest)
        self._width *= 2.0

    @property
    def deviation(self) -> float:
        """Standard deviation; NaN if there are fewer than two values."""
        return math.sqrt(self._squares / (self.count - 1)) if self.count > 1 else math.nan

    @property
    def total(self) -> float:
        return self.mean * self.count if self.count else 0.0

    def quantile(self, part: float) -> float:
        """Return the value below which a part of all lies, to the width of a class."""
        if not self.count:
            return math.nan
        below = np.append(0, np.cumsum(self._counts))
        edges = self._low + self._width * np.arange(_CLASSES + 1)
        digit = 10.0 ** math.floor(math.log10(self._width))
        value = round(float(np.interp(part * self.count, below, edges)) / digit) * digit
        return min(max(value, self.least), self.greatest)

    def classes(self, most: int) -> tuple[np.ndarray, np.ndarray]:
        """Return counts, shape (n,), and edges, shape (n + 1,), of at most ``most`` classes."""
        used = np.flatnonzero(self._counts)
        if not len(used):
            return np.zeros(0, np.int64), np.zeros(1)
        first = int(used[0])
        step = -(-(int(used[-1]) + 1 - first) // most)
        counts = np.add.reduceat(self._counts, range(first, int(used[-1]) + 1, step))
        edges = self._low + self._width * (first + step * np.arange(len(counts) + 1))
        return counts, edges


class Intervals(Distribution):
    """Distribution of intervals, with classes that are equal in the logarithm.

    So the classes stay fine, even if one gap is a thousand times as long as the other intervals.
    """

    def __init__(self) -> None:
        super().__init__()
        self._logarithms = Distribution()

    def add(self, values: np.ndarray) -> None:
        """Add intervals, shape (n,) [s]."""
        super().add(values)
        self._logarithms.add(np.log10(np.maximum(values[usable(values)], _INSTANT)))

    def quantile(self, part: float) -> float:
        """Return the interval below which a part of all lies, to about a hundredth of it."""
        return min(max(10.0 ** self._logarithms.quantile(part), self.least), self.greatest)

    def classes(self, most: int) -> tuple[np.ndarray, np.ndarray]:
        """Return counts and edges as ``Distribution.classes`` does, with equal ratios of edges."""
        counts, edges = self._logarithms.classes(most)
        return counts, 10.0**edges


class Spectrum:
    """Power spectral densities by Welch's method, of samples that arrive block by block.

    Segments have Hann's window, overlap by half and lose their means. None spans a gap. ``length``
    is that of a segment [samples].
    """

    def __init__(self, channels: int, length: int = 2**14) -> None:
        self._length = length
        self._held = np.empty((channels, 0))
        self._sum: np.ndarray | None = None
        self.segments = 0  # number of averaged segments

    def add(self, samples: np.ndarray) -> None:
        """Add samples that follow the last ones without a gap, shape (channels, n)."""
        self._held = np.concatenate([self._held, samples], axis=1)
        half = self._length // 2
        count = self._held.shape[1] // half - 1
        if count < 1:
            return
        used = self._held[:, : (count + 1) * half]
        self._average(used, self._length, count)
        self._held = self._held[:, count * half :].copy()

    def gap(self) -> None:
        """Begin a new segment: the next samples do not follow the last ones."""
        self._held = self._held[:, :0]

    def density(self, rate: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Return frequencies, shape (n,) [Hz], and densities, shape (channels, n).

        Fewer samples than a segment give one shorter segment, and fewer than 256 give None.
        ``rate`` is of the samples [Hz].
        """
        length = self._length
        if self._sum is None:
            length = 2 ** int(math.log2(max(self._held.shape[1], 1)))
            if length < 256:
                return None
            self._average(self._held[:, :length], length, 1)
        assert self._sum is not None
        return np.fft.rfftfreq(length, 1.0 / rate), self._sum / self.segments / rate

    def _average(self, samples: np.ndarray, length: int, count: int) -> None:
        """Add the periodograms of half overlapping segments, by Welch's method.

        ``samples`` has the shape (channels, (count + 1) * length / 2); ``length`` is even.
        """
        parts = np.lib.stride_tricks.sliding_window_view(samples, length, axis=1)
        parts = parts[:, :: length // 2]
        window = 0.5 - 0.5 * np.cos(2.0 * np.pi / length * np.arange(length))  # Hann's
        turned = np.fft.rfft((parts - parts.mean(axis=2, keepdims=True)) * window)
        density = (turned.real**2 + turned.imag**2).sum(axis=1) / (window**2).sum()
        density[:, 1:-1] *= 2.0  # the power at negative frequencies too
        self._sum = density if self._sum is None else self._sum + density
        self.segments += count
