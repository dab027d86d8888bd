# SPDX-License-Identifier: Apache-2.0
"""Covariances: valid matrices, and in proportion to the spread of the data."""

import numpy as np

from sensor_conformance.readings.base import Floats
from sensor_conformance.readings.motion import FixReadings, ImuReadings, OdometryReadings
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import named_plot, plot, series_plot
from sensor_conformance.signals.statistics import white_noise

from .clause import ClauseResult, NotTested, clause, findings

MOST_CONFIDENT = 10.0
"""White noise over the deviation of the covariance. Vibration is no error but looks like one."""
LEAST_CONFIDENT = 1e-3
"""Drivers often state a bound instead of a deviation; three orders of magnitude are a mistake."""


@clause(
    "covariance.valid",
    "Covariances are symmetric and positive",
    "sensor_msgs: covariance; REP 145",
    ImuReadings,
    OdometryReadings,
    FixReadings,
)
def valid(
    topic: ImuReadings | OdometryReadings | FixReadings, recording: CheckedRecording
) -> ClauseResult:
    """No eigenvalue is negative, except in matrices that are marked as missing by -1."""
    found, least_of = [], {}
    for name, matrices in topic.covariances.items():
        marked = matrices[:, 0, 0] == -1
        some = np.unique(matrices[~marked], axis=0)[:200]
        if not len(some):
            continue
        if not np.isfinite(some).all():
            found.append(f"{name}: not finite")
            continue
        scale = np.abs(some).max(axis=(1, 2))
        if np.any(np.abs(some - some.swapaxes(1, 2)).max(axis=(1, 2)) > 1e-6 * scale + 1e-15):
            found.append(f"{name}: not symmetric")
        least = np.linalg.eigvalsh((some + some.swapaxes(1, 2)) / 2).min(axis=1)
        least_of[name] = float(least.min())
        if np.any(least < -1e-6 * scale - 1e-15):
            found.append(f"{name}: eigenvalue {least.min():.3g}")
    picture = named_plot("least eigenvalue", least_of)
    return findings(found, ", ".join(topic.covariances), picture)


@clause(
    "covariance.spread",
    "Covariances of an IMU state the noise that the readings have",
    "REP 145: covariances from the data sheet",
    ImuReadings,
)
def spread(topic: ImuReadings, recording: CheckedRecording) -> ClauseResult:
    """White noise of the quietest second is not far beyond the stated deviation, nor far below."""
    size = max(20, round(1 / max(topic.period, 1e-3)))
    if len(topic.stamps) < 2 * size:
        raise NotTested("shorter than 2 s")
    found, lines = [], []
    picture = None
    for name, values in (
        ("angular_velocity", topic.gyro),
        ("linear_acceleration", topic.acceleration),
    ):
        matrix = topic.covariances[name][0]
        if matrix[0, 0] <= 0:
            continue
        stated = float(np.sqrt(np.mean(np.diag(matrix))))
        noise = _quietest(values, size)
        lines.append(f"{name}: noise {noise:.3g}, stated {stated:.3g}")
        picture = plot(
            "time, s",
            name,
            ("x", topic.seconds, values[:, 0] - np.median(values[:, 0])),
            limits=(-stated, stated),
        )
        if not LEAST_CONFIDENT * stated <= noise <= MOST_CONFIDENT * stated:
            found.append(lines[-1])
    if not lines:
        raise NotTested("no covariance is stated (zero, or -1)")
    return findings(found, "; ".join(lines), picture)


@clause(
    "covariance.type",
    "The type of a fix's covariance fits the matrix",
    "sensor_msgs/NavSatFix: position_covariance_type",
    FixReadings,
)
def kind(topic: FixReadings, recording: CheckedRecording) -> ClauseResult:
    """Types are 0 to 3; a known matrix has a positive diagonal, a diagonal one nothing else."""
    found = []
    matrices, types = topic.covariances["position"], topic.covariance_type
    if not set(np.unique(types)) <= {0, 1, 2, 3}:
        found.append(f"types {np.unique(types).tolist()}")
    known = matrices[(types > 0) & topic.has_fix]
    diagonals = np.diagonal(known, axis1=1, axis2=2)
    if len(known) and not np.all(diagonals > 0):
        found.append("a variance of a known covariance is not positive")
    only = matrices[types == 2]
    if len(only) and np.any(only - only * np.eye(3)):
        found.append("DIAGONAL_KNOWN, but elements beside the diagonal")
    picture = series_plot("position_covariance_type", types)
    return findings(found, f"types {np.unique(types).astype(int).tolist()}", picture)


def _quietest(values: Floats, size: int) -> float:
    parts = len(values) // size
    blocks = values[: parts * size].reshape(parts, size, -1)
    noise = [
        float(np.mean([white_noise(block[:, axis]) for axis in range(block.shape[1])]))
        for block in blocks
    ]
    return min(noise)
