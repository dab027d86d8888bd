# SPDX-License-Identifier: Apache-2.0
"""Transforms of the tf tree that are computed from ground truth.

Input is odometry and ground truth. Each transform is returned as soon as the ground truth of its
instant is known.
"""

from collections import deque
from collections.abc import Iterator

import numpy as np

from groundlink.core.frames import conjugate, matrix_from_quaternion, multiply, nlerp
from groundlink.messages.base import measured_nanos
from groundlink.messages.navigation import Odometry, Transform

WAITING = 1024
"""Limit of odometry that waits for the ground truth of its instant, and of ground truth that is
ahead of the odometry: 2.5 s at most."""


class TopFromTruth:
    """Pose of the topmost frame of a vehicle's tree in the world, as ideal localization gives it.

    Parameters
    ----------
    parent, child
        frames of the transforms.
    without_odometry
        whether there is no odometry, so that `child` is the base frame.
    """

    def __init__(self, parent: str, child: str, *, without_odometry: bool) -> None:
        self._parent, self._child, self._without_odometry = parent, child, without_odometry
        self._odometry: deque[Odometry] = deque(maxlen=WAITING)
        self._truths: deque[Odometry] = deque(maxlen=WAITING)

    def restart(self) -> None:
        """Reset the state."""
        self._odometry.clear()
        self._truths.clear()

    def receive(self, role: str, message: Odometry) -> Iterator[tuple[int, Transform]]:
        """Yield the instant and transform of each odometry once its ground truth is known."""
        if role == "truth" and self._without_odometry:
            placed = message.position_m, message.orientation
            yield (
                message.stamp_nanos,
                stamped(message.stamp_nanos, self._parent, self._child, *placed),
            )
            return
        known = self._truths if role == "truth" else self._odometry
        if known and measured_nanos(message) < measured_nanos(known[-1]):
            self.restart()  # Time jumped back, as in a replay that loops.
        known.append(message)
        while self._odometry and self._truths:
            odometry = self._odometry[0]
            if self._truths[-1].stamp_nanos < measured_nanos(odometry):
                return
            self._odometry.popleft()
            if self._truths[0].stamp_nanos <= measured_nanos(odometry):
                yield measured_nanos(odometry), self._between(odometry)

    def _between(self, odometry: Odometry) -> Transform:
        """Return world_from_odom = world_from_base @ base_from_odom at an odometry's instant."""
        at = measured_nanos(odometry)
        while len(self._truths) > 1 and self._truths[1].stamp_nanos <= at:
            self._truths.popleft()
        before = self._truths[0]
        after = before if before.stamp_nanos == at else self._truths[1]
        span = after.stamp_nanos - before.stamp_nanos
        fraction = np.float64((at - before.stamp_nanos) / span if span else 0.0)
        first, second = np.array(before.position_m), np.array(after.position_m)
        position = first + fraction * (second - first)
        turned = nlerp(
            np.array(before.orientation), np.array(after.orientation), np.array(fraction)
        )
        rotation = multiply(turned, conjugate(odometry.orientation))
        moved = position - matrix_from_quaternion(rotation) @ np.array(odometry.position_m)
        x, y, z = moved.tolist()
        qx, qy, qz, qw = rotation.tolist()
        return stamped(
            *(odometry.stamp_nanos, self._parent, self._child, (x, y, z), (qx, qy, qz, qw))
        )


def stamped(
    stamp_nanos: int,
    parent: str,
    child: str,
    translation_m: tuple[float, float, float],
    rotation: tuple[float, float, float, float],
) -> Transform:
    """Return parent_from_child at an instant."""
    return Transform(
        stamp_nanos=stamp_nanos,
        parent=parent,
        child=child,
        translation_m=translation_m,
        rotation=rotation,
    )
