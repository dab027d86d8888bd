# SPDX-License-Identifier: Apache-2.0
"""Messages of the bus that say where things are: poses, odometry, maps, transforms, joints, fixes.

Rule: the fields of the ROS types in the words of the bus, with their units; the same rules as in
`messages`. Of a covariance all 36 or 9 numbers travel; 0 in all of them stands for unknown. A truth
without errors has zeros too.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from groundlink.core.fields import Quaternion, Vector3

from .base import BusMessage, Reading, exactly
from .imagery import Uint32

COVARIANCE_6X6_BYTES = 36 * 8


class PoseStamped(BusMessage, frozen=True):
    """A pose at an instant (geometry_msgs/PoseStamped): frame_from_what-it-is-the-pose-of."""

    stamp_nanos: int
    frame: str
    position_m: Vector3
    orientation: Quaternion


class Odometry(Reading, frozen=True):
    """Where a body is and how it moves (nav_msgs/Odometry)."""

    stamp_nanos: int
    frame: str
    """The pose is expressed in it: frame_from_child."""

    child_frame: str
    """The velocities are expressed in it."""

    position_m: Vector3
    orientation: Quaternion
    linear_mps: Vector3
    angular_radps: Vector3
    pose_covariance: memoryview
    """float64, 6 x 6, row after row: x, y, z (m), then turns about x, y, z (rad)."""

    twist_covariance: memoryview
    """float64, 6 x 6, row after row, in the same order."""

    def __post_init__(self) -> None:
        exactly(self.pose_covariance, COVARIANCE_6X6_BYTES, "pose_covariance")
        exactly(self.twist_covariance, COVARIANCE_6X6_BYTES, "twist_covariance")


class OccupancyGrid(BusMessage, frozen=True):
    """A map of what is occupied (nav_msgs/OccupancyGrid)."""

    stamp_nanos: int
    frame: str
    loaded_nanos: int
    """When the map was made, as its maker says."""

    resolution_m: float
    """Edge of a cell."""

    width: Uint32
    """Cells along x."""

    height: Uint32
    """Cells along y."""

    origin_position_m: Vector3
    """Of the outer corner of cell (0, 0)."""

    origin_orientation: Quaternion
    """frame_from_map."""

    cells: memoryview
    """int8, row after row along x: 0..100 percent occupied, -1 unknown."""

    def __post_init__(self) -> None:
        exactly(self.cells, self.width * self.height, "cells")


class Transform(Struct, frozen=True):
    """parent_from_child at an instant."""

    stamp_nanos: int
    parent: str
    child: str
    translation_m: Vector3
    rotation: Quaternion


class Transforms(BusMessage, frozen=True):
    """Transforms of the tf tree (tf2_msgs/TFMessage)."""

    transforms: Annotated[tuple[Transform, ...], Meta(min_length=1)]

    @property
    def stamp_nanos(self) -> int:
        """The instant of the newest."""
        return max(transform.stamp_nanos for transform in self.transforms)


class JointState(BusMessage, frozen=True):
    """The state of some joints (sensor_msgs/JointState); what is unknown is empty."""

    stamp_nanos: int
    frame: str
    names: tuple[str, ...]
    positions: memoryview
    """float64, one a joint: rad, or m for sliding ones."""

    velocities: memoryview
    """float64, one a joint: rad/s or m/s."""

    efforts: memoryview
    """float64, one a joint: N m or N."""

    def __post_init__(self) -> None:
        for field in ("positions", "velocities", "efforts"):
            array: memoryview = getattr(self, field)
            if len(array):
                exactly(array, len(self.names) * 8, field)


class Text(BusMessage, frozen=True):
    """A text, such as a vehicle's description (std_msgs/String, which has no stamp)."""

    stamp_nanos: int
    text: str


class NavSatFix(Reading, frozen=True):
    """A position by satellites (sensor_msgs/NavSatFix), WGS 84."""

    stamp_nanos: int
    frame: str
    """Of the antenna."""

    status: Annotated[int, Meta(ge=-2, le=2)]
    """sensor_msgs/NavSatStatus: -2 unknown, -1 no fix, 0 fix, 1 satellite, 2 ground augmented."""

    service: Annotated[int, Meta(ge=0, le=2**16 - 1)]
    """Sum of 1 GPS, 2 GLONASS, 4 BeiDou, 8 Galileo."""

    latitude_deg: float
    """As the two below, NaN where there is no fix."""

    longitude_deg: float
    altitude_m: float
    """Above the ellipsoid."""

    position_covariance_m2: memoryview
    """float64, 3 x 3, row after row: east, north, up."""

    covariance_type: Annotated[int, Meta(ge=0, le=3)]
    """0 unknown, 1 approximated, 2 the diagonal is known, 3 known."""

    def __post_init__(self) -> None:
        exactly(self.position_covariance_m2, 9 * 8, "position_covariance_m2")
