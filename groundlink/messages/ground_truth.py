# SPDX-License-Identifier: Apache-2.0
"""The messages of the bus that tell the truth: where all bodies are, what each LiDAR point is on.

Rule: no errors in them, so no covariances; the same rules as in `messages`. The truth about a
vehicle's motion and its wheels is told in the words of `navigation`.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from .base import POINT, BusMessage, exactly, floats, whole

WORLD_FRAME = "world"
"""ENU, the frame of the scenario's placements."""

TRUE_POINT = np.dtype([*POINT.descr, ("body", "<u4")])
"""`POINT` with the number of the body that it is on, as `groundlink.scene.bodies` counts, or its
`NO_BODY`."""


class Bodies(BusMessage, frozen=True):
    """Where every body of a run is (tf2_msgs/TFMessage)."""

    stamp_nanos: int
    names: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Of all bodies; a body's place in them is its number (`groundlink.scene.bodies`)."""

    poses: memoryview
    """float64, for each a row of x, y, z, qx, qy, qz, qw: world_from_body."""

    def __post_init__(self) -> None:
        exactly(self.poses, len(self.names) * 7 * 8, "poses")

    def world_from_body(self) -> NDArray[np.float64]:
        """Return the poses, shape (bodies, 7): position xyz in m, quaternion xyzw."""
        return floats(self.poses).reshape(-1, 7)


class TruePoints(BusMessage, frozen=True):
    """What a LiDAR's cloud would be without any error, if all of it were measured at once."""

    stamp_nanos: int
    """That of the cloud."""

    frame: str
    points: memoryview
    """`TRUE_POINT` records, one for each point of the cloud, in its order: the points where their
    rays met a surface, as that surface stands at the stamp, in the sensor's frame at the stamp."""

    def __post_init__(self) -> None:
        whole(self.points, TRUE_POINT.itemsize, "points")

    def records(self) -> NDArray[np.void]:
        """Return the points as a structured array, shape (N,), dtype `TRUE_POINT`."""
        return np.frombuffer(self.points, TRUE_POINT)
