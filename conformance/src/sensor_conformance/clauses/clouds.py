# SPDX-License-Identifier: Apache-2.0
"""Point clouds: layout, fields of drivers, times, rings, and what stands for no return."""

import numpy as np
from numpy.typing import NDArray

from sensor_conformance.readings.base import Floats
from sensor_conformance.readings.cloud import KINDS, CloudReadings, positions
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import count_plot, named_plot, plot, series_plot

from .clause import ClauseResult, NotTested, clause, findings, result

DEFINITION = "sensor_msgs/PointCloud2"
FIELDS = {
    "x": (7, 8),
    "y": (7, 8),
    "z": (7, 8),
    "intensity": (2, 4, 7),
    "ring": (2, 4),
    "channel": (2, 4),
    "time": (7,),
    "t": (6,),
    "timestamp": (6, 7, 8),
    "time_stamp": (6,),
    "reflectivity": (2, 4, 7),
    "ambient": (2, 4),
    "range": (6, 7),
    "return_type": (2,),
    "tag": (2,),
    "line": (2,),
    "offset_time": (6,),
}
"""Numbers of sensor_msgs/PointField that drivers of Velodyne (x y z intensity ring time), Ouster
(t reflectivity ring ambient range), Hesai and Robosense (ring timestamp), Livox (tag line
timestamp) and Autoware (return_type channel time_stamp) write."""

SECONDS = {"time": 1.0, "t": 1e-9, "timestamp": 1.0, "time_stamp": 1e-9, "offset_time": 1e-9}
"""Fields of times of points, and their unit."""
RINGS = ("ring", "channel", "line")
KEPT = "cloud that was kept"
MOST_RING_SPREAD = 0.6
"""Degrees, deviation of the elevations of a ring. Beams leave some heads beside the center."""


def _clouds(topic: CloudReadings) -> list[NDArray[np.void]]:
    found = [points for _, points in topic.clouds.items if len(points)]
    if not found or not {"x", "y", "z"} <= topic.field_names:
        raise NotTested("no readable points with x, y and z")
    return found


def _rays(points: NDArray[np.void]) -> tuple[NDArray[np.bool_], Floats, Floats, Floats]:
    """Return which points are returns, and their ranges, azimuths and elevations in radians."""
    place = positions(points)
    distance = np.linalg.norm(place, axis=1)
    with np.errstate(invalid="ignore"):
        seen = np.isfinite(distance) & (distance > 0.05)
    place, distance = place[seen], distance[seen]
    azimuth = np.arctan2(place[:, 1], place[:, 0])
    return seen, distance, azimuth, np.arcsin((place[:, 2] / distance).clip(-1, 1))


def ring_field(topic: CloudReadings) -> str:
    """Return the name of the field of lasers; clouds of depth cameras have none that is meant."""
    if "optical" in topic.frame:
        raise NotTested("a cloud in an optical frame is that of a camera")
    for name in RINGS:
        if name in topic.field_names:
            return name
    raise NotTested("no field ring")


def _times(topic: CloudReadings, points: NDArray[np.void]) -> Floats:
    """Return times of points in seconds after the first."""
    if "optical" in topic.frame:
        raise NotTested("a cloud in an optical frame is that of a camera")
    for name, unit in SECONDS.items():
        if name in topic.field_names:
            # Before float64, which would round nanoseconds of the epoch.
            values = points[name].astype(np.float64)
            return np.asarray((values - np.nanmin(values)) * unit, np.float64)
    raise NotTested("no field of times")


