# SPDX-License-Identifier: Apache-2.0
"""What a ROS 2 message that came from outside is on the bus.

Rule: bytes of a stranger become a message that keeps its schema, or `BadMessage`. Numbers are
finite, sizes agree, orientations have a direction: they are made unit length here, as ROS nodes
write them with few digits. Stamps are kept as they came.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from rosbags.serde import SerdeError

from groundlink.core.clock import NANOS
from groundlink.core.fields import Quaternion
from groundlink.messages.base import BadMessage, Command, Message, packed
from groundlink.messages.navigation import JointState, OccupancyGrid, Odometry, PoseStamped
from groundlink.messages.relayed import Relayed

from .types import STORE, nanos, xyz, xyzw

Body = bytes | bytearray | memoryview

MAX_NAME_BYTES = 234
"""Of a frame's name: what a datagram's header holds."""


def twist(body: Body, now_nanos: int) -> Command:
    """Return the velocity of a geometry_msgs/Twist, asked for at `now_nanos`."""
    return _command(_decoded(body, "geometry_msgs/msg/Twist"), now_nanos)


def twist_stamped(body: Body, now_nanos: int) -> Command:
    """Return the velocity of a geometry_msgs/TwistStamped, which acts when it comes.

    Its stamp may be of another clock than the run's, so it is not looked at.
    """
    return _command(_decoded(body, "geometry_msgs/msg/TwistStamped").twist, now_nanos)


def _command(found: Any, now_nanos: int) -> Command:
    linear, angular = xyz(found.linear), xyz(found.angular)
    _finite(*linear, *angular)
    return Command(now_nanos, linear, angular)


def pose_stamped(body: Body, now_nanos: int) -> PoseStamped:
    """Return a geometry_msgs/PoseStamped."""
    found = _decoded(body, "geometry_msgs/msg/PoseStamped")
    position, orientation = xyz(found.pose.position), _unit(xyzw(found.pose.orientation))
    _finite(*position)
    return PoseStamped(*_stamp_and_frame(found.header), position, orientation)


def odometry(body: Body, now_nanos: int) -> Odometry:
    """Return a nav_msgs/Odometry."""
    found = _decoded(body, "nav_msgs/msg/Odometry")
    pose, twist = found.pose, found.twist
    position, orientation = xyz(pose.pose.position), _unit(xyzw(pose.pose.orientation))
    linear, angular = xyz(twist.twist.linear), xyz(twist.twist.angular)
    _finite(*position, *linear, *angular, *pose.covariance, *twist.covariance)
    return Odometry(
        *_stamp_and_frame(found.header),
        _name(found.child_frame_id),
        position,
        orientation,
        linear,
        angular,
        packed(pose.covariance),
        packed(twist.covariance),
    )


def occupancy_grid(body: Body, now_nanos: int) -> OccupancyGrid:
    """Return a nav_msgs/OccupancyGrid; its cells may hold any int8."""
    found = _decoded(body, "nav_msgs/msg/OccupancyGrid")
    info = found.info
    cells = np.asarray(found.data, np.int8)
    if info.width * info.height != cells.size:
        raise BadMessage(f"{info.width} x {info.height} cells are said, {cells.size} are there")
    position = xyz(info.origin.position)
    _finite(info.resolution, *position)
    if not info.resolution > 0:
        raise BadMessage(f"a resolution of {info.resolution} m")
    return OccupancyGrid(
        *_stamp_and_frame(found.header),
        _checked_nanos(info.map_load_time),
        info.resolution,
        info.width,
        info.height,
        position,
        _unit(xyzw(info.origin.orientation)),
        packed(cells),
    )


def joint_state(body: Body, now_nanos: int) -> JointState:
    """Return the positions of a sensor_msgs/JointState, asked for at `now_nanos`."""
    found = _decoded(body, "sensor_msgs/msg/JointState")
    _finite(*found.position, *found.velocity)
    count = len(found.name)
    if len(found.position) != count or len(found.velocity) not in {0, count}:
        raise BadMessage(f"{count} joints with {len(found.position)} positions")
    return JointState(
        stamp_nanos=now_nanos,
        frame="",
        names=tuple(map(_name, found.name)),
        positions=packed(np.asarray(found.position, np.float64)),
        velocities=packed(np.asarray(found.velocity, np.float64)),
        efforts=memoryview(b""),
    )


READERS: dict[str, Callable[[Body, int], Message]] = {
    "geometry_msgs/msg/Twist": twist,
    "geometry_msgs/msg/TwistStamped": twist_stamped,
    "geometry_msgs/msg/PoseStamped": pose_stamped,
    "nav_msgs/msg/Odometry": odometry,
    "nav_msgs/msg/OccupancyGrid": occupancy_grid,
    "sensor_msgs/msg/JointState": joint_state,
}
"""By ROS type: a body, and the run's time for what has none of its own, to a message of the bus.
All of them raise `BadMessage`."""


def reader(message: type[Message], ros_type: str) -> Callable[[Body, int], Message]:
    """Return what reads bodies of a ROS type as messages of the bus of one type."""
    return partial(relayed, ros_type=ros_type) if message is Relayed else READERS[ros_type]


def relayed(body: Body, now_nanos: int, *, ros_type: str) -> Relayed:
    """Return a body as it came, if it is a message of its type."""
    _decoded(body, ros_type)
    return Relayed(now_nanos, ros_type, memoryview(bytes(body)))


def _decoded(body: Body, ros_type: str) -> Any:
    try:
        return STORE.deserialize_cdr(bytes(body), ros_type)
    except SerdeError as error:
        raise BadMessage(f"not a {ros_type}: {error}") from None


def _stamp_and_frame(header: Any) -> tuple[int, str]:
    return _checked_nanos(header.stamp), _name(header.frame_id)


def _checked_nanos(time: Any) -> int:
    if time.nanosec >= NANOS:
        raise BadMessage(f"a time with {time.nanosec} ns")
    return nanos(time)


def _name(name: str) -> str:
    if len(name.encode()) > MAX_NAME_BYTES or "\0" in name:
        raise BadMessage("a frame's name that no frame has")
    return name


def _finite(*numbers: float) -> None:
    if not all(map(math.isfinite, numbers)):
        raise BadMessage("a number is not finite")


def _unit(quaternion: Quaternion) -> Quaternion:
    length = math.hypot(*quaternion)
    if not 0.9 < length < 1.1:
        raise BadMessage(f"an orientation of length {length:.3g}; expected a unit quaternion")
    x, y, z, w = (component / length for component in quaternion)
    return x, y, z, w
