# SPDX-License-Identifier: Apache-2.0
"""Messages with poses, odometry, maps, transforms, joint states and satellite fixes.

They have the fields of the ROS types, with units in the names. A covariance has all 36 or 9 values;
all zeros mean unknown. Ground truth without errors has zeros too.
"""

from typing import Annotated

from msgspec import Meta, Struct

from groundlink.core.fields import Quaternion, Vector3

from .base import BusMessage, Reading, exactly
from .imagery import Uint32

COVARIANCE_6X6_BYTES = 36 * 8


class PoseStamped(BusMessage, frozen=True):
    """A pose of a body in `frame` at an instant (geometry_msgs/PoseStamped)."""

    stamp_nanos: int
    frame: str
    position_m: Vector3
    orientation: Quaternion


class Odometry(Reading, frozen=True):
    """Pose and velocity of a body (nav_msgs/Odometry)."""

    stamp_nanos: int
    frame: str
    """Frame of the pose: frame_from_child."""

    child_frame: str
    """Frame of the velocities."""

    position_m: Vector3
    orientation: Quaternion
    linear_mps: Vector3
    angular_radps: Vector3
    pose_covariance: memoryview
    """float64, 6 x 6, row-major: x, y, z (m), rotations about x, y, z (rad)."""

    twist_covariance: memoryview
    """float64, 6 x 6, row-major, in the same order."""

    def __post_init__(self) -> None:
        exactly(self.pose_covariance, COVARIANCE_6X6_BYTES, "pose_covariance")
        exactly(self.twist_covariance, COVARIANCE_6X6_BYTES, "twist_covariance")


class OccupancyGrid(BusMessage, frozen=True):
    """Occupancy map (nav_msgs/OccupancyGrid)."""

    stamp_nanos: int
    frame: str
    loaded_nanos: int
    """Time at which the map was made, according to its publisher."""

    resolution_m: float
    """Edge length of a cell."""

    width: Uint32
    """Number of cells along x."""

    height: Uint32
    """Number of cells along y."""

    origin_position_m: Vector3
    """Position of the outer corner of cell (0, 0)."""

    origin_orientation: Quaternion
    """Orientation of frame_from_map."""

    cells: memoryview
    """int8, row-major along x: 0..100 percent occupied, -1 unknown."""

    def __post_init__(self) -> None:
        exactly(self.cells, self.width * self.height, "cells")


class Transform(Struct, frozen=True):
    """Transform parent_from_child at an instant."""

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
        """Stamp of the newest transform."""
        return max(transform.stamp_nanos for transform in self.transforms)


class JointState(BusMessage, frozen=True):
    """State of joints (sensor_msgs/JointState). A quantity that is unknown is empty.

    As a command: NaN for a joint that is not commanded by this quantity.
    """

    stamp_nanos: int
    frame: str
    names: tuple[str, ...]
    positions: memoryview
    """float64, one value per joint: rad, or m for prismatic joints."""

    velocities: memoryview
    """float64, one value per joint: rad/s or m/s."""

    efforts: memoryview
    """float64, one value per joint: N m or N."""

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
    """A satellite position, WGS 84 (sensor_msgs/NavSatFix)."""

    stamp_nanos: int
    frame: str
    """Frame of the antenna."""

    status: Annotated[int, Meta(ge=-2, le=2)]
    """sensor_msgs/NavSatStatus: -2 unknown, -1 no fix, 0 fix, 1 satellite, 2 ground augmented."""

    service: Annotated[int, Meta(ge=0, le=2**16 - 1)]
    """Sum of 1 GPS, 2 GLONASS, 4 BeiDou, 8 Galileo."""

    latitude_deg: float
    """NaN without a fix, as the two fields below."""

    longitude_deg: float
    altitude_m: float
    """Height above the ellipsoid."""

    position_covariance_m2: memoryview
    """float64, 3 x 3, row-major: east, north, up."""

    covariance_type: Annotated[int, Meta(ge=0, le=3)]
    """0 unknown, 1 approximated, 2 diagonal known, 3 known."""

    def __post_init__(self) -> None:
        exactly(self.position_covariance_m2, 9 * 8, "position_covariance_m2")
