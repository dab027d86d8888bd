# SPDX-License-Identifier: Apache-2.0
"""The table of message types: number, name, ROS type, default topic and direction.

Numbers are wire format: a row may be added, never renumbered. `python -m tools.wire_types` writes
the table into PROTOCOL.md and the files of other languages. Bodies of the bridge's own types are in
`control`, `repair` and `typed`.
"""

from __future__ import annotations

from typing import Dict, NamedTuple, Optional

ANY_ROS_TYPE = "*"


class MessageType(NamedTuple):
    """One row of the table."""

    number: int
    """The header's msg_type, 0..255."""
    name: str
    """The name for users."""
    ros_type: Optional[str]
    """Full ROS 2 type name; `ANY_ROS_TYPE` where the body names it (`typed`); None for the bridge's
    own messages, which are not CDR."""
    default_topic: str
    """The topic that an empty topic on the wire stands for; empty where there is none."""
    direction: str
    """`to ROS`, `from ROS` or `both`."""


_ROWS = (
    MessageType(1, "PointCloud2", "sensor_msgs/msg/PointCloud2", "/points", "to ROS"),
    MessageType(2, "Imu", "sensor_msgs/msg/Imu", "/imu", "to ROS"),
    MessageType(
        3, "CompressedImage", "sensor_msgs/msg/CompressedImage", "/image/compressed", "to ROS"
    ),
    MessageType(4, "NavSatFix", "sensor_msgs/msg/NavSatFix", "/fix", "to ROS"),
    MessageType(5, "WheelEncoders", "groundlink_msgs/msg/WheelEncoders", "/wheels", "to ROS"),
    MessageType(6, "Range", "sensor_msgs/msg/Range", "/range", "to ROS"),
    MessageType(7, "Subscribe", None, "", "both"),
    MessageType(8, "Clock", "rosgraph_msgs/msg/Clock", "/clock", "to ROS"),
    MessageType(9, "Twist", "geometry_msgs/msg/Twist", "/cmd_vel", "from ROS"),
    MessageType(10, "PoseStamped", "geometry_msgs/msg/PoseStamped", "/pose", "both"),
    MessageType(11, "OccupancyGrid", "nav_msgs/msg/OccupancyGrid", "/map", "both"),
    MessageType(32, "LaserScan", "sensor_msgs/msg/LaserScan", "/scan", "to ROS"),
    MessageType(33, "Image", "sensor_msgs/msg/Image", "/image", "to ROS"),
    MessageType(34, "CameraInfo", "sensor_msgs/msg/CameraInfo", "/camera_info", "to ROS"),
    MessageType(35, "TFMessage", "tf2_msgs/msg/TFMessage", "/tf", "to ROS"),
    MessageType(36, "Odometry", "nav_msgs/msg/Odometry", "/odom", "both"),
    MessageType(37, "JointState", "sensor_msgs/msg/JointState", "/joint_states", "both"),
    MessageType(38, "TwistStamped", "geometry_msgs/msg/TwistStamped", "/cmd_vel", "from ROS"),
    MessageType(39, "String", "std_msgs/msg/String", "/robot_description", "to ROS"),
    MessageType(40, "Path", "nav_msgs/msg/Path", "/plan", "from ROS"),
    MessageType(64, "Control", None, "", "both"),
    MessageType(65, "Resend", None, "", "both"),
    MessageType(66, "Repair", None, "", "both"),
    MessageType(67, "Typed", ANY_ROS_TYPE, "", "both"),
)

MSG_TYPES: Dict[int, MessageType] = {row.number: row for row in _ROWS}
"""All message types of this version, by number."""

ROS_TYPES = frozenset(row.number for row in _ROWS if row.ros_type is not None)
"""Numbers of the types whose body is CDR; the others are the bridge's own."""

NUMBER_OF_ROS_TYPE: Dict[str, int] = {
    row.ros_type: row.number for row in _ROWS if row.ros_type not in (None, ANY_ROS_TYPE)
}
"""Number of each ROS type that has its own; messages of all others are `Typed`."""

_BY_NAME = {row.name: row.number for row in _ROWS}


def type_number(name: str) -> int:
    """Return the number of the message type called `name`.

    Raises
    ------
    ValueError
        When no type has this name; the text lists the names.
    """
    try:
        return _BY_NAME[name]
    except KeyError:
        known = ", ".join(_BY_NAME)
        raise ValueError(f"unknown message type {name!r}; expected one of {known}") from None


STAMP_ORDERED = frozenset(
    map(type_number, ("Imu", "WheelEncoders", "Twist", "Odometry", "TwistStamped"))
)
"""Types whose users integrate or obey them: a message older than the newest one is harmful. Topics
of other types may mix stamps of several sources (TFMessage), or a late message is still of use."""
SEALED = 68
"""An envelope around a datagram (`seal`), not a message, so not in the table."""
SUBSCRIBE = type_number("Subscribe")
CONTROL = type_number("Control")
RESEND = type_number("Resend")
REPAIR = type_number("Repair")
TYPED = type_number("Typed")
