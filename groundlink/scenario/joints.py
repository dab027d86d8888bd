# SPDX-License-Identifier: Apache-2.0
"""Joints of a vehicle other than its wheel joints, such as a turret, a gun or a mast.

A servo holds each joint at its commanded position. The links have no mass of their own, since the
chassis includes their weight; moving them does not push the base. They do not collide.
"""

from collections.abc import Sequence
from math import cos, hypot, sin
from typing import Literal, NamedTuple

from groundlink.core.fields import Positive, Quaternion, Spec, Vector3
from groundlink.core.frames import IDENTITY_QUATERNION
from groundlink.core.quaternions import multiply, rotate
from groundlink.world.solids import Solid

from .every_sensor import Name

Pose = tuple[Vector3, Quaternion]

Quantity = Literal["position", "velocity", "effort"]
"""A quantity that a joint is commanded by: a field of sensor_msgs/JointState."""


class JointInterface(NamedTuple):
    """A joint of a vehicle that takes commands from ROS."""

    name: str
    commands: tuple[Quantity, ...]
    """Quantities that it can be commanded by. The first is the one of `ros2_control`."""


class Joint(Spec, frozen=True, kw_only=True):
    """A servo joint; its link is `<name>_link`."""

    name: Name
    """Name of the joint, unique in the vehicle."""

    kind: Literal["revolute", "prismatic"] = "revolute"
    """`revolute`: turns about `axis`, positions in rad. `prismatic`: slides along `axis`, in m."""

    parent: Name | None = None
    """Name of an earlier joint whose link carries this joint; none: the base."""

    at_m: Vector3
    """Origin of the link in the parent's frame at position zero. The axes are parallel there."""

    axis: Vector3 = (0.0, 0.0, 1.0)
    """Direction of the axis in the parent's frame, of any length."""

    lower: float | None = None
    """Smallest position, rad or m; none: no limit."""

    upper: float | None = None
    """Largest position, rad or m; none: no limit."""

    max_speed: Positive
    """Speed limit of the servo, rad/s or m/s."""

    visuals: tuple[Solid, ...] = ()
    """Visual solids of the link, in its frame."""

    def __post_init__(self) -> None:
        if not hypot(*self.axis):
            raise ValueError("`axis` is zero; expected a direction")
        low, high = self.limits
        if not low <= 0.0 <= high:
            raise ValueError("`lower` to `upper` excludes 0, where a joint starts")

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest position, rad or m."""
        low = float("-inf") if self.lower is None else self.lower
        return low, float("inf") if self.upper is None else self.upper

    @property
    def unit_axis(self) -> Vector3:
        """Axis as a unit vector."""
        x, y, z = self.axis
        size = hypot(x, y, z)
        return x / size, y / size, z / size


def check(joints: Sequence[Joint], others: Sequence[str]) -> None:
    """Refuse joints with names that are taken, or with parents that are not defined before them.

    Raises
    ------
    ValueError
        with the expected value.
    """
    known: set[str] = set()
    for joint in joints:
        if joint.name in known or joint.name in others:
            raise ValueError(f"two joints or wheels are named `{joint.name}`. Fix: rename one")
        if joint.parent is not None and joint.parent not in known:
            raise ValueError(
                f"`joints`: `{joint.name}` has the parent `{joint.parent}`; expected an earlier "
                "joint, or none for the base"
            )
        known.add(joint.name)


def base_from_links(joints: Sequence[Joint], positions: Sequence[float]) -> list[Pose]:
    """Return base_from_link of each joint, at positions in rad or m."""
    poses: dict[str | None, Pose] = {None: ((0.0, 0.0, 0.0), IDENTITY_QUATERNION)}
    for joint, position in zip(joints, positions, strict=True):
        origin, turn = poses[joint.parent]
        x, y, z = joint.unit_axis
        at = joint.at_m
        if joint.kind == "prismatic":
            at = at[0] + x * position, at[1] + y * position, at[2] + z * position
        moved = rotate(turn, at)
        place = origin[0] + moved[0], origin[1] + moved[1], origin[2] + moved[2]
        if joint.kind == "revolute":
            s = sin(position / 2)
            turn = multiply(turn, (x * s, y * s, z * s, cos(position / 2)))
        poses[joint.name] = place, turn
    return [poses[joint.name] for joint in joints]
