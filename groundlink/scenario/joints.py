# SPDX-License-Identifier: Apache-2.0
"""Joints of a vehicle other than its wheel joints: servo joints, and arms that swing freely.

A servo holds a turret, a gun or a mast at its commanded position. The links have no mass of their
own, since the chassis includes their weight; moving them does not push the base. Arms carry wheels,
as rockers and bogies do. Neither collides.
"""

from collections.abc import Mapping, Sequence
from math import cos, hypot, sin
from typing import Annotated, Literal, NamedTuple

from msgspec import Meta

from groundlink.core.fields import Positive, Quaternion, Size3, Spec, Vector3
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


class Arm(Spec, frozen=True, kw_only=True):
    """A beam between body and wheels that swings freely about y; its link is `<name>_link`.

    Positions are in the base frame with the arm at rest, where its angle is zero and its axes are
    parallel to the base's. Positive angles raise the rear.
    """

    name: Name
    """Name of the arm and its joint, unique in the vehicle."""

    parent: Name | None = None
    """Name of an earlier arm that carries this one; none: the base."""

    wheels: tuple[Name, ...] = ()
    """Names of the wheels that it carries."""

    pivot_m: Vector3
    """Place of its joint, and origin of its link."""

    mass_kg: Positive
    """Mass of the arm without wheels."""

    size_m: Size3
    """Full lengths along x, y, z of a uniform box with the arm's moments of inertia."""

    center_m: Vector3 | None = None
    """Center of mass; none: the pivot."""

    lower_deg: float = -60.0
    """Smallest angle; there is a stop."""

    upper_deg: float = 60.0
    """Largest angle; there is a stop."""

    visuals: tuple[Solid, ...] = ()
    """Visual solids of the link, in its frame."""

    def __post_init__(self) -> None:
        if not -180.0 < self.lower_deg < 0.0 < self.upper_deg < 180.0:
            raise ValueError("expected `lower_deg` below 0 and `upper_deg` above, within 180")

    @property
    def inertia_kgm2(self) -> float:
        """Moment of inertia about the pivot, without what the arm carries."""
        (x, _, z), (px, _, pz), (length, _, height) = self.mass_center_m, self.pivot_m, self.size_m
        about_center = (length**2 + height**2) / 12
        return self.mass_kg * (about_center + (x - px) ** 2 + (z - pz) ** 2)

    @property
    def mass_center_m(self) -> Vector3:
        """Center of mass at rest, in the base frame."""
        return self.pivot_m if self.center_m is None else self.center_m


class Linkage(Spec, frozen=True, kw_only=True):
    """Arms that let the wheels follow uneven ground, such as those of a rocker-bogie."""

    arms: Annotated[tuple[Arm, ...], Meta(min_length=1)]
    """Arms, parents before children."""

    differential: tuple[Name, Name] | None = None
    """Two arms on the base that a bar or a gear couples: their angles are opposite, and the body
    takes the mean of both; none: each swings on its own."""

    def moved_kg(self, name: str, mass_kg: float, places_m: Mapping[str, Vector3]) -> float:
        """Return the mass that a wheel's spring moves, by the wheel's mass and all wheels' places.

        A light arm gives way to the springs of all of its wheels.
        """
        for arm in self.arms:
            if name in arm.wheels:
                levers = sum((places_m[wheel][0] - arm.pivot_m[0]) ** 2 for wheel in arm.wheels)
                return 1 / (1 / mass_kg + levers / arm.inertia_kgm2)
        return mass_kg

    def check(self, wheels: Sequence[str], others: Sequence[str]) -> None:
        """Refuse names that are taken or unknown, and wheels on two arms.

        Raises
        ------
        ValueError
            with the expected value.
        """
        taken = {*wheels, *others}
        carried: set[str] = set()
        known: set[str] = set()
        for arm in self.arms:
            if arm.name in taken:
                raise ValueError(f"`linkage`: two parts are named `{arm.name}`. Fix: rename one")
            if arm.parent is not None and arm.parent not in known:
                raise ValueError(
                    f"`linkage`: `{arm.name}` has the parent `{arm.parent}`; expected an earlier "
                    "arm, or none for the base"
                )
            for wheel in arm.wheels:
                if wheel not in wheels or wheel in carried:
                    free = ", ".join(sorted({*wheels} - carried)) or "none"
                    raise ValueError(
                        f"`linkage`: `{arm.name}` carries `{wheel}`; expected one of {free}"
                    )
                carried.add(wheel)
            taken.add(arm.name)
            known.add(arm.name)
        for arm in self.arms:
            if not arm.wheels and all(other.parent != arm.name for other in self.arms):
                raise ValueError(f"`linkage`: `{arm.name}` carries nothing; expected `wheels`")
        on_base = [arm.name for arm in self.arms if arm.parent is None]
        for name in self.differential or ():
            if name not in on_base or self.differential == (name, name):
                raise ValueError(
                    f"`linkage.differential`: got `{name}`; expected two of {', '.join(on_base)}"
                )


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
