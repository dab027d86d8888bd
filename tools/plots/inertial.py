# SPDX-License-Identifier: Apache-2.0
"""Plots of IMUs and satellite receivers."""

import msgspec
import numpy as np
from matplotlib.figure import Figure
from msgspec.structs import replace

from groundlink.core.clock import TICK_RATE_HZ, TICK_SECONDS
from groundlink.core.frames import Floats
from services.sensors.gnss.model import GnssErrors
from services.sensors.gnss.spec import Gnss, PositionNoise
from services.sensors.imu.errors import PEAK_OF_GAUSS_MARKOV, ImuErrors
from services.sensors.imu.lowpass import weights
from services.sensors.imu.spec import InertialNoise, InertialUnit
from services.sensors.noise.error_processes import BLOCK_TICKS
from services.sensors.noise.random_streams import RandomStreams

from .cart import sheet
from .page_style import SERIES, label, side_by_side

IMUS = ("imu_mpu6000", "imu_adis16448", "imu_vn100")
HOUR_BLOCKS = 3600 * TICK_RATE_HZ // BLOCK_TICKS
DRIFT_HOURS, DRIFT_STEP_S = 48, 10


def allan_deviation(samples: Floats, ticks: int) -> float:
    """Return the overlapping Allan deviation over the columns, at an interval of some ticks.

    Half the mean square of the differences of neighboring means (IEEE Std 952-1997, annex C).
    """
    sums = np.concatenate([np.zeros((1, samples.shape[1])), np.cumsum(samples, axis=0)])
    means = (sums[ticks:] - sums[:-ticks]) / ticks
    return float(np.sqrt(np.mean((means[ticks:] - means[:-ticks]) ** 2) / 2))


def expected_allan(noise: InertialNoise, seconds: Floats) -> Floats:
    """Return the Allan deviation that the settings of a triad of axes amount to."""
    ratio = seconds / noise.bias_time_constant_s
    bracket = 1 - (3 - 4 * np.exp(-ratio) + np.exp(-2 * ratio)) / (2 * ratio)
    wandering = (noise.bias_instability / PEAK_OF_GAUSS_MARKOV) ** 2 * 2 / ratio * bracket
    white = noise.noise_density**2 / seconds
    return np.sqrt(white + wandering + noise.random_walk**2 * seconds / 3)


def imu_allan() -> Figure:
    """Allan deviation of an hour of each data sheet, and what its settings amount to."""
    figure, (left, right) = side_by_side(2, height=3.4)
    intervals = np.unique(np.geomspace(4, 400_000, 22).astype(int))
    seconds = intervals * TICK_SECONDS
    for name, color in zip(IMUS, SERIES, strict=False):
        spec = msgspec.convert(sheet(name), InertialUnit)
        model = ImuErrors(spec, RandomStreams(1, "cart/imu"))
        hour = np.concatenate([model.added(block) for block in range(HOUR_BLOCKS)])
        for plot, noise, axes in (
            (left, spec.accelerometer, hour[:, :3]),
            (right, spec.gyroscope, hour[:, 3:]),
        ):
            plot.loglog(seconds, expected_allan(noise, seconds), color=color)
            found = [allan_deviation(axes, int(ticks)) for ticks in intervals]
            plot.loglog(seconds, found, "o", color=color, label=name)
    label(left, "Accelerometer", "averaging interval, s", "Allan deviation, m/s²")
    label(right, "Gyroscope", "averaging interval, s", "Allan deviation, rad/s")
    left.legend()
    return figure


def imu_filter() -> Figure:
    """Frequency response of the low pass, and noise of a sample against the rate."""
    figure, (left, right) = side_by_side(2)
    frequencies = np.linspace(1, 200, 60)
    for bandwidth, color in zip((20.0, 50.0, 98.0), SERIES, strict=False):
        taps = weights(bandwidth)
        delays = np.arange(len(taps)) * TICK_SECONDS
        turns = np.exp(-2j * np.pi * frequencies[:, None] * delays)
        left.plot(
            frequencies, 20 * np.log10(np.abs(turns @ taps)), "o", color=color, markersize=2.5
        )
        ideal = -10 * np.log10(1 + (frequencies / bandwidth) ** 4)
        left.plot(frequencies, ideal, color=color, label=f"{bandwidth:g} Hz")
    left.set_ylim(-30, 1)
    label(left, "Low pass", "frequency, Hz", "response, dB")
    left.legend()

    density = 1e-3
    ticks = np.array([1, 2, 4, 8, 16, 40])
    rates = TICK_RATE_HZ / ticks
    white = density * np.sqrt(TICK_RATE_HZ) * np.random.default_rng(1).standard_normal(400_000)
    for bandwidth, color in zip((0.0, 20.0, 50.0), SERIES, strict=False):
        filtered = np.convolve(white, weights(bandwidth), "valid")
        found = [filtered[: len(filtered) // n * n].reshape(-1, n).mean(1).std() for n in ticks]
        name = f"{bandwidth:g} Hz" if bandwidth else "none"
        right.loglog(rates, np.array(found) / density, "o-", color=color, label=f"low pass: {name}")
    label(right, "White noise of a sample", "rate_hz", "sigma / noise_density, √Hz")
    right.legend()
    return figure


def gnss_error() -> Figure:
    """East error over ten minutes, and how fast it forgets."""
    figure, axes = side_by_side(3)
    groups = (("gnss_single_point", "gnss_sbas"), ("gnss_rtk_float", "gnss_rtk_fix"))
    colors = dict(zip([name for group in groups for name in group], SERIES, strict=False))
    for plot, group in zip(axes, groups, strict=False):
        for name in group:
            spec = msgspec.convert(sheet(name), Gnss)
            model = GnssErrors(spec, RandomStreams(1, f"cart/{name}"))
            fixes = np.arange(round(600 * spec.rate_hz))
            east = np.array([model.of_fix(int(fix)).position_m[0] for fix in fixes[::5]])
            plot.plot(
                fixes[::5] / spec.rate_hz, east, color=colors[name], linewidth=0.8, label=name
            )
        label(plot, "East error", "sim time, s", "m")
        plot.margins(y=0.25)
        plot.legend(loc="lower right")
    lags_s = np.arange(31) * DRIFT_STEP_S
    for name in ("gnss_single_point", "gnss_rtk_float"):
        spec = msgspec.convert(sheet(name), Gnss)
        drift = _drift(spec)
        found = [np.mean(drift[: len(drift) - lag] * drift[lag:]) for lag in range(len(lags_s))]
        axes[2].plot(lags_s, np.exp(-lags_s / spec.drift_time_s), color=colors[name])
        axes[2].plot(lags_s, found, "o", color=colors[name], markersize=2.5, label=name)
    label(axes[2], "Drift", "time between two fixes, s", "autocorrelation")
    axes[2].legend()
    return figure


def _drift(spec: Gnss) -> Floats:
    """Return the drift of a receiver in its standard deviations, shape (steps, 3)."""
    axis = PositionNoise(drift_stddev_m=1.0)
    quiet = replace(spec, rate_hz=1 / DRIFT_STEP_S, horizontal=axis, vertical=axis)
    model = GnssErrors(quiet, RandomStreams(1, "cart/gnss"))
    steps = round(DRIFT_HOURS * 3600 / DRIFT_STEP_S)
    return np.array([model.of_fix(step).position_m for step in range(steps)])
