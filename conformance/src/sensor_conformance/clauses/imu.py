# SPDX-License-Identifier: Apache-2.0
"""IMUs: REP 145, and what a device of semiconductors does."""

import numpy as np

from sensor_conformance.readings.motion import ImuReadings
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import count_plot, plot, steps_plot
from sensor_conformance.signals.rotations import normalized, rates, rotate
from sensor_conformance.signals.statistics import longest_constant, slope, step, white_noise

from .clause import ClauseResult, NotTested, clause, findings, result

G = 9.81
MOST_GRAVITY_ERROR = 0.6
"""m/s2. Scale errors of low-cost sensors are up to 3 %, biases 0.1 m/s2, and g varies by 0.05."""
MOST_TILT = 40.0
"""Degrees. Slopes, and mounts that tf describes only roughly."""
COARSEST_ACCELERATION = 0.2
"""m/s2. An ADXL345, 10 bits of 4 mg, has 0.039; a bad conversion has more."""
COARSEST_RATE = 0.02
"""rad/s. An ITG-3200 has 0.0012, devices that report whole degrees 0.017."""
MOST_CONSTANT = 0.1
"""Seconds without any change of six channels, or 20 readings."""
MOST_BIAS = 0.15
"""rad/s. Data sheets of consumer gyroscopes allow 3 to 5 degrees/s when new."""


@clause("imu.finite", "All readings are numbers", "REP 145", ImuReadings)
def finite(topic: ImuReadings, recording: CheckedRecording) -> ClauseResult:
    """No vector holds NaN or an infinity."""
    rows = np.hstack((topic.gyro, topic.acceleration))
    wrong = ~np.isfinite(rows).all(axis=1)
    bad = int(np.count_nonzero(wrong))
    picture = count_plot("not finite", np.asarray(wrong))
    return result(bad == 0, f"{bad} of {len(rows)} readings are not finite", picture)


@clause(
    "imu.gravity",
    "Acceleration is in m/s2 and includes gravity",
    "REP 103: SI units; REP 145: linear_acceleration includes gravity",
    ImuReadings,
)
def gravity(topic: ImuReadings, recording: CheckedRecording) -> ClauseResult:
    """The median length of the vector is that of gravity."""
    length = np.linalg.norm(topic.acceleration, axis=1)
    median = float(np.nanmedian(length))
    picture = plot(
        "time, s",
        "|acceleration|, m/s2",
        ("length", topic.seconds, length),
        limits=(G - MOST_GRAVITY_ERROR, G + MOST_GRAVITY_ERROR),
    )
    return result(abs(median - G) <= MOST_GRAVITY_ERROR, f"median {median:.3f} m/s2", picture)


@clause(
    "imu.up",
    "At rest the acceleration points upwards, by the mount in tf or the orientation",
    "REP 145: +9.81 upwards; REP 103: z up",
    ImuReadings,
)
def up(topic: ImuReadings, recording: CheckedRecording) -> ClauseResult:
    """In the base, or in the world, z is where gravity is measured."""
    median = np.nanmedian(topic.acceleration, axis=0)
    turned = recording.in_base(topic, median)
    by = f"mount of {topic.frame!r}"
    if turned is None:
        if not topic.has_orientation:
            raise NotTested("neither tf nor an orientation")
        turned = np.nanmedian(rotate(normalized(topic.orientation), topic.acceleration), axis=0)
        by = "orientation"
    tilt = float(np.degrees(np.arccos(turned[2] / max(float(np.linalg.norm(turned)), 1e-9))))
    picture = plot(
        "time, s",
        "acceleration, m/s2",
        *((axis, topic.seconds, topic.acceleration[:, at]) for at, axis in enumerate("xyz")),
    )
    return result(tilt <= MOST_TILT, f"{tilt:.1f} degrees from z by the {by}", picture)


@clause(
    "imu.orientation",
    "An orientation is a unit quaternion, or marked as missing",
    "REP 145; sensor_msgs/Imu: covariance[0] = -1",
    ImuReadings,
)
def orientation(topic: ImuReadings, recording: CheckedRecording) -> ClauseResult:
    """Quaternions have the length 1, unless the covariance says that there is none."""
    if np.all(topic.covariances["orientation"][:, 0, 0] == -1):
        return result(True, "marked as missing")
    length = np.linalg.norm(topic.orientation, axis=1)
    if not length.any() and np.any(topic.covariances["orientation"]):
        return result(False, "all quaternions are zero and covariance[0] is not -1")
    if not length.any():
        # Drivers older than the -1 leave all of it zero.
        raise NotTested("no orientation: quaternions and covariances are zero")
    off = float(np.nanmax(np.abs(length - 1)))
    picture = plot("time, s", "length", ("quaternion", topic.seconds, length))
    return result(off < 1e-2, f"length off by {off:.2g} at most", picture)


