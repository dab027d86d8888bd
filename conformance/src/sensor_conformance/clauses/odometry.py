# SPDX-License-Identifier: Apache-2.0
"""Odometry: nav_msgs/Odometry and REP 105."""

import numpy as np
from numpy.typing import NDArray

from sensor_conformance.readings.base import Floats
from sensor_conformance.readings.motion import OdometryReadings
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import count_plot, plot
from sensor_conformance.signals.rotations import inverse, normalized, rates, rotate
from sensor_conformance.signals.statistics import slope

from .clause import ClauseResult, NotTested, clause, findings, result

Indices = NDArray[np.int64]
DEFINITION = "nav_msgs/Odometry"
LEAST_SPEED = 0.1
"""m/s and rad/s below which there is no motion to compare."""
MOST_JUMP = 0.5
"""Meters between two messages beyond what the twist explains."""


@clause("odometry.frames", "Pose and twist have frames of their own", DEFINITION, OdometryReadings)
def frames(topic: OdometryReadings, recording: CheckedRecording) -> ClauseResult:
    """Header and child frame are set and differ."""
    parents, children = set(topic.frames), set(topic.child_frames)
    found = []
    if "" in parents | children:
        found.append("a frame is not set")
    if parents & children - {""}:
        found.append(f"pose and twist are both in {sorted(parents & children)[0]!r}")
    if len(parents) > 1 or len(children) > 1:
        found.append("frames change")
    return findings(found, f"{', '.join(parents)} to {', '.join(children)}")


@clause("odometry.finite", "All readings are numbers", DEFINITION, OdometryReadings)
def finite(topic: OdometryReadings, recording: CheckedRecording) -> ClauseResult:
    """Poses and twists are finite, rotations have the length 1."""
    rows = np.hstack((topic.position, topic.orientation, topic.linear, topic.angular))
    wrong = ~np.isfinite(rows).all(axis=1)
    bad = int(np.count_nonzero(wrong))
    lengths = np.abs(np.linalg.norm(topic.orientation, axis=1) - 1)
    off = float(np.nanmax(lengths))
    picture = count_plot("wrong readings", wrong | (lengths >= 1e-3))
    line = f"{bad} readings not finite; quaternions off by {off:.2g}"
    return result(bad == 0 and off < 1e-3, line, picture)


@clause(
    "odometry.twist",
    "The linear twist is the derivative of the pose, in the child frame",
    f"{DEFINITION}: twist in child_frame_id; REP 103: m/s",
    OdometryReadings,
)
def twist(topic: OdometryReadings, recording: CheckedRecording) -> ClauseResult:
    """Velocities from successive positions, turned into the child frame, are those of the twist."""
    times, index = _spaced(topic, 0.2)
    duration = np.diff(times)
    moved = np.diff(topic.position[index], axis=0)
    turned = np.diff(normalized(topic.orientation)[index], axis=0)
    middle = normalized(normalized(topic.orientation)[index][:-1] + turned / 2)
    derived = rotate(inverse(middle), moved / duration[:, None])
    given = _means(topic.linear, index)
    speed = float(np.sqrt(np.mean(np.sum(derived**2, axis=1))))
    if speed < LEAST_SPEED:
        raise NotTested(f"moves at {speed:.2f} m/s only")
    along = slope(derived[:, 0], given[:, 0])[0]
    error = float(np.sqrt(np.mean(np.sum((derived - given)[:, :2] ** 2, axis=1))))
    picture = plot(
        "time, s",
        "forward speed, m/s",
        ("twist", times[1:], given[:, 0]),
        ("pose", times[1:], derived[:, 0]),
    )
    line = f"twist is {along:.3f} of the derivative; difference {error:.3f} at {speed:.2f} m/s"
    # Controllers average the twist over some messages, so it lags behind in turns.
    return result(0.85 < along < 1.15 and error < 0.6 * speed, line, picture)


@clause(
    "odometry.turn",
    "The angular twist is the derivative of the orientation",
    "REP 103: rad/s, counterclockwise positive",
    OdometryReadings,
)
def turn(topic: OdometryReadings, recording: CheckedRecording) -> ClauseResult:
    """Yaw rates from successive orientations are those of the twist."""
    times, index = _spaced(topic, 0.2)
    derived = rates(times, topic.orientation[index])[:, 2]
    given = _means(topic.angular, index)[:, 2]
    if float(np.std(derived)) < LEAST_SPEED and abs(float(np.mean(derived))) < LEAST_SPEED:
        raise NotTested(f"turns by less than {LEAST_SPEED} rad/s")
    ratio, alike = slope(derived, given)
    picture = plot(
        "time, s", "yaw rate, rad/s", ("twist", times[1:], given), ("pose", times[1:], derived)
    )
    return result(
        0.8 < ratio < 1.25 and alike > 0.8,
        f"twist is {ratio:.3f} of the derivative (correlation {alike:.2f})",
        picture,
    )


@clause(
    "odometry.continuous", "The pose does not jump", "REP 105: odom is continuous", OdometryReadings
)
def continuous(topic: OdometryReadings, recording: CheckedRecording) -> ClauseResult:
    """No step is longer than the fastest speed explains."""
    if len(topic.stamps) < 5:
        raise NotTested("fewer than 5 messages")
    steps = np.linalg.norm(np.diff(topic.position, axis=0), axis=1)
    duration = np.diff(topic.seconds).clip(1e-3)
    usual = float(np.percentile(steps / duration, 90))
    beyond = steps - 1.5 * usual * duration
    picture = plot("time, s", "step, m", ("step", topic.seconds[1:], steps))
    limit = MOST_JUMP
    worst = float(np.nanmax(beyond))
    return result(worst <= limit, f"longest step {float(np.nanmax(steps)):.3f} m", picture)


def _spaced(topic: OdometryReadings, seconds: float) -> tuple[Floats, Indices]:
    """Return times and indices of messages at least so far apart."""
    if len(topic.stamps) < 10:
        raise NotTested("fewer than 10 messages")
    stride = max(1, round(seconds / max(topic.period, 1e-4)))
    index = np.arange(0, len(topic.stamps), stride)
    times = topic.seconds[index]
    if len(index) < 5 or np.any(np.diff(times) <= 0):
        raise NotTested("too short, or stamps do not increase")
    return times, index


def _means(values: Floats, index: Indices) -> Floats:
    """Return the mean of rows between successive indices, by the trapezoidal rule."""
    sums = np.vstack((np.zeros(values.shape[1]), np.cumsum((values[1:] + values[:-1]) / 2, axis=0)))
    return np.asarray(np.diff(sums[index], axis=0) / np.diff(index)[:, None], np.float64)
