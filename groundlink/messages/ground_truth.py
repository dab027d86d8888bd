# SPDX-License-Identifier: Apache-2.0
"""Messages of ground truth: poses of all bodies, and the true points behind LiDAR clouds.

They have no errors and therefore no covariances. The true motion of a vehicle and its wheels uses
the messages of `navigation`.
"""

from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from .base import POINT, BusMessage, exactly, floats, whole

WORLD_FRAME = "world"
"""World frame (ENU), in which the scenario's placements are given."""

TRUE_POINT = np.dtype([*POINT.descr, ("body", "<u4")])
"""`POINT` with the number of the body that the point is on, as in `groundlink.scene.bodies`, or its
`NO_BODY`."""


class Bodies(BusMessage, frozen=True):
    """Poses of all bodies of a run (tf2_msgs/TFMessage)."""

    stamp_nanos: int
    names: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Names of all bodies. The index of a name is the body's number (`groundlink.scene.bodies`)."""

    poses: memoryview
    """float64, a row of x, y, z (m), qx, qy, qz, qw for each body: world_from_body."""

    def __post_init__(self) -> None:
        exactly(self.poses, len(self.names) * 7 * 8, "poses")

    def world_from_body(self) -> NDArray[np.float64]:
        """Return the poses, shape (bodies, 7): position xyz in m, quaternion xyzw."""
        return floats(self.poses).reshape(-1, 7)


class TruePoints(BusMessage, frozen=True):
    """True points of a LiDAR cloud, without errors and as if measured at one instant."""

    stamp_nanos: int
    """Stamp of the cloud."""

    frame: str
    points: memoryview
    """`TRUE_POINT` records, one for each point of the cloud, in the same order. A point is where
    its ray met a surface, moved with that surface to the stamp, in the sensor's frame at the
    stamp."""

    def __post_init__(self) -> None:
        whole(self.points, TRUE_POINT.itemsize, "points")

    def records(self) -> NDArray[np.void]:
        """Return the points as a structured array, shape (N,), dtype `TRUE_POINT`."""
        return np.frombuffer(self.points, TRUE_POINT)
