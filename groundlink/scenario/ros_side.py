# SPDX-License-Identifier: Apache-2.0
"""How a run meets ROS: what a vehicle gives and takes there, and the gateway between.

Rule: types say what is allowed, and nothing else does, as in `schema`, of which this is a part.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from msgspec import Meta, field

from groundlink.core.fields import Spec
from groundlink.emulation import LinkScript

from .every_sensor import Address, Name, Peer, Rate, Repair, RosTopic
from .sensor_kinds import sensor_kinds

OTHER_STREAM_KINDS = (
    "camera_info",
    "compressed_image",
    "image",
    "joint_state",
    "laser_scan",
    "map",
    "nav_sat_fix",
    "odometry",
    "pose",
    "transforms",
)
"""Kinds of streams that no sensor publishes as its main one."""

StreamKind: TypeAlias = str
"""Kind of sensor, or one of `OTHER_STREAM_KINDS`."""

if not TYPE_CHECKING:
    _streamable = (name for name, kind in sensor_kinds().items() if kind.streamable)
    StreamKind = Literal[(*_streamable, *OTHER_STREAM_KINDS)]


class Stream(Spec, frozen=True, kw_only=True):
    """What another process puts on the bus under `vehicle/name`, for the gateway to carry."""

    name: Name
    kind: StreamKind
    topic: RosTopic
    rate_hz: Rate
    """What that process publishes in a second of sim time."""

    push: bool = True
    """Send to the gateway's peer unasked; if not, only to those who subscribe."""

    repair: Repair = "none"


RosType = Literal[
    "geometry_msgs/PoseStamped",
    "geometry_msgs/Twist",
    "geometry_msgs/TwistStamped",
    "groundlink_msgs/WheelEncoders",
    "nav_msgs/OccupancyGrid",
    "nav_msgs/Odometry",
    "nav_msgs/Path",
    "sensor_msgs/CameraInfo",
    "sensor_msgs/CompressedImage",
    "sensor_msgs/Image",
    "sensor_msgs/Imu",
    "sensor_msgs/JointState",
    "sensor_msgs/LaserScan",
    "sensor_msgs/NavSatFix",
    "sensor_msgs/PointCloud2",
    "sensor_msgs/Range",
    "std_msgs/String",
    "tf2_msgs/TFMessage",
]
"""What the wire can bring; in files also as ROS 2 writes it, with `/msg/`."""

TOLD_BY_THE_GATEWAY = frozenset({"/clock", "/tf", "/tf_static", "/ground_truth/tf"})
"""Topics that can't come from ROS, as they go there."""


class FromRos(Spec, frozen=True):
    """Topics of the vehicle's stack that the gateway puts on the bus."""

    pose: RosTopic | None = None
    """geometry_msgs/PoseStamped: where the stack believes the vehicle to be."""

    odometry: RosTopic | None = None
    """nav_msgs/Odometry, the same with velocities."""

    map: RosTopic | None = None
    """nav_msgs/OccupancyGrid."""

    joints: RosTopic | None = None
    """sensor_msgs/JointState: where the vehicle's `joints` are to go; it commands them."""

    topics: dict[RosTopic, RosType] = field(default_factory=dict)
    """Any others, by topic with their types, such as {/plan: nav_msgs/Path}."""

    def all_topics(self) -> list[str]:
        """Return every topic to subscribe to."""
        named = (self.pose, self.odometry, self.map, self.joints)
        return [*(topic for topic in named if topic is not None), *self.topics]


class TfTree(Spec, frozen=True):
    """What the gateway tells of the vehicle's tf tree, beside the mounts of its sensors."""

    odom: bool = True
    """odom -> base_link, as the vehicle's first wheel odometry has it; false where a filter of the
    stack tells it."""

    map: Literal["none", "identity", "truth"] = "none"
    """map -> odom. `none`: a localisation of the stack tells it, as on a real robot; `identity`:
    both are one; `truth`: what an ideal localisation would tell, and the map is the world."""

    def __post_init__(self) -> None:
        if self.map == "truth" and not self.odom:
            raise ValueError("`map: truth` needs `odom: true`: it tells the rest of the way")


class RmwZenoh(Spec, frozen=True):
    """Where ROS 2 nodes that run rmw_zenoh find the gateway's topics; experimental."""

    connect: str = "tcp/127.0.0.1:7447"
    """Their Zenoh router, such as rmw_zenohd; not the run's."""

    domain_id: Annotated[int, Meta(ge=0, le=232)] = 0
    """Their ROS_DOMAIN_ID."""

    type_hashes: bool = True
    """False for ROS 2 Humble, which has none."""


class GatewaySettings(Spec, frozen=True):
    """The UDP Bridge's end on the simulator's side."""

    bind: Address = "127.0.0.1:7510"
    peer: Address = "127.0.0.1:7511"
    """Where the ROS side listens; every stream with `push` goes there."""

    datagram: Literal["mtu", "loopback"] | Annotated[int, Meta(ge=256, le=65507)] = "loopback"
    signed_peer: bool = False
    peers: tuple[Peer, ...] = ()
    """Whom the gateway hears, besides the peer's host; what others send is counted and dropped."""

    key_file: str | None = None
    """File with the key that both ends share, on the gateway's machine; none: nothing is sealed."""

    key_env: str | None = None
    """Environment variable with that key instead."""

    link: LinkScript | None = None
    """What happens to datagrams on purpose; none: no emulation."""

    rmw_zenoh: RmwZenoh | None = None
    """Topics on ROS 2's own Zenoh, too; none: by UDP Bridge alone."""

    def __post_init__(self) -> None:
        if self.key_file is not None and self.key_env is not None:
            raise ValueError("`key_file` and `key_env` are both given; choose one")
