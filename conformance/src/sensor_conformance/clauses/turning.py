# SPDX-License-Identifier: Apache-2.0
"""One motion, seen by all sensors: signs of turning, right-handedness, and relative delays.

The reference is the heading of odometry or tf. A gyroscope measures the yaw rate; successive
scans, clouds and pictures show it as a shift of what they see.
"""

import numpy as np

from sensor_conformance.readings.base import Floats, TopicReadings
from sensor_conformance.readings.cloud import BINS, CloudReadings
from sensor_conformance.readings.image import CameraInfoReadings, ImageReadings
from sensor_conformance.readings.motion import ImuReadings
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.readings.scan import ScanReadings
from sensor_conformance.report.plot import plot
from sensor_conformance.signals.correlation import delay, shift
from sensor_conformance.signals.statistics import slope

from .clause import ClauseResult, NotTested, clause, result

LEAST_TURN = 0.08
"""rad/s, standard deviation of the reference, below which there is nothing to compare."""
LONGEST_DELAY = 0.6
"""Seconds that are tested."""
LEAST_ALIKE = 0.6
"""Correlation with the reference at the best delay, below which a delay says nothing."""

SMOOTH = 0.4
"""Seconds over which rates are averaged before their sizes are compared."""

Rates = tuple[Floats, Floats]


def _reference(topic: TopicReadings, recording: CheckedRecording) -> tuple[str, Rates]:
    if (turning := recording.turning_of(topic)) is None:
        raise NotTested("neither odometry nor a transform from odom")
    name, times, values = turning
    values = _smooth(times, values)
    if float(np.std(values)) < LEAST_TURN:
        raise NotTested(f"{name} turns by {np.std(values):.3f} rad/s only")
    return name, (times, values)


