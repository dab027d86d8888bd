# SPDX-License-Identifier: Apache-2.0
"""Noise of a device at rest as Groundlink models it, fitted to its Allan variance.

An error is the sum of white noise (through a low pass, if there is one), a drift (a Gauss-Markov
process), a random walk and rounding. Each adds to the Allan variance (IEEE Std 952-1997, annex C),
and but for the drift's time constant and the low pass, the sum is linear in the unknowns. So these
two are searched on a grid, and for each of its points the rest is a least-squares problem without
negative unknowns.

A recording shows a parameter if the fit without it is worse than the scatter of the Allan variance
explains. What it does not show keeps the value of the base sheet.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from groundlink.core.clock import TICK_RATE_HZ, TICK_SECONDS

from .series import AllanBands, Reals

MODEL_SIGMAS = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Relative errors of a variance, 1 sigma, that the model is allowed in each band. The least is
taken with which chi^2 is no larger than the number of bands: no device is exactly such a sum, and
the shortest averaging times, with thousands of clusters, must not decide all."""

WORSE = 4.0
"""Decrease of chi^2 from which on a recording shows a parameter (2 sigma)."""

ROUNDS = 4
"""Rounds of least squares, each with weights of the one before."""

TIMES = 60
"""Time constants that are tried."""

SHORTEST_S = 1.0
"""Least time constant of a sheet."""

LOW_PASSES_HZ = tuple(float(f) for f in np.round(np.geomspace(5, 200, 38), 1))
PEAK_TIMES = 1.8925
"""Averaging time of the highest Allan variance of a drift, in time constants (the same, C.1.4)."""

SLOW = 50.0
"""Averaging time times bandwidth from which on a low pass has no effect (1 % of the variance)."""

_FREQUENCIES = (np.arange(20_000) + 0.5) * TICK_RATE_HZ / 40_000


class NoiseCurve(NamedTuple):
    """Sizes of a device's errors, in units of its quantity."""

    white: float
    """Density of the white noise, per root hertz."""

    drift: float
    """1 sigma of the drift."""

    time_s: float
    """Correlation time of the drift."""

    walk: float = 0.0
    """Density of the random walk: its sigma after a second."""

    low_pass_hz: float = 0.0
    """-3 dB frequency of the low pass of the white noise; 0 for none."""

    rounding: float = 0.0
    """Density of the noise of rounding."""

    sample_s: float = TICK_SECONDS
    """Time between samples of the drift. Readings are means of these, or each is one."""

    def variance(self, seconds: Reals) -> Reals:
        """Return the Allan variance at averaging times."""
        return (
            self.white**2 * white_noise(seconds, self.low_pass_hz)
            + self.rounding**2 / seconds
            + self.drift**2 * gauss_markov(seconds, self.time_s, self.sample_s)
            + self.walk**2 * seconds / 3
        )


def white_noise(seconds: Reals, low_pass_hz: float = 0.0) -> Reals:
    """Return the Allan variance of white noise of density 1 behind a Butterworth low pass.

    Groundlink draws noise for each tick. With f the frequency, t a tick and tau = M t, the variance
    is the integral of 2 sin^4(pi f tau) / (M sin(pi f t))^2 |W|^2 over -1/2t .. 1/2t, where W is
    the low pass H = 1 / (1 + sqrt(2) jx - x^2), x = f / low_pass_hz, for values that are constant
    within a tick. Without a low pass it is 1 / tau.
    """
    if not low_pass_hz:
        return 1 / seconds
    return np.array([_filtered_noise(float(tau), low_pass_hz) for tau in seconds])


@cache
def _filtered_noise(tau: float, low_pass_hz: float) -> float:
    if tau * low_pass_hz > SLOW:
        return 1 / tau
    through = np.zeros(len(_FREQUENCIES), np.complex128)
    for alias in _FREQUENCIES + TICK_RATE_HZ * np.arange(-3, 4)[:, None]:
        x = alias / low_pass_hz
        held = np.sinc(alias * TICK_SECONDS) * np.exp(-1j * np.pi * alias * TICK_SECONDS)
        through += held / (1 + math.sqrt(2) * 1j * x - x**2)
    means = np.sin(np.pi * _FREQUENCIES * tau) ** 4
    means /= (tau / TICK_SECONDS * np.sin(np.pi * _FREQUENCIES * TICK_SECONDS)) ** 2
    return float(4 * np.sum(means * np.abs(through) ** 2) * (_FREQUENCIES[1] - _FREQUENCIES[0]))


