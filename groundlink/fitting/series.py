# SPDX-License-Identifier: Apache-2.0
"""Readings of a device at rest, at a steady rate, and their Allan variance."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError

Reals = NDArray[np.float64]

GAP_PERIODS = 10
"""Readings this far apart belong to two segments. A shorter gap counts as lost readings, which
change no statistic by more than their share."""

LEAST_READINGS = 100
"""Readings below which nothing is fitted."""

LEAST_CLUSTERS = 10
"""Independent means that a band of averaging times needs; its Allan deviation then has an error of
some 20 %, 1 sigma."""


class Series(NamedTuple):
    """Readings of a device at rest."""

    segments: list[Reals]
    """Each of shape (readings, axes), without gaps."""

    period_s: float
    """Time between two readings."""

    @property
    def readings(self) -> int:
        """Number of readings."""
        return sum(map(len, self.segments))

    @property
    def seconds(self) -> float:
        """Time that the readings cover, without gaps."""
        return self.readings * self.period_s

    def axes(self, first: int, last: int) -> "Series":
        """Return the axes from `first` to before `last`."""
        return Series([segment[:, first:last] for segment in self.segments], self.period_s)

    def halves(self) -> tuple["Series", "Series"]:
        """Return the first and the second half of the readings."""
        halves: tuple[list[Reals], list[Reals]] = [], []
        left = self.readings // 2
        for segment in self.segments:
            cut = min(max(left, 0), len(segment))
            for half, part in zip(halves, (segment[:cut], segment[cut:]), strict=True):
                if len(part):
                    half.append(part)
            left -= len(segment)
        return Series(halves[0], self.period_s), Series(halves[1], self.period_s)


class AllanBands(NamedTuple):
    """Overlapping Allan variance of a group of alike axes, by averaging times an octave apart."""

    seconds: Reals
    """Averaging times, shape (bands,)."""

    variance: Reals
    """Mean over the axes, shape (bands,)."""

    by_axis: Reals
    """Shape (bands, axes)."""

    clusters: NDArray[np.intp]
    """Independent means of one axis, shape (bands,)."""

    @property
    def is_noise(self) -> NDArray[np.bool_]:
        """Whether a band can be noise, shape (bands,).

        The variance of white noise halves from one averaging time to its double; that of drifts and
        of filtered noise falls less. A variance that falls by more, beyond the scatter of both, has
        periodic motion in it: vibration, or what is aliased from it.
        """
        scatter = 3 * np.hypot(self.sigma[:-1], self.sigma[1:])
        falls: NDArray[np.bool_] = self.variance[:-1] > 2 * self.variance[1:] * (1 + scatter)
        return ~np.append(falls, False)

    @property
    def sigma(self) -> Reals:
        """Error of `variance`, 1 sigma, relative.

        An estimate with n degrees of freedom scatters by sqrt(2 / n); the clusters of all axes are
        taken as these degrees, which is on the safe side for overlapping ones.
        """
        freedom = self.clusters * self.by_axis.shape[1]
        scatter: Reals = np.sqrt(2 / freedom)
        return scatter


def of_samples(times_s: Reals, values: Reals, source: str) -> Series:
    """Return the series of readings with their times.

    Parameters
    ----------
    times_s : shape (n,)
        Readings that are not later than the one before are left out.
    values : shape (n, axes)
        Rows with a NaN are left out.
    source : str
        Name of the recording, for errors.

    Raises
    ------
    UserError
        when there are too few.
    """
    known = np.isfinite(values).all(axis=1)
    times_s, values = times_s[known], values[known]
    if len(times_s):
        newer = times_s > np.concatenate([[-np.inf], np.maximum.accumulate(times_s)[:-1]])
        times_s, values = times_s[newer], values[newer]
    if len(times_s) < LEAST_READINGS:
        raise UserError(
            f"{source}: {len(times_s)} readings; expected at least {LEAST_READINGS}. Fix: record "
            "the device at rest for longer"
        )
    steps = np.diff(times_s)
    usual = np.median(steps)
    # Stamps of a driver scatter, and a lost reading makes a double step.
    period = float(steps[np.abs(steps - usual) < usual / 2].mean())
    breaks = np.flatnonzero(steps > GAP_PERIODS * period) + 1
    return Series(np.split(values, breaks), period)


def allan_bands(series: Series) -> AllanBands:
    """Return the Allan variance at averaging times of 1, 2, 4 ... readings, at least a tick.

    Half the mean square of the differences of neighboring means (IEEE Std 952-1997, annex C), over
    all places of the pair in all segments.
    """
    rows = []
    readings = math.ceil(TICK_SECONDS / series.period_s - 1e-6)
    while (clusters := _clusters(series, readings)) >= LEAST_CLUSTERS:
        squares, pairs = np.zeros(series.segments[0].shape[1]), 0
        for segment in series.segments:
            if len(segment) < 2 * readings:
                continue
            # Without its mean a sum of many readings keeps its digits.
            sums = np.cumsum(segment - segment.mean(axis=0), axis=0)
            sums = np.concatenate([np.zeros((1, sums.shape[1])), sums])
            means = (sums[readings:] - sums[:-readings]) / readings
            differences = means[readings:] - means[:-readings]
            squares += (differences**2).sum(axis=0)
            pairs += len(differences)
        rows.append((readings * series.period_s, squares / pairs / 2, clusters))
        readings *= 2
    seconds, variances, counts = zip(*rows, strict=True)
    by_axis = np.array(variances)
    return AllanBands(np.array(seconds), by_axis.mean(axis=1), by_axis, np.array(counts, np.intp))


def _clusters(series: Series, readings: int) -> int:
    return sum(len(one) // readings for one in series.segments if len(one) >= 2 * readings)


def step(values: Reals) -> float:
    """Return the quantization step of values of one axis; 0 for none.

    Values are quantized if they repeat and lie on a grid; readings that were scaled by a
    calibration of several axes do not.
    """
    levels = np.unique(values)
    if len(levels) < 3 or len(levels) > len(values) / 4:
        return 0.0
    span = levels[-1] - levels[0]
    apart = np.diff(levels)
    # Levels that differ by the rounding of their text or of float32 are one.
    apart = apart[apart > 1e-5 * span]
    least = float(np.quantile(apart, 0.1))
    rough = float(np.median(apart[apart < 1.5 * least]))
    found = float(span / np.rint(span / rough))
    places = (levels - levels[0]) / found
    return found if np.mean(np.abs(places - np.rint(places)) < 0.1) > 0.95 else 0.0