def _smooth(times: Floats, values: Floats) -> Floats:
    """Return running means over `SMOOTH` seconds, without a delay."""
    width = 1 + 2 * round(SMOOTH / 2 / max(float(np.median(np.diff(times))), 1e-4))
    if width >= len(values):
        return values
    padded = np.pad(values, width // 2, mode="edge")
    return np.convolve(padded, np.ones(width) / width, mode="valid")


def _gyro_in_base(topic: ImuReadings, recording: CheckedRecording) -> Floats:
    """Return angular velocities about the axes of the base, as well as the recording tells."""
    if (turned := recording.in_base(topic, topic.gyro)) is not None:
        return turned
    median = np.nanmedian(topic.acceleration, axis=0)
    if median[2] < 0.9 * np.linalg.norm(median):
        raise NotTested(f"tf does not know the mount of {topic.frame!r}, and its z is not upwards")
    return topic.gyro


def _turn_of(topic: TopicReadings, recording: CheckedRecording) -> Rates:
    """Return times and yaw rates in rad/s that a topic shows."""
    if len(topic.stamps) < 12 or np.any(np.diff(topic.stamps) <= 0):
        raise NotTested("fewer than 12 messages, or stamps do not increase")
    times = topic.stamps / 1e9
    if isinstance(topic, ImuReadings):
        return times, _smooth(times, _gyro_in_base(topic, recording)[:, 2])
    if isinstance(topic, CloudReadings):
        return _by_shifts(times, topic.profiles, np.radians(360 / BINS), True, recording, topic)
    if isinstance(topic, ScanReadings):
        step = topic.headers[0].angle_increment
        if not np.isfinite(step) or step == 0:
            raise NotTested("angle_increment is zero")
        whole = abs(abs(step) * topic.headers[0].ranges - 2 * np.pi) < 2 * abs(step)
        return _by_shifts(times, topic.profiles, step, whole, recording, topic)
    assert isinstance(topic, ImageReadings)
    if not topic.is_picture or topic.profiles is None:
        raise NotTested("no pictures that can be decoded")
    width = topic.profiles.shape[1]
    focal = _focal_length(topic, recording)
    # Towards higher columns is clockwise: x of an optical frame points right.
    return _by_shifts(times, topic.profiles, -1 / focal if width else 0, False, recording, topic)


def _axis_that_turns(
    topic: ImuReadings, recording: CheckedRecording, reference: Rates
) -> tuple[str, float]:
    """Return which of x and y of the base follows the reference better, and its correlation."""
    times, gyro = topic.stamps / 1e9, _gyro_in_base(topic, recording)
    given = np.interp(times, *reference)
    alike = {}
    for axis, name in enumerate("xy"):
        values = _smooth(times, gyro[:, axis])
        alike[name] = slope(given - given.mean(), values - values.mean())[1]
    best = max(alike, key=lambda name: abs(alike[name]))
    return best, alike[best]


def _by_shifts(
    times: Floats,
    profiles: Floats,
    radians: float,
    circular: bool,
    recording: CheckedRecording,
    topic: TopicReadings,
) -> Rates:
    """Return yaw rates from shifts of successive profiles of the surroundings."""
    base = recording.in_base(topic, np.array([0.0, 0.0, 1.0]))
    if base is not None and not isinstance(topic, ImageReadings) and abs(base[2]) < 0.9:
        raise NotTested("not mounted upright")
    sign = (
        -1.0 if base is not None and base[2] < 0 and not isinstance(topic, ImageReadings) else 1.0
    )
    most = min(
        profiles.shape[1] // 4, max(8, round(2.5 * np.median(np.diff(times)) / abs(radians)))
    )
    middle, found = [], []
    for index in range(1, len(profiles)):
        moved, alike = shift(profiles[index - 1], profiles[index], most, circular)
        if alike > 0.6 and np.isfinite(moved):
            middle.append((times[index] + times[index - 1]) / 2)
            # Surroundings move against the turn.
            found.append(-sign * moved * radians / (times[index] - times[index - 1]))
    if len(found) < 10:
        raise NotTested("successive profiles are not alike: what is seen has too little structure")
    return np.array(middle), np.array(found)


def _focal_length(topic: ImageReadings, recording: CheckedRecording) -> float:
    space = topic.name.removesuffix("/compressed").rpartition("/")[0]
    for info in recording.of(CameraInfoReadings):
        if info.name.rpartition("/")[0] == space and hasattr(info, "k") and info.k[0, 0] > 0:
            return float(info.k[0, 0])
    raise NotTested("no camera_info beside the pictures")


@clause(
    "turning.direction",
    "A turn to the left is positive in every sensor",
    "REP 103: right-handed, counterclockwise about z",
    ImuReadings,
    CloudReadings,
    ScanReadings,
    ImageReadings,
)
def direction(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """The yaw rate that a sensor shows correlates with the reference."""
    name, reference = _reference(topic, recording)
    times, values = _turn_of(topic, recording)
    given = np.interp(times, *reference)
    _, alike = slope(given - given.mean(), values - values.mean())
    # A shared delay hides a correlation, not its sign: search for the best of either sign.
    _, _, scores = delay(reference, (times, values), LONGEST_DELAY, 0.02)
    best = float(scores[np.argmax(np.abs(scores))]) if len(scores) else 0.0
    strongest = best if abs(best) > abs(alike) else alike
    picture = plot(
        "time, s",
        "yaw rate, rad/s",
        (name, times - times[0], given),
        (topic.name, times - times[0], values),
    )
    if isinstance(topic, ImuReadings) and abs(strongest) < LEAST_ALIKE:
        axis, other = _axis_that_turns(topic, recording, reference)
        if abs(other) > 0.8:
            return result(False, f"{axis} follows {name} ({other:.2f}), z does not", picture)
    if abs(strongest) < LEAST_ALIKE:
        raise NotTested(f"correlation of {strongest:.2f} only with {name}")
    return result(strongest >= LEAST_ALIKE, f"correlation {strongest:.2f} with {name}", picture)


@clause(
    "turning.scale",
    "A gyroscope measures rad/s about the axes of its frame",
    "REP 103: rad/s; REP 145",
    ImuReadings,
)
def scale(topic: ImuReadings, recording: CheckedRecording) -> ClauseResult:
    """The yaw rate of the gyroscope is as large as the reference."""
    name, (at, values) = _reference(topic, recording)
    times, gyro = _turn_of(topic, recording)
    given = np.interp(times, at, values)
    ratio, alike = slope(given - given.mean(), gyro - gyro.mean())
    if abs(alike) < LEAST_ALIKE:
        raise NotTested(f"correlation of {alike:.2f} only with {name}")
    picture = plot(
        "time, s",
        "yaw rate, rad/s",
        (name, times - times[0], given),
        (topic.name, times - times[0], gyro),
    )
    return result(0.75 < abs(ratio) < 1.33, f"{abs(ratio):.3f} of {name}", picture)


@clause(
    "turning.delay",
    "Sensors see a motion at the same time",
    "sensor_msgs: header.stamp is the time of acquisition",
    ImuReadings,
    CloudReadings,
    ScanReadings,
    ImageReadings,
)
def relative_delay(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """The cross-correlation of yaw rates has its maximum near zero delay."""
    name, reference = _reference(topic, recording)
    times, values = _turn_of(topic, recording)
    found, delays, scores = delay(reference, (times, values), LONGEST_DELAY, 0.01)
    alike = float(np.max(scores)) if len(scores) else 0.0
    if not np.isfinite(found) or alike < LEAST_ALIKE:
        raise NotTested(f"correlation of {alike:.2f} only with {name}")
    # The stamp of a scan is its beginning or its end: half a period either way is by definition.
    slack = topic.period if not isinstance(topic, ImuReadings) else 0.0
    limit = 0.06 + slack
    picture = plot("delay, s", "correlation", (topic.name, delays, scores))
    line = (
        f"{1e3 * found:+.0f} ms behind {name} (limit {1e3 * limit:.0f} ms, correlation {alike:.2f})"
    )
    return result(abs(found) <= limit, line, picture)