def gauss_markov(seconds: Reals, time_s: float, sample_s: float = TICK_SECONDS) -> Reals:
    """Return the Allan variance of a Gauss-Markov process of variance 1.

    With m samples in an averaging time and a = exp(-sample_s / time_s), the variance of a mean is
    (m + 2 a (m (1 - a) - (1 - a^m)) / (1 - a)^2) / m^2, and the covariance of neighboring means is
    a ((1 - a^m) / (1 - a))^2 / m^2. The Allan variance is their difference. Of short samples it is
    that of the standard, C.1.4.
    """
    m, decay = seconds / sample_s, sample_s / time_s
    a, lost = math.exp(-decay), -math.expm1(-decay)
    gone = -np.expm1(-m * decay)
    of_mean = m + 2 * a * (m * lost - gone) / lost**2
    variance: Reals = (of_mean - a * (gone / lost) ** 2) / m**2
    return variance


LEVELS = ("white", "drift", "walk")
"""Parameters whose squares the variance is linear in."""

NO_ERRORS = dict.fromkeys((*LEVELS, "rounding"), 0.0)

DRIFT_PEAK = float(np.sqrt(gauss_markov(np.array([PEAK_TIMES]), 1.0, 1e-4)[0]))
"""Highest Allan deviation of a drift of sigma 1."""


class CurveFit(NamedTuple):
    """Errors of a device, fitted to a recording."""

    bands: AllanBands
    curve: NoiseCurve
    fitted: Sequence[str]
    """Names of the parameters that the recording shows; the others are the base's."""

    errors: Mapping[str, float]
    """1 sigma of the fitted parameters that are not zero, relative, by name."""

    @property
    def differences(self) -> Reals:
        """Allan deviation of the curve over that of the recording, less 1, by band."""
        apart: Reals = np.sqrt(self.curve.variance(self.bands.seconds) / self.bands.variance) - 1
        return apart

    def rows(self) -> list[dict[str, float | bool]]:
        """Return the bands: averaging time, Allan deviations, difference, and whether fitted."""
        columns = {
            "seconds": self.bands.seconds,
            "recorded": np.sqrt(self.bands.variance),
            "fitted": np.sqrt(self.curve.variance(self.bands.seconds)),
            "difference": self.differences,
            "is_noise": self.bands.is_noise,
        }
        table = zip(*(column.tolist() for column in columns.values()), strict=True)
        return [dict(zip(columns, row, strict=True)) for row in table]


def allan_table(what: str, fit: CurveFit, axes: Sequence[str]) -> Iterator[str]:
    """Yield the lines of a table of Allan deviations, and how the axes differ.

    Parameters
    ----------
    what : str
        Quantity and unit.
    fit : CurveFit
    axes : sequence of str
        Names of the axes.
    """
    yield f"Allan deviation of {what}, by averaging time:"
    for row in fit.rows():
        yield (
            f"{row['seconds']:10.3g} s: recorded {row['recorded']:.3g}, fitted "
            f"{row['fitted']:.3g} ({row['difference']:+.0%})"
            + ("" if row["is_noise"] else ", has vibration, left out")
        )
    if len(axes) > 1:
        ratios = np.sqrt(np.median(fit.bands.by_axis / fit.bands.variance[:, None], axis=0))
        shares = (f"{axis} {ratio:.2f}" for axis, ratio in zip(axes, ratios, strict=True))
        yield f"Axes over their mean: {', '.join(shares)}."


def fit_curves(
    groups: Sequence[AllanBands], bases: Sequence[NoiseCurve], choices: Iterable[Sequence[str]]
) -> list[CurveFit]:
    """Return the fitted errors of groups of axes whose drifts have one time constant.

    Parameters
    ----------
    groups : sequence of AllanBands
    bases : sequence of NoiseCurve
        Values of the base sheet, with one `time_s`, and the rounding of the recording.
    choices : iterable of sequence of str
        Names of the parameters to fit. Of the choices, that is taken whose chi^2 with
        `WORSE` for each parameter is the least (Akaike's criterion).
    """
    choices = list(choices)
    for model_sigma in MODEL_SIGMAS:
        weighted = [_Weighted(bands, model_sigma) for bands in groups]
        misfit, curves, names = min(
            (_best(weighted, bases, names) for names in choices),
            key=lambda fit: fit[0] + WORSE * len(fit[2]),
        )
        if misfit <= sum(len(bands.seconds) for bands in groups):
            break
    return [
        CurveFit(one.bands, curve, names, _errors(one, curve, names))
        for one, curve in zip(weighted, curves, strict=True)
    ]


class _Weighted(NamedTuple):
    """Bands, and what the model may be off."""

    bands: AllanBands
    model_sigma: float

    @property
    def sigma(self) -> Reals:
        """Relative error of each band's variance; infinite for one that is no noise."""
        sigma = np.hypot(self.bands.sigma, self.model_sigma)
        return np.where(self.bands.is_noise, sigma, np.inf)


