# SPDX-License-Identifier: Apache-2.0
"""Noise of point clouds: by range, intensity and incidence, and steps of the ranges."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sensor_conformance.readings.base import Floats
from sensor_conformance.readings.cloud import CloudReadings, positions
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import ClausePlot, plot, steps_plot
from sensor_conformance.signals.statistics import spread

from .clause import ClauseResult, NotTested, clause, result
from .clouds import ring_field

LEAST_NOISE, MOST_NOISE = 0.0005, 0.07
"""Meters. Devices state 0.5 to 3 cm; below half a millimeter there is no noise."""
LEAST_POINTS = 150
"""Points that a band needs."""
COARSEST_STEP = 0.02
"""Meters. Velodyne has steps of 2 mm, Hesai 4 mm, Ouster 1 mm (8 mm in its low data rate)."""


@dataclass(frozen=True)
class _Residuals:
    """Deviations of ranges from the line through both neighbors in the ring."""

    deviation: Floats
    """Meters, scaled to that of one range."""
    distance: Floats
    intensity: Floats
    incidence: Floats
    """Degrees between ray and normal within the scanned plane."""


def _residuals(topic: CloudReadings) -> _Residuals:
    ring = ring_field(topic)
    if not {"x", "y", "z"} <= topic.field_names:
        raise NotTested("no fields x, y and z")
    parts: list[tuple[Floats, Floats, Floats, Floats]] = []
    for _, points in topic.clouds.items[:8]:
        place = positions(points)
        distance = np.linalg.norm(place, axis=1)
        with np.errstate(invalid="ignore"):
            seen = np.isfinite(distance) & (distance > 0.3)
        place, distance, kept = place[seen], distance[seen], points[seen]
        azimuth = np.arctan2(place[:, 1], place[:, 0])
        order = np.lexsort((azimuth, kept[ring]))
        r, a, numbers = distance[order], azimuth[order], kept[ring][order].astype(np.int64)
        flash = np.zeros(len(r))
        if "intensity" in topic.field_names:
            flash = kept["intensity"][order].astype(np.float64)
        same = (numbers[2:] == numbers[:-2]) & (np.diff(numbers)[1:] == 0)
        before, after = a[1:-1] - a[:-2], a[2:] - a[1:-1]
        even = same & (before > 1e-5) & (after > 1e-5) & (after < 0.02) & (before < 0.02)
        even &= np.abs(before - after) < 0.3 * (before + after)
        weight = after / np.where(before + after > 0, before + after, 1)
        # Inverse range of a straight wall is nearly linear in a small angle, range itself is not.
        middle = 1 / np.where(even, weight / r[:-2] + (1 - weight) / r[2:], 1)
        off = r[1:-1] - middle
        tilt = np.abs(np.arctan2(r[2:] - r[:-2], r[1:-1] * (before + after)))
        good = (
            even & (np.abs(off) < 0.25 + 0.01 * r[1:-1]) & (np.abs(r[2:] - r[:-2]) < 0.1 * r[1:-1])
        )
        scale = np.sqrt(1 + weight**2 + (1 - weight) ** 2)
        parts.append(
            ((off / scale)[good], r[1:-1][good], flash[1:-1][good], np.degrees(tilt)[good])
        )
    joined = [np.concatenate(column) for column in zip(*parts, strict=True)]
    if not joined or len(joined[0]) < LEAST_POINTS:
        raise NotTested("too few neighboring points on smooth surfaces")
    return _Residuals(*joined)


def _bands(over: Floats, deviation: Floats) -> tuple[Floats, Floats]:
    """Return the middles of bands with equal numbers of points, and the noise in each."""
    count = min(8, len(over) // LEAST_POINTS)
    edges = np.unique(np.percentile(over, np.linspace(0, 100, count + 1)))
    middles, noises = [], []
    for low, high in pairwise(edges):
        inside = (over >= low) & (over <= high)
        if np.count_nonzero(inside) >= LEAST_POINTS // 2:
            middles.append(float(np.median(over[inside])))
            noises.append(spread(deviation[inside]))
    if not noises:
        raise NotTested("all points are in one band")
    return np.array(middles), np.array(noises)


def _judge(label: str, over: Floats, deviation: Floats) -> ClauseResult:
    middles, noises = _bands(over, deviation)
    picture: ClausePlot = plot(label, "noise, mm", ("deviation", middles, 1e3 * noises), dots=True)
    bands = ", ".join(
        f"{1e3 * noise:.1f} at {middle:.3g}" for middle, noise in zip(middles, noises, strict=True)
    )
    holds = bool(np.all(noises < MOST_NOISE) and np.median(noises) > LEAST_NOISE)
    return result(holds, f"mm by {label}: {bands}", picture)


@clause(
    "cloud.noise_by_range",
    "Ranges have noise, and little",
    "data sheets: range accuracy",
    CloudReadings,
)
def noise_by_range(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """In each band of range the deviation is that of a device."""
    found = _residuals(topic)
    return _judge("range, m", found.distance, found.deviation)


@clause(
    "cloud.noise_by_intensity",
    "Noise is that of a device in each band of intensity",
    "data sheets: range accuracy by reflectivity",
    CloudReadings,
)
def noise_by_intensity(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """In each band of intensity the deviation is that of a device."""
    found = _residuals(topic)
    if np.ptp(found.intensity) == 0:
        raise NotTested("one intensity")
    return _judge("intensity", found.intensity, found.deviation)


@clause(
    "cloud.noise_by_incidence",
    "Noise is that of a device in each band of incidence",
    "data sheets: range accuracy",
    CloudReadings,
)
def noise_by_incidence(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """In each band of incidence the deviation is that of a device."""
    found = _residuals(topic)
    return _judge("incidence, degrees", found.incidence, found.deviation)


@clause(
    "cloud.range_steps", "Ranges have the resolution of a device", "data sheets: LSB", CloudReadings
)
def range_steps(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """Ranges are no multiples of a step of some centimeters."""
    if not topic.clouds.items or not {"x", "y", "z"} <= topic.field_names:
        raise NotTested("no readable points")
    values = np.linalg.norm(positions(topic.clouds.items[0][1]), axis=1)
    values = values[np.isfinite(values) & (values > 0.3)]
    if len(values) < LEAST_POINTS:
        raise NotTested("too few points")
    found = 0.0
    for step in (0.001, 0.002, 0.004, 0.005, 0.008, 0.01, 0.02, 0.025, 0.04, 0.05, 0.1, 0.2, 0.25):
        off = np.abs(values / step - np.round(values / step))
        if np.mean(off < 0.1) > 0.9:
            found = step
    line = f"multiples of {1e3 * found:g} mm" if found else "no common step of 1 mm or more"
    return result(found < COARSEST_STEP, line, steps_plot("range, m", values))
