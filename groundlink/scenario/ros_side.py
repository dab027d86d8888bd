# SPDX-License-Identifier: Apache-2.0
"""ROS side of a run: topics from and to a vehicle's stack, and the gateway.

A part of `schema`: the types alone define what is allowed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from msgspec import Meta, field

from groundlink.core.fields import Spec
from groundlink.emulation.script import LinkScript

from .every_sensor import Address, Frame, Name, Peer, Rate, Repair, RosTopic
from .joints import Quantity
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
"""Kinds of streams that are not the main stream of any sensor."""

StreamKind: TypeAlias = str
"""A kind of sensor, or one of `OTHER_STREAM_KINDS`."""

if not TYPE_CHECKING:
    _streamable = (name for name, kind in sensor_kinds().items() if kind.streamable)
    StreamKind = Literal[(*_streamable, *OTHER_STREAM_KINDS)]


class Stream(Spec, frozen=True, kw_only=True):
    """Stream of another process, on the bus as `vehicle/name`, carried by the gateway."""

    name: Name
    """Name of the stream, unique among the vehicle's sensors and streams."""

    kind: StreamKind
    """Type of the messages: a kind of sensor, or a kind that no sensor publishes."""

    topic: RosTopic
    """ROS topic of the stream."""

    rate_hz: Rate
    """Messages per second of sim time that the process publishes."""

    push: bool = True
    """True: the gateway sends the stream to its peer without a subscription. False: it sends the
    stream to subscribers only."""

    repair: Repair = "none"
    """Repair of lost datagrams between gateway and ROS. `resend` alone requests lost parts for half
    a second."""


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
"""Message types that can come from ROS. Scenario files may also use the ROS 2 form with `/msg/`."""

GATEWAY_TOPICS = frozenset({"/clock", "/tf", "/tf_static", "/ground_truth/tf"})
"""Topics that the gateway publishes to ROS; they cannot come from ROS."""


class JointGroup(Spec, frozen=True, kw_only=True):
    """Joints that one topic commands."""

    interface: Quantity
    """Quantity of the values. `velocity` and `effort`: of driven wheels and tracks, rad/s and N m.
    `position`: of steering joints and other joints, rad or m."""

    joints: Annotated[tuple[Name, ...], Meta(min_length=1)]
    """Names of the joints in the order of the values."""


class FromRos(Spec, frozen=True):
    """ROS topics of the vehicle's stack that the gateway publishes on the bus."""

    pose: RosTopic | None = None
    """geometry_msgs/PoseStamped: the stack's estimate of the vehicle's pose."""

    odometry: RosTopic | None = None
    """nav_msgs/Odometry: the same estimate with velocities."""

    map: RosTopic | None = None
    """nav_msgs/OccupancyGrid: the stack's map."""

    joints: RosTopic | None = None
    """sensor_msgs/JointState: commands for driven wheels, steering joints and other joints."""

    joint_groups: dict[RosTopic, JointGroup] = field(default_factory=dict)
    """Topics of std_msgs/Float64MultiArray with commands for groups of joints, as ros2_controllers
    take them, such as {/velocity_controller/commands: {interface: velocity, joints: [left,
    right]}}."""

    topics: dict[RosTopic, RosType] = field(default_factory=dict)
    """Further topics with their types, such as {/plan: nav_msgs/Path}."""

    def all_topics(self) -> list[str]:
        """Return all topics to subscribe to."""
        named = (self.pose, self.odometry, self.map, self.joints)
        return [*(topic for topic in named if topic is not None), *self.joint_groups, *self.topics]


RosTopics = Annotated[tuple[RosTopic, ...], Meta(min_length=1)]


class RosNode(Spec, frozen=True, kw_only=True):
    """A ROS node, or one of several rules by which a node publishes."""

    name: Name
    """Name of the node. Rules of one node have the same name."""

    consumes: RosTopics
    """Topics that the node subscribes to and answers, each published by another node of the list or
    sent to ROS by the gateway."""

    publishes: RosTopics
    """Topics on which the node publishes one message as its answer. One node publishes a topic."""

    every: Annotated[int, Meta(ge=1, le=254)] = 1
    """The node answers every n-th message of each input."""

    joins: bool = False
    """The node answers once for each stamp that all its inputs have, as the exact synchronizers of
    message_filters do. Messages without a header count by their number on their topic."""

    def __post_init__(self) -> None:
        if self.joins and (self.every > 1 or len(self.consumes) < 2):
            raise ValueError(
                f"node `{self.name}`: `joins` needs at least two topics in `consumes` and no "
                "`every`"
            )