@clause("cloud.layout", "Steps and lengths agree", DEFINITION, CloudReadings)
def layout(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """The data are row_step x height; fields lie in the point, and do not overlap."""
    found = []
    for one in dict.fromkeys(topic.layouts):
        if one.length != one.row_step * one.height:
            found.append(f"{one.length} bytes, {one.row_step} x {one.height} expected")
        if one.row_step < one.point_step * one.width:
            found.append(f"row_step {one.row_step} is below {one.point_step} x {one.width}")
        end = 0
        for field in sorted(one.fields, key=lambda field: field.offset):
            if field.kind not in KINDS:
                found.append(f"{field.name!r} has the type {field.kind}")
            elif field.offset < end or field.offset + field.size > one.point_step:
                found.append(f"{field.name!r} overlaps or leaves the point")
            end = max(end, field.offset + field.size)
    first = topic.layouts[0]
    picture = named_plot(
        "offset in the point, bytes",
        {field.name: field.offset for field in first.fields},
        limits=(first.point_step,),
    )
    return findings(list(dict.fromkeys(found)), f"{first.point_step} bytes a point", picture)


@clause(
    "cloud.fields",
    "Fields have the types of drivers",
    "velodyne, ouster, livox drivers",
    CloudReadings,
)
def fields(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """Fields x, y, z are there; fields of a known name have a known type."""
    found = []
    present = {one.name: one.kind for one in topic.layouts[0].fields}
    if missing := {"x", "y", "z"} - set(present):
        found.append(f"no field {', '.join(sorted(missing))}")
    for name, kind in present.items():
        if name in FIELDS and kind not in FIELDS[name]:
            found.append(f"{name!r} is {KINDS.get(kind, kind)}")
    return findings(found, ", ".join(present))


@clause("cloud.dense", "A dense cloud holds no NaN", f"{DEFINITION}: is_dense", CloudReadings)
def dense(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """If is_dense is set, all points are finite; if not set, that is no finding."""
    if not topic.layouts[0].is_dense:
        raise NotTested("is_dense is false")
    counts = [
        int(np.count_nonzero(~np.isfinite(positions(one)).all(axis=1))) for one in _clouds(topic)
    ]
    picture = count_plot("points with NaN", np.array(counts), each=KEPT)
    return result(not any(counts), f"{sum(counts)} points with NaN or infinity", picture)


@clause(
    "cloud.no_return",
    "A ray without return is left out or NaN",
    "REP 117; organized clouds of drivers may hold zeros",
    CloudReadings,
)
def no_return(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """Points at the origin are rare in clouds of one row."""
    if topic.layouts[0].height > 1:
        raise NotTested("organized")
    shares = [float(np.mean(~positions(one).any(axis=1))) for one in _clouds(topic)]
    picture = series_plot("share at the origin", np.array(shares), limits=(0.01,), each=KEPT)
    return result(max(shares) < 0.01, f"{100 * max(shares):.2f} % at the origin", picture)


@clause(
    "cloud.count", "Clouds do not lose a large part of their points", "data sheets", CloudReadings
)
def count(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """No cloud has less than half the returns of the median."""
    counts = np.isfinite(topic.profiles).sum(axis=1)
    sizes = np.array([len(one) for one in _clouds(topic)])
    if len(topic.layouts) < 5:
        raise NotTested("fewer than 5 clouds")
    whole = np.array([one.width * one.height for one in topic.layouts])
    least, median = int(whole[1:-1].min()), int(np.median(whole))
    seen, usual = int(counts[1:-1].min()), int(np.median(counts))
    picture = plot(
        "time, s", "points", ("points", topic.seconds, whole), limits=(median / 2,), dots=True
    )
    holds = least > 0.5 * median and (usual < 60 or seen > 0.6 * usual)
    line = f"{least} of {median} points; {seen} of {usual} degrees of azimuth; {len(sizes)} clouds"
    return result(holds, line, picture)


@clause(
    "cloud.times",
    "Times of points cover no more than a revolution",
    "velodyne: seconds as float32; ouster: nanoseconds as uint32",
    CloudReadings,
)
def times(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """Times are finite, differ, and span at most 1.2 periods."""
    spans = [float(np.ptp(_times(topic, points))) for points in _clouds(topic)]
    span, period = float(np.median(spans)), topic.period
    if not np.isfinite(period):
        raise NotTested("one cloud")
    holds = 0 < span <= 1.2 * period
    first = _times(topic, _clouds(topic)[0])
    picture = plot(
        "point", "time after the first, s", ("time", np.arange(len(first)), first), dots=True
    )
    return result(holds, f"{span:.4f} s of a period of {period:.4f} s", picture)


@clause(
    "cloud.time_order",
    "Points of a ring are in the order of their times",
    "drivers of spinning LiDARs; LOAM-like odometry relies on it",
    CloudReadings,
)
def time_order(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """Within a ring, times do not decrease."""
    ring = ring_field(topic)
    counts, total = [], 0
    for points in _clouds(topic)[:6]:
        seen, *_ = _rays(points)
        order = np.argsort(points[ring][seen], kind="stable")
        values, rings = _times(topic, points)[seen][order], points[ring][seen][order]
        same = np.diff(rings.astype(np.int64)) == 0
        counts.append(int(np.count_nonzero((np.diff(values) < 0) & same)))
        total += int(np.count_nonzero(same))
    back = sum(counts)
    picture = count_plot("points that go back", np.array(counts), each=KEPT)
    return result(back <= 0.01 * max(total, 1), f"{back} of {total} go back in time", picture)


@clause(
    "cloud.spin",
    "Times grow evenly with the azimuth",
    "data sheets: rotation at constant speed",
    CloudReadings,
)
def spin(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """Azimuths of a ring, unwrapped in the order of times, are a straight line."""
    ring = ring_field(topic)
    worst, picture = [], None
    for points in _clouds(topic)[:6]:
        seen, _, azimuth, _ = _rays(points)
        values = _times(topic, points)[seen]
        rings = points[ring][seen]
        largest = np.bincount(rings.astype(np.int64)).argmax()
        one = rings == largest
        order = np.argsort(values[one], kind="stable")
        at, angle = values[one][order], azimuth[one][order]
        if len(at) < 60 or np.ptp(at) <= 0:
            continue
        unwrapped = np.unwrap(angle)
        if abs(unwrapped[-1] - unwrapped[0]) < np.pi / 4:
            worst.append(180.0)
            continue
        fit = np.polynomial.Polynomial.fit(at, unwrapped, 1)
        worst.append(float(np.degrees(np.percentile(np.abs(unwrapped - fit(at)), 95))))
        picture = plot(
            "time, s", "azimuth, degrees", ("ring", at, np.degrees(unwrapped)), dots=True
        )
    if not worst:
        raise NotTested("too few points in a ring, or no times")
    off = float(np.median(worst))
    return result(off < 5, f"95 % of azimuths within {off:.2f} degrees of an even turn", picture)


@clause(
    "cloud.stamp",
    "Times of points are relative to the stamp, or absolute",
    "velodyne: relative to the stamp; hesai: seconds of the epoch",
    CloudReadings,
)
def stamp(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """The first and last times are within a period and a half of the stamp."""
    name = next((name for name in SECONDS if name in topic.field_names), None)
    if name is None or not np.isfinite(topic.period):
        raise NotTested("no field of times, or one cloud")
    worst, seen = 0.0, []
    for index, points in topic.clouds.items:
        values = points[name].astype(np.float64) * SECONDS[name]
        if not len(values):
            continue
        ends = np.array([np.nanmin(values), np.nanmax(values)])
        if ends[0] > 1e6:
            ends = ends - topic.stamps[index] / 1e9
        worst = max(worst, float(np.abs(ends).max()))
        seen.append(ends)
    count, limit = np.arange(len(seen)), 1.5 * topic.period
    first, last = np.array(seen).reshape(-1, 2).T
    picture = plot(
        KEPT,
        "time after the stamp, s",
        ("first", count, first),
        ("last", count, last),
        limits=(-limit, limit),
    )
    return result(worst <= limit, f"up to {worst:.4f} s from the stamp", picture)


@clause(
    "cloud.rings",
    "A ring is one laser, and rings are ordered by elevation",
    "velodyne: ring 0 is the lowest; ouster: ring 0 is the highest",
    CloudReadings,
)
def rings(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """Elevations within a ring agree, and rise or fall from ring to ring."""
    ring = ring_field(topic)
    points = _clouds(topic)[0]
    seen, distance, _, elevation = _rays(points)
    numbers = points[ring][seen].astype(np.int64)
    far = distance > 1.5  # near points show the offsets of beams from the center
    found, medians, spreads = [], [], []
    present = np.unique(numbers)
    for number in present:
        angles = np.degrees(elevation[(numbers == number) & far])
        if len(angles) >= 10:
            medians.append(float(np.median(angles)))
            spreads.append(float(np.percentile(np.abs(angles - medians[-1]), 80)))
    if len(medians) < 2:
        raise NotTested("fewer than two rings with points")
    steps = np.diff(medians)
    rising = float(np.mean(steps > -0.02))
    if 0.05 < rising < 0.95:
        found.append(f"{100 * min(rising, 1 - rising):.0f} % of rings are out of order")
    if float(np.median(spreads)) > MOST_RING_SPREAD:
        found.append(f"elevations of a ring spread by {np.median(spreads):.2f} degrees")
    picture = plot(
        "ring",
        "elevation, degrees",
        ("median", np.arange(len(medians)), np.array(medians)),
        dots=True,
    )
    return findings(
        found, f"{len(present)} rings, {min(medians):.1f} to {max(medians):.1f} degrees", picture
    )


@clause(
    "cloud.intensity",
    "Intensities differ, and are not negative",
    "data sheets: 0 to 255",
    CloudReadings,
)
def intensity(topic: CloudReadings, recording: CheckedRecording) -> ClauseResult:
    """Values are finite, at least 0, and more than one."""
    if "intensity" not in topic.field_names:
        raise NotTested("no field intensity")
    points = _clouds(topic)[0]
    values = points["intensity"][_rays(points)[0]].astype(np.float64)
    if not len(values):
        raise NotTested("no returns")
    bad = int(np.count_nonzero(~np.isfinite(values) | (values < 0)))
    distinct = len(np.unique(values))
    picture = plot(
        "intensity", "share below", ("share", np.sort(values), np.linspace(0, 1, len(values)))
    )
    line = f"{np.nanmin(values):g} to {np.nanmax(values):g}, {distinct} values, {bad} invalid"
    return result(bad == 0 and distinct > 1, line, picture)
