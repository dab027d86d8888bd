# SPDX-License-Identifier: Apache-2.0
"""Joints: sensor_msgs/JointState."""

import numpy as np

from sensor_conformance.readings.motion import JointReadings
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import named_plot, plot
from sensor_conformance.signals.statistics import slope

from .clause import ClauseResult, NotTested, clause, findings, result

DEFINITION = "sensor_msgs/JointState"


@clause("joints.lengths", "Arrays have one element a joint, or none", DEFINITION, JointReadings)
def lengths(topic: JointReadings, recording: CheckedRecording) -> ClauseResult:
    """Position, velocity and effort are as long as name, or empty."""
    found = [
        f"{names} names, {position} positions, {velocity} velocities, {effort} efforts"
        for names, position, velocity, effort in topic.lengths
        if {position, velocity, effort} - {0, names}
    ]
    parts = ("name", "position", "velocity", "effort")
    wrong = [one for one in topic.lengths if set(one[1:]) - {0, one[0]}]
    one = (wrong or list(topic.lengths))[:1]
    picture = named_plot("elements", dict(zip(parts, one[0], strict=True))) if one else None
    return findings(found, f"{len(topic.joints)} joints", picture)


@clause(
    "joints.velocity",
    "Velocities are the derivative of positions",
    f"{DEFINITION}; REP 103: rad and rad/s",
    JointReadings,
)
def velocity(topic: JointReadings, recording: CheckedRecording) -> ClauseResult:
    """Of each joint that moves, differences of positions are the velocities."""
    found, picture, tested = [], None, 0
    for joint, rows in topic.joints.items():
        index, angle, speed = np.array(rows).T
        if len(index) < 20 or len(topic.stamps) != len(topic.received):
            continue
        times = topic.stamps[index.astype(int)] / 1e9
        if np.any(np.diff(times) <= 0) or not np.isfinite(angle).all():
            continue
        # Angles may be given within one turn.
        turned = np.unwrap(angle) if np.ptp(angle) <= 2 * np.pi + 0.01 else angle
        stride = max(1, round(0.1 / float(np.median(np.diff(times)))))
        derived = (turned[stride:] - turned[:-stride]) / (times[stride:] - times[:-stride])
        sums = np.concatenate(([0], np.cumsum((speed[1:] + speed[:-1]) / 2)))
        given = (sums[stride:] - sums[:-stride]) / stride
        if float(np.sqrt(np.mean(derived**2))) < 0.1 or len(derived) < 10:
            continue
        tested += 1
        ratio, alike = slope(derived, given)
        holds = 0.7 < ratio < 1.4 and alike > 0.7
        if not holds:
            found.append(f"{joint}: {ratio:.2f} of the derivative")
        if picture is None or not holds:
            picture = plot(
                "time, s",
                "rad/s",
                (f"velocity of {joint}", times[stride:] - times[0], given),
                ("derivative", times[stride:] - times[0], derived),
            )
    if not tested:
        raise NotTested("no joint with position and velocity moves")
    return result(not found, "; ".join(found) or f"{tested} joints", picture)
