# SPDX-License-Identifier: Apache-2.0
"""A vehicle as data: bodies, wheels on springs, what it looks like; its drive is in `drives`.

Rule: enough to write a URDF from and nothing that only one physics engine knows. The base frame is
at axle height in the middle between the wheels, x forward, y left, z up (REP 103, 105). All wheels
of a vehicle that stands on level ground touch it, but those that are held higher on purpose, as at
the ends of a track.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, field

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.fields import Fraction01, NonNegative, Positive, Size3, Spec, Vector3
from groundlink.world.solids import Material, Solid

from .every_sensor import Frame, Mount
from .joints import Joint
from .joints import check as check_joints
from .running_gear import (
    Ackermann,
    Battery,
    Differential,
    Drive,
    Shaft,
    SkidSteer,
    Suspension,
    Tracked,
    Wheel,
)

ROUNDED = 1.01
"""Moments of inertia of flat things add up but for the digits that are left out."""

LOADED_M = 0.002
"""Wheels whose lowest points differ by less stand on level ground together."""


class Chassis(Spec, frozen=True, kw_only=True):
    """The sprung body: a box that meets walls and ground."""

    mass_kg: Positive
    size_m: Size3
    center_m: Vector3 = (0.0, 0.0, 0.0)
    """Of the box, in the base frame: its centre of mass."""

    inertia_kgm2: Size3 | None = None
    """Moments about the centre of mass, along x, y and z; none: those of the uniform box."""

    collides: bool = True
    """Whether the box meets things; otherwise only `collisions` of the vehicle do."""

    friction: NonNegative = 0.4
    restitution: Fraction01 = 0.0
    """Of the speed at which it meets something, the share with which it comes back."""

    linear_damping_per_s: NonNegative = 0.0
    """By which share of itself every velocity falls in a second, of all bodies of the vehicle."""

    angular_damping_per_s: NonNegative = 0.0
    drag_area_m2: NonNegative = 0.0
    """Drag coefficient times frontal area: the air's resistance grows with the speed squared."""

    def __post_init__(self) -> None:
        moments = self.inertia_kgm2 or (0.0,)
        if (largest := max(moments)) > ROUNDED * (sum(moments) - largest):
            raise ValueError(
                f"no body has an `inertia_kgm2` of {list(moments)}: none of the three is above the "
                "sum of the others; leave it out for that of the box"
            )


class VehicleModel(Spec, frozen=True, kw_only=True):
    """A kind of vehicle."""

    name: str
    base_frame: Frame = "base_link"
    chassis: Chassis
    suspension: Suspension
    wheels: Annotated[tuple[Wheel, ...], Meta(min_length=2)]
    drive: Drive
    battery: Battery | None = None
    """None: never empty."""

    joints: tuple[Joint, ...] = ()
    """Others than those of the wheels, parents before their children."""

    mounts: dict[str, Mount] = field(default_factory=dict)
    """Places for sensors, by name."""

    collisions: tuple[Solid, ...] = ()
    """What else of the base link meets things, beside the chassis' box: a mast."""

    visuals: tuple[Solid, ...] = ()
    """What the base link looks like to sensors and people, in the base frame."""

    materials: dict[str, Material] = field(default_factory=dict)
    """What it brings along, for worlds that do not list them: a world's own win."""

    def __post_init__(self) -> None:
        names = [wheel.name for wheel in self.wheels]
        if len(set(names)) < len(names):
            raise ValueError("two `wheels` have one name; give each its own")
        for wheel in self.wheels:
            spring = wheel.suspension or self.suspension
            # Of the wheel in the air, by the rule that keeps its motion from growing.
            if (most := 1.5 * wheel.mass_kg / TICK_SECONDS) < spring.damping_nspm:
                raise ValueError(
                    f"the damper of `{wheel.name}` is too hard for its {wheel.mass_kg:g} kg; "
                    f"expected `damping_nspm` of at most {most:.0f}, or a heavier wheel"
                )
            if (most := wheel.mass_kg / TICK_SECONDS**2) < spring.stiffness_npm:
                raise ValueError(
                    f"the spring of `{wheel.name}` is too stiff for its {wheel.mass_kg:g} kg; "
                    f"expected `stiffness_npm` of at most {most:.0f}, or a heavier wheel"
                )
        self.drive.check(self.wheels)
        check_joints(self.joints, names)

    @property
    def base_height_m(self) -> float:
        """Of the base frame above level ground, with springs at their loaded rest."""
        return max(wheel.radius_m - wheel.center_m[2] for wheel in self.wheels)

    def stands_on(self, wheel: Wheel) -> bool:
        """Return whether a wheel touches level ground."""
        return wheel.radius_m - wheel.center_m[2] > self.base_height_m - LOADED_M

    def link_names(self) -> tuple[str, ...]:
        """Return the links in the order of `VehicleState.link_poses`: base, wheels, joints."""
        names = [part.name for parts in (self.wheels, self.joints) for part in parts]
        return (self.base_frame, *(f"{name}_link" for name in names))

    @property
    def counted(self) -> tuple[Shaft, ...]:
        """Shafts whose turns encoders count."""
        return self.drive.counted(self.wheels)

    @property
    def least_radius_m(self) -> float:
        """Of the narrowest circle of the base's origin; 0 for one that turns on the spot."""
        drive = self.drive
        return drive.least_radius_m(self.wheels) if isinstance(drive, Ackermann) else 0.0

    @property
    def top_speed_mps(self) -> float:
        """The speed straight on at which a driven shaft turns as fast as it may."""
        driven = (shaft for shaft in self.drive.shafts(self.wheels) if shaft.driven)
        return self.drive.max_wheel_speed_radps * min(shaft.radius_m for shaft in driven)


__all__ = [
    "Ackermann",
    "Battery",
    "Chassis",
    "Differential",
    "Joint",
    "Mount",
    "SkidSteer",
    "Suspension",
    "Tracked",
    "VehicleModel",
    "Wheel",
]
