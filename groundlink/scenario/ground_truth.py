# SPDX-License-Identifier: Apache-2.0
"""Ground truth that a scenario can ask for: of vehicles, of all bodies, and the true map.

A part of `schema`: the types alone define what is allowed.
"""

from typing import Annotated

from msgspec import Meta

from groundlink.core.fields import Spec

from .every_sensor import Frame, Rate, RosTopic


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