class TfTree(Spec, frozen=True):
    """Transforms of the vehicle's tf tree that the gateway publishes, beside the sensor mounts."""

    odom: bool = True
    """odom -> base_link from the vehicle's first wheel odometry. False: a filter of the stack
    publishes it."""

    map: Literal["none", "identity", "truth"] = "none"
    """map -> odom. `none`: a localization node of the stack publishes it, as on a real robot.
    `identity`: both frames are equal. `truth`: the result of an ideal localization; the map
    frame is the world frame."""

    def __post_init__(self) -> None:
        if self.map == "truth" and not self.odom:
            raise ValueError("`map: truth` needs `odom: true`, which publishes the transform below")


class GroundTruth(Spec, frozen=True):
    """Ground truth of a vehicle, published by physics for evaluation. A stack must not use it."""

    topic: RosTopic | None = None
    """Topic of the odometry; default: `ground_truth/odom` in the vehicle's namespace."""

    wheels_topic: RosTopic | None = None
    """Topic of the wheels' angles, speeds and torques; default: `ground_truth/wheels` in the
    vehicle's namespace."""

    joints_topic: RosTopic | None = None
    """Topic of positions and speeds of the vehicle's other joints; default: `ground_truth/joints`
    in the vehicle's namespace."""

    rate_hz: Rate = 50.0
    """Messages per second of sim time."""

    push: bool = False
    """True: the gateway sends the stream to its peer without a subscription. False: it sends the
    stream to subscribers only."""


class BodyPoses(Spec, frozen=True):
    """True poses of all bodies, moving and static, published by physics."""

    topic: RosTopic = "/ground_truth/bodies"
    """ROS topic of the poses, tf2_msgs/TFMessage."""

    rate_hz: Rate = 10.0
    """Rate of the poses. It is lower than that of a vehicle's ground truth, since there may be
    hundreds of bodies and most do not move."""

    push: bool = False
    """True: the gateway sends the stream to its peer without a subscription. False: it sends the
    stream to subscribers only."""


class TrueMap(Spec, frozen=True):
    """Occupancy map of the static world on /ground_truth/map, published by physics."""

    resolution_m: Annotated[float, Meta(gt=0)] = 0.05
    """Edge length of a cell."""

    heights_m: tuple[float, float] | None = None
    """Lowest and highest height of obstacles above the ground; none: the height of the first planar
    scanner, or 0.1 and 1.0 m without one."""

    frame: Frame = "world"
    """tf frame of the map. A stack that takes the map as its own needs `map`."""

    rate_hz: Rate = 1.0
    """Messages per second of sim time. In ROS, a late subscriber gets the last one."""

    def __post_init__(self) -> None:
        if self.heights_m is not None and self.heights_m[0] > self.heights_m[1]:
            raise ValueError("`heights_m`: expected the lower height first")


class RmwZenoh(Spec, frozen=True):
    """Connection to ROS 2 nodes that run rmw_zenoh, without a bridge; experimental."""

    connect: str = "tcp/127.0.0.1:7447"
    """Zenoh router of the ROS 2 nodes, such as rmw_zenohd. It is not the router of the run."""

    domain_id: Annotated[int, Meta(ge=0, le=232)] = 0
    """ROS_DOMAIN_ID of the nodes."""

    type_hashes: bool = True
    """Whether keys contain type hashes. False for ROS 2 Humble, which has none."""


class GatewaySettings(Spec, frozen=True):
    """Settings of the gateway, the UDP Bridge endpoint on the simulator's side."""

    bind: Address = "127.0.0.1:7510"
    """Address on which the gateway receives datagrams."""

    peer: Address = "127.0.0.1:7511"
    """Address of the ROS side. All streams with `push` go there."""

    datagram: Literal["mtu", "loopback"] | Annotated[int, Meta(ge=256, le=65507)] = "loopback"
    """Largest datagram, in bytes of UDP payload. `mtu`: 1,472, which fits an Ethernet frame.
    `loopback`: parts of 65,280 bytes, for a peer on the same machine."""

    signed_peer: bool = False
    """Whether the peer reads the counts of the header as signed numbers. Messages then have at most
    127 parts instead of 255."""

    peers: tuple[Peer, ...] = ()
    """Hosts that the gateway accepts datagrams from, besides the peer's host. Datagrams from others
    are counted and dropped."""

    key_file: str | None = None
    """File with the key that both ends share, on the gateway's machine. None: datagrams are not
    sealed."""

    key_env: str | None = None
    """Environment variable with that key, instead of a file."""

    link: LinkScript | None = None
    """Emulated network impairments of the link; none: no emulation."""

    rmw_zenoh: RmwZenoh | None = None
    """Additional connection to ROS 2 by Zenoh; none: UDP Bridge only."""

    def __post_init__(self) -> None:
        if self.key_file is not None and self.key_env is not None:
            raise ValueError("`key_file` and `key_env` are both given. Fix: keep one")
