# SPDX-License-Identifier: Apache-2.0
"""Planar scans and single ranges: sensor_msgs/LaserScan, sensor_msgs/Range, REP 117."""

from itertools import pairwise

import numpy as np

from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.readings.scan import RangeReadings, ScanReadings
from sensor_conformance.report.plot import named_plot, plot
from sensor_conformance.signals.statistics import spread

from .clause import ClauseResult, NotTested, clause, findings, result

DEFINITION = "sensor_msgs/LaserScan"
REP_117 = "REP 117: -inf too close, +inf no return, NaN invalid"
MOST_NOISE = 0.1
"""Meters, at any range of a planar scanner."""


@clause("scan.angles", "Angles and number of ranges agree", DEFINITION, ScanReadings)
def angles(topic: ScanReadings, recording: CheckedRecording) -> ClauseResult:
    """From angle_min to angle_max there are as many steps as ranges."""
    found = []
    for one in sorted(set(topic.headers)):
        if not one.angle_increment:
            found.append("angle_increment is zero")
            continue
        expected = (one.angle_max - one.angle_min) / one.angle_increment + 1
        if abs(expected - one.ranges) > 1.01:
            found.append(f"{one.ranges} ranges, {expected:.1f} by the angles")
        if abs(one.angle_max - one.angle_min) > 2 * np.pi + 0.02:
            found.append("more than a turn: angles are radians")
        if one.intensities not in (0, one.ranges):
            found.append(f"{one.intensities} intensities for {one.ranges} ranges")
    one = topic.headers[0]
    numbers = {"ranges": float(one.ranges), "intensities": float(one.intensities)}
    if one.angle_increment:
        numbers["by the angles"] = (one.angle_max - one.angle_min) / one.angle_increment + 1
    return findings(found, f"{one.ranges} ranges", named_plot("elements", numbers))


@clause("scan.times", "time_increment and scan_time fit the rate", DEFINITION, ScanReadings)
def times(topic: ScanReadings, recording: CheckedRecording) -> ClauseResult:
    """A scan lasts no longer than the period, and scan_time is the period."""
    one, period = topic.headers[0], topic.period
    if not np.isfinite(period) or period <= 0:
        raise NotTested("fewer than 2 scans")
    found = []
    if abs(one.time_increment) * one.ranges > 1.1 * period:
        found.append(f"{one.ranges} x {one.time_increment:.3g} s is longer than {period:.3g} s")
    if one.scan_time and not 0.5 < one.scan_time / period < 2:
        found.append(f"scan_time {one.scan_time:.3g} s, period {period:.3g} s")
    lasts = abs(one.time_increment) * one.ranges
    picture = named_plot(
        "s", {"time_increment x ranges": lasts, "scan_time": one.scan_time, "period": period}
    )
    return findings(found, f"{lasts:.4f} s of {period:.4f} s", picture)


@clause("scan.limits", "Ranges are within the limits, or say why not", REP_117, ScanReadings)
def limits(topic: ScanReadings, recording: CheckedRecording) -> ClauseResult:
    """Finite ranges lie between range_min and range_max; zero is no range."""
    one = topic.headers[0]
    if not 0 <= one.range_min < one.range_max:
        return result(False, f"range_min {one.range_min:g}, range_max {one.range_max:g}")
    values = np.concatenate([ranges for _, ranges in topic.scans.items])
    finite = values[np.isfinite(values)]
    slack = 1e-4 * one.range_max
    below = int(np.count_nonzero(finite < one.range_min - slack))
    above = int(np.count_nonzero(finite > one.range_max + slack))
    # A few returns just outside are within a device's error.
    share = (below + above) / max(len(values), 1)
    line = f"{below} below range_min, {above} above range_max of {len(values)}"
    if not len(finite):
        return result(share <= 1e-3, line)
    ranks = np.linspace(0, 1, 200)
    curve = ("range", ranks, np.quantile(finite, ranks))
    picture = plot("share below", "range, m", curve, limits=(one.range_min, one.range_max))
    return result(share <= 1e-3, line, picture)


@clause("scan.returns", "Some rays have a return", REP_117, ScanReadings)
def returns(topic: ScanReadings, recording: CheckedRecording) -> ClauseResult:
    """Not all ranges are infinite or NaN."""
    shares = np.isfinite(topic.profiles).mean(axis=1)
    picture = plot("time, s", "share of rays", ("returns", topic.seconds, shares))
    usual = float(np.median(shares))
    return result(usual > 0.01, f"{100 * usual:.0f} % return", picture)


@clause("scan.noise", "Ranges have noise, and little", "data sheets: accuracy", ScanReadings)
def noise(topic: ScanReadings, recording: CheckedRecording) -> ClauseResult:
    """Deviation along smooth surfaces is positive and below 10 cm."""
    bent = np.diff(topic.profiles, n=2, axis=1)
    at = topic.profiles[:, 1:-1]
    smooth = np.isfinite(bent) & (np.abs(bent) < 0.2)
    if np.count_nonzero(smooth) < 500:
        raise NotTested("too few returns of smooth surfaces")
    edges = np.percentile(at[smooth], np.linspace(0, 100, 7))
    middle, deviations = [], []
    for low, high in pairwise(edges):
        inside = smooth & (at >= low) & (at <= high)
        middle.append(float(np.median(at[inside])))
        deviations.append(spread(bent[inside]) / float(np.sqrt(6)))
    picture = plot(
        "range, m", "noise, mm", ("noise", np.array(middle), 1e3 * np.array(deviations)), dots=True
    )
    usual = float(np.median(deviations))
    return result(0 < usual < MOST_NOISE, f"{1e3 * usual:.1f} mm", picture)


@clause("range.limits", "Ranges are within the limits, or infinite", REP_117, RangeReadings)
def range_limits(topic: RangeReadings, recording: CheckedRecording) -> ClauseResult:
    """Finite ranges lie between min_range and max_range."""
    finite = np.isfinite(topic.ranges)
    low = topic.ranges < topic.min_range - 1e-4 * topic.max_range
    high = topic.ranges > topic.max_range * (1 + 1e-4)
    bad = int(np.count_nonzero(finite & (low | high)))
    ends = (float(topic.min_range[0]), float(topic.max_range[0]))
    picture = plot("time, s", "range, m", ("range", topic.seconds, topic.ranges), limits=ends)
    return result(bad <= 1e-3 * len(finite), f"{bad} of {len(finite)} outside the limits", picture)


@clause("range.cone", "Field of view and type are set", "sensor_msgs/Range", RangeReadings)
def range_cone(topic: RangeReadings, recording: CheckedRecording) -> ClauseResult:
    """The cone is between 0 and pi radians; the type is ultrasonic or infrared."""
    found = []
    if not np.all((topic.field_of_view > 0) & (topic.field_of_view < np.pi)):
        found.append(f"field_of_view {topic.field_of_view[0]:g} rad")
    if not np.isin(topic.radiation_type, (0, 1)).all():
        found.append(f"radiation_type {topic.radiation_type[0]:g}")
    if not np.all((topic.min_range >= 0) & (topic.min_range < topic.max_range)):
        found.append("min_range is not below max_range")
    curve = ("cone", topic.seconds, topic.field_of_view)
    picture = plot("time, s", "field of view, rad", curve, limits=(0.0, float(np.pi)))
    return findings(found, f"{topic.field_of_view[0]:.3f} rad", picture)