def _best(
    groups: Sequence[_Weighted], bases: Sequence[NoiseCurve], names: Sequence[str]
) -> tuple[float, list[NoiseCurve], Sequence[str]]:
    """Return chi^2, the best curves with these parameters, and the names of the parameters."""
    curves = _fitted_levels(groups, bases, names)
    # One after the other, twice: a drift and a low pass show at other averaging times.
    for name, grid in 2 * list(_grids(groups).items()):
        if name in names and grid:
            options = [
                _fitted_levels(groups, [c._replace(**{name: value}) for c in curves], names)
                for value in grid
            ]
            curves = min(options, key=lambda option: _misfit(groups, option))
    return _misfit(groups, curves), curves, names


def _grids(groups: Sequence[_Weighted]) -> dict[str, list[float]]:
    """Return the values to try of the parameters that are not linear."""
    longest = min(one.bands.seconds[-1] for one in groups) / PEAK_TIMES
    shortest = max(one.bands.seconds[0] for one in groups)
    times = np.geomspace(max(shortest, SHORTEST_S), longest, TIMES) if longest > SHORTEST_S else ()
    return {
        "time_s": [float(time) for time in times],
        "low_pass_hz": [f for f in LOW_PASSES_HZ if f < 0.5 / shortest],
    }


def _misfit(groups: Sequence[_Weighted], curves: Sequence[NoiseCurve]) -> float:
    """Return chi^2 over the bands of all groups."""
    return sum(
        float(np.sum((np.log(curve.variance(bands.seconds) / bands.variance) / one.sigma) ** 2))
        for one, curve in zip(groups, curves, strict=True)
        for bands in (one.bands,)
    )


def _fitted_levels(
    groups: Sequence[_Weighted], curves: Sequence[NoiseCurve], names: Sequence[str]
) -> list[NoiseCurve]:
    """Return curves with the best levels among these names, other parameters as given."""
    fitted = []
    for one, curve in zip(groups, curves, strict=True):
        bands = one.bands
        levels = [name for name in LEVELS if name in names]
        units = [curve._replace(**NO_ERRORS | {name: 1.0}) for name in levels]
        fixed = curve._replace(**dict.fromkeys(levels, 0.0)).variance(bands.seconds)
        terms = np.stack([unit.variance(bands.seconds) for unit in units], axis=1)
        expected = bands.variance
        # With errors relative to the mean of both, a variance of half and of twice are as far off.
        for _ in range(ROUNDS):
            scale = 1 / (np.sqrt(bands.variance * expected) * one.sigma)
            found = _least_squares(terms * scale[:, None], (bands.variance - fixed) * scale)
            expected = np.maximum(terms @ found + fixed, bands.variance / 100)
        values = dict(zip(levels, np.sqrt(found).tolist(), strict=True))
        fitted.append(curve._replace(**values))
    return fitted


def _least_squares(terms: Reals, values: Reals) -> Reals:
    """Return the weights of columns, none negative, whose sum is nearest to some values.

    The best of the solutions of all subsets of the columns, of which there are at most eight.
    """
    count = terms.shape[1]
    best, least = np.zeros(count), float(values @ values)
    for size in range(1, count + 1):
        for columns in combinations(range(count), size):
            chosen = terms[:, columns]
            weights = np.linalg.lstsq(chosen, values)[0]
            misfit = float(np.sum((chosen @ weights - values) ** 2))
            if misfit < least and (weights >= 0).all():
                best, least = np.zeros(count), misfit
                best[list(columns)] = weights
    return best


def _errors(one: _Weighted, curve: NoiseCurve, names: Sequence[str]) -> dict[str, float]:
    """Return the relative errors of fitted parameters, 1 sigma, that are not zero.

    From the inverse of the information matrix, with the relative change of the curve for a relative
    change of each parameter.
    """
    shown = [name for name in names if getattr(curve, name)]
    if "drift" not in shown:
        shown = [name for name in shown if name != "time_s"]
    changes = []
    for name in shown:
        higher, lower = (
            curve._replace(**{name: getattr(curve, name) * factor}).variance(one.bands.seconds)
            for factor in (1.05, 1 / 1.05)
        )
        changes.append(np.log(higher / lower) / (2 * math.log(1.05)) / one.sigma)
    if not changes:
        return {}
    matrix = np.array(changes)
    variances = np.diag(np.linalg.pinv(matrix @ matrix.T))
    return dict(zip(shown, np.sqrt(variances).tolist(), strict=True))