@clause(
    "imu.rate_of_orientation",
    "Gyroscope and orientation describe the same motion",
    "REP 103: right-handed, rad; REP 145: both in the sensor's frame",
    ImuReadings,
)
def rate_of_orientation(topic: ImuReadings, recording: CheckedRecording) -> ClauseResult:
    """Rates of the orientation are those of the gyroscope, axis by axis."""
    if not topic.has_orientation:
        raise NotTested("no orientation")
    if len(topic.stamps) < 100:
        raise NotTested("fewer than 100 readings")
    stride = max(1, round(0.1 / max(topic.period, 1e-4)))
    times = topic.seconds[::stride]
    if np.any(np.diff(times) <= 0):
        raise NotTested("stamps do not increase")
    turn = rates(times, topic.orientation[::stride])
    blocks = len(turn)
    mean = topic.gyro[: blocks * stride].reshape(blocks, stride, 3).mean(axis=1)
    lines, holds, tested = [], True, False
    for axis, name in enumerate("xyz"):
        moving = float(np.std(turn[:, axis]))
        if moving < 0.1:
            continue
        tested = True
        _, alike = slope(turn[:, axis], mean[:, axis])
        ratio = float(np.std(mean[:, axis])) / moving  # both have errors, so none is the cause
        holds &= alike > 0.6 and 0.6 < ratio < 1.6
        lines.append(f"{name}: {ratio:.2f} (correlation {alike:.2f})")
    if not tested:
        raise NotTested("turns by less than 0.1 rad/s")
    picture = plot(
        "time, s",
        "rate, rad/s",
        ("gyroscope z", times[1:], mean[:, 2]),
        ("orientation z", times[1:], turn[:, 2]),
    )
    return result(holds, ", ".join(lines), picture)


@clause("imu.alive", "Readings change: there is noise", "data sheets: noise density", ImuReadings)
def alive(topic: ImuReadings, recording: CheckedRecording) -> ClauseResult:
    """The six channels do not repeat for long."""
    longest = longest_constant(np.hstack((topic.gyro, topic.acceleration)))
    seconds = longest * max(topic.period, 0)
    holds = longest < 20 or seconds < MOST_CONSTANT
    changes = np.abs(np.diff(topic.acceleration, axis=0)).sum(axis=1)
    picture = plot(
        "time, s", "change of acceleration, m/s2", ("change", topic.seconds[1:], changes)
    )
    line = f"at most {longest} equal readings in a row ({seconds:.3f} s)"
    return result(holds, line, picture)


@clause(
    "imu.resolution", "Readings have the resolution of a device", "data sheets: LSB", ImuReadings
)
def resolution(topic: ImuReadings, recording: CheckedRecording) -> ClauseResult:
    """Steps between distinct values are small."""
    if len(topic.stamps) < 100:
        raise NotTested("fewer than 100 readings")
    rate = max(np.nan_to_num([step(topic.gyro[:, axis]) for axis in range(3)]))
    acceleration = max(np.nan_to_num([step(topic.acceleration[:, axis]) for axis in range(3)]))
    holds = rate <= COARSEST_RATE and acceleration <= COARSEST_ACCELERATION
    picture = steps_plot("gyroscope z, rad/s", topic.gyro[:, 2])
    return result(holds, f"steps of {rate:.2g} rad/s and {acceleration:.2g} m/s2", picture)


@clause("imu.saturation", "Readings are not clipped", "data sheets: full scale", ImuReadings)
def saturation(topic: ImuReadings, recording: CheckedRecording) -> ClauseResult:
    """Few readings are at the highest or lowest value."""
    found = []
    for name, values in (("gyroscope", topic.gyro), ("accelerometer", topic.acceleration)):
        for axis, letter in enumerate("xyz"):
            column = values[:, axis]
            high = int(np.count_nonzero(column == column.max()))
            low = int(np.count_nonzero(column == column.min()))
            # Of a device with coarse steps, the extreme value may occur a few times.
            distinct = len(np.unique(column))
            if max(high, low) > max(5, 0.01 * len(column)) and distinct > 50:
                found.append(f"{name} {letter}: {max(high, low)} readings at one extreme")
    picture = plot(
        "time, s",
        "rate, rad/s",
        *((axis, topic.seconds, topic.gyro[:, at]) for at, axis in enumerate("xyz")),
    )
    return findings(found, "no value repeats at an extreme", picture)


@clause(
    "imu.bias", "At rest the gyroscope measures little", "data sheets: zero-rate level", ImuReadings
)
def bias(topic: ImuReadings, recording: CheckedRecording) -> ClauseResult:
    """The means of the quietest second are near zero."""
    size = max(10, round(1 / max(topic.period, 1e-3)))
    if len(topic.gyro) < 2 * size:
        raise NotTested("shorter than 2 s")
    parts = len(topic.gyro) // size
    blocks = topic.gyro[: parts * size].reshape(parts, size, 3)
    at = int(np.argmin(blocks.std(axis=1).sum(axis=1)))
    quietest = blocks[at]
    means, moves = quietest.mean(axis=0), float(quietest.std(axis=0).max())
    if moves > 0.05:
        raise NotTested("never at rest")
    worst = float(np.abs(means).max())
    noise = float(np.mean([white_noise(quietest[:, axis]) for axis in range(3)]))
    line = f"{worst:.4f} rad/s, white noise {noise:.2g} rad/s"
    if worst > MOST_BIAS and not _stands(topic, recording, slice(at * size, (at + 1) * size)):
        raise NotTested(f"{line}; the robot may be turning evenly")
    part = slice(at * size, (at + 1) * size)
    picture = plot(
        "time, s",
        "rate, rad/s",
        *((axis, topic.seconds[part], quietest[:, at]) for at, axis in enumerate("xyz")),
        limits=(-MOST_BIAS, MOST_BIAS),
    )
    return result(worst <= MOST_BIAS, line, picture)


def _stands(topic: ImuReadings, recording: CheckedRecording, part: slice) -> bool:
    """Say whether the reference for turning shows none during a part of the readings."""
    if (turning := recording.turning_of(topic)) is None:
        return False
    _, times, values = turning
    first, *_, last = topic.stamps[part] / 1e9
    during = (times >= first) & (times <= last)
    return bool(during.any()) and float(np.abs(values[during]).max()) < 0.02
