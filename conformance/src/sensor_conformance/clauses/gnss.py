# SPDX-License-Identifier: Apache-2.0
"""Satellite receivers: sensor_msgs/NavSatFix, and the path against odometry."""

import numpy as np

from sensor_conformance.readings.base import Floats
from sensor_conformance.readings.motion import FixReadings
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import count_plot, plot, steps_plot

from .clause import ClauseResult, NotTested, clause, findings, result

DEFINITION = "sensor_msgs/NavSatFix"
METERS_PER_DEGREE = 111_320.0
"""Of latitude, and of longitude at the equator. Exact to 0.6 %."""
COARSEST_STEP = 0.3
"""Meters. float32 has steps of 0.42 m at 48 degrees."""
LEAST_PATH = 5.0
"""Meters between the farthest positions, below which there is nothing to compare."""


@clause("gnss.range", "Latitude and longitude are degrees of a place", DEFINITION, FixReadings)
def within(topic: FixReadings, recording: CheckedRecording) -> ClauseResult:
    """Positions with a fix lie on the globe, and not at 0, 0."""
    latitude, longitude = topic.latitude[topic.has_fix], topic.longitude[topic.has_fix]
    found = []
    if np.any(np.abs(latitude) > 90) or np.any(np.abs(longitude) > 180):
        found.append("beyond 90 or 180 degrees")
    if np.any((latitude == 0) & (longitude == 0)):
        found.append("a fix at 0, 0")
    if np.any(np.abs(topic.altitude[topic.has_fix]) > 20_000):
        found.append("an altitude beyond 20 km")
    picture = plot("longitude", "latitude", ("fixes", longitude, latitude), dots=True)
    return findings(found, f"{len(latitude)} of {len(topic.latitude)} with a fix", picture)


@clause(
    "gnss.no_fix",
    "A position is a number when there is a fix, and only then is it valid",
    "sensor_msgs/NavSatStatus: STATUS_NO_FIX; drivers report NaN",
    FixReadings,
)
def no_fix(topic: FixReadings, recording: CheckedRecording) -> ClauseResult:
    """With a fix, latitude and longitude are finite."""
    both = np.isfinite(topic.latitude) & np.isfinite(topic.longitude)
    wrong = ~both & topic.has_fix
    bad = int(np.count_nonzero(wrong))
    picture = count_plot("fixes without a number", wrong)
    line = f"{bad} fixes without a number; {np.count_nonzero(~topic.has_fix)} no fix"
    return result(bad == 0, line, picture)


@clause(
    "gnss.resolution",
    "Positions are not rounded to float32 or to a few digits",
    "NMEA 0183: 4 digits of a minute are 0.19 m",
    FixReadings,
)
def resolution(topic: FixReadings, recording: CheckedRecording) -> ClauseResult:
    """Steps between distinct positions are below 30 cm."""
    found, lines = [], []
    for name, values in (("latitude", topic.latitude), ("longitude", topic.longitude)):
        distinct = np.unique(values[topic.has_fix & np.isfinite(values)])
        if len(distinct) < 3:
            continue
        step = float(np.min(np.diff(distinct))) * METERS_PER_DEGREE
        lines.append(f"{name}: {step:.3g} m")
        if step > COARSEST_STEP:
            found.append(lines[-1])
    if not lines:
        raise NotTested("positions do not change")
    north = topic.latitude[topic.has_fix & np.isfinite(topic.latitude)]
    picture = steps_plot("latitude, m", (north - north[:1]) * METERS_PER_DEGREE)
    return findings(found, "; ".join(lines), picture)


@clause(
    "gnss.against_odometry",
    "Fixes follow the path of odometry: east is right of north",
    "REP 103: east, north, up; sensor_msgs/NavSatFix",
    FixReadings,
)
def against_odometry(topic: FixReadings, recording: CheckedRecording) -> ClauseResult:
    """A rotation and a translation, without mirror or scale, put one path on the other."""
    if (path := recording.odometry_of(topic)) is None:
        raise NotTested("no odometry")
    good = topic.has_fix & np.isfinite(topic.latitude) & np.isfinite(topic.longitude)
    good &= (topic.stamps >= path.stamps[0]) & (topic.stamps <= path.stamps[-1])
    if np.count_nonzero(good) < 10:
        raise NotTested("fewer than 10 fixes during the odometry")
    fixes = _east_north(topic.latitude[good], topic.longitude[good])
    times = topic.stamps[good]
    driven = np.stack(
        [np.interp(times, path.stamps, path.position[:, axis]) for axis in (0, 1)], axis=1
    )
    size = float(np.linalg.norm(np.ptp(driven, axis=0)))
    if size < LEAST_PATH:
        raise NotTested(f"the path is {size:.1f} m wide only")
    stated = topic.covariances["position"][good]
    deviation = float(np.sqrt(np.median(stated[:, 0, 0] + stated[:, 1, 1]).clip(0)))
    error, scale = _fit(driven, fixes, mirrored=False)
    mirrored, _ = _fit(driven, fixes, mirrored=True)
    # Odometry drifts, in heading above all; a mirrored path is told by the comparison.
    limit = max(2.0, 3 * deviation, 0.1 * size)
    picture = plot(
        "east or x, m",
        "north or y, m",
        ("fixes", fixes[:, 0], fixes[:, 1]),
        (path.name, driven[:, 0], driven[:, 1]),
        dots=True,
    )
    line = (
        f"differ by {error:.2f} m over {size:.0f} m (mirrored {mirrored:.2f} m), scale {scale:.3f}"
    )
    # Noise lengthens a short path.
    is_as_long = abs(float(np.log(scale))) < 0.2 + 3 * deviation / size
    is_mirrored = mirrored < 0.3 * error and error > 1
    return result(error <= limit and is_as_long and not is_mirrored, line, picture)


def _east_north(latitude: Floats, longitude: Floats) -> Floats:
    """Return meters east and north of the first position."""
    east = (longitude - longitude[0]) * METERS_PER_DEGREE * np.cos(np.radians(latitude[0]))
    return np.stack((east, (latitude - latitude[0]) * METERS_PER_DEGREE), axis=1)


def _fit(path: Floats, fixes: Floats, mirrored: bool) -> tuple[float, float]:
    """Return the root mean square distance of the best rigid motion, and the ratio of sizes."""
    a, b = path - path.mean(axis=0), fixes - fixes.mean(axis=0)
    if mirrored:
        b = b[:, ::-1]
    left, _, right = np.linalg.svd(a.T @ b)
    keep = np.diag([1.0, float(np.sign(np.linalg.det(left @ right)))])
    turned = a @ (left @ keep @ right)
    error = float(np.sqrt(np.mean(np.sum((turned - b) ** 2, axis=1))))
    size = float(np.sqrt(np.sum(a**2)))
    return error, float(np.sqrt(np.sum(b**2))) / max(size, 1e-9)
