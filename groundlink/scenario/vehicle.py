# SPDX-License-Identifier: Apache-2.0
"""Vehicle model: bodies, wheels on springs, joints and visuals. `running_gear` has the drives.

The model has enough information for a URDF, and nothing specific to a physics engine. The base
frame is at axle height in the middle between the wheels, x forward, y left, z up (REP 103, 105). On
level ground all wheels touch the ground, except those that are mounted higher on purpose, such as
at the ends of a track.
"""

from typing import Annotated

from msgspec import Meta, field

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.fields import Fraction01, NonNegative, Positive, Size3, Spec, Vector3
from groundlink.world.solids import Material, Solid

from .every_sensor import Frame, Mount
from .joints import Joint, JointInterface
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
"""Tolerance of the triangle inequality of moments of inertia. A flat body meets it with equality,
and data sheets round."""

LOADED_M = 0.002
"""Height difference, in meters, below which the lowest points of two wheels both touch level
ground."""


class Chassis(Spec, frozen=True, kw_only=True):
    """The sprung body: a box that collides with walls and ground."""

    mass_kg: Positive
    """Mass of the body without the wheels. It includes links and belts."""

    size_m: Size3
    """Full lengths of the box along x, y, z."""

    center_m: Vector3 = (0.0, 0.0, 0.0)
    """Center of the box in the base frame, which is its center of mass."""

    inertia_kgm2: Size3 | None = None
    """Moments of inertia about the center of mass, along x, y and z; none: those of a uniform box.
    """

    collides: bool = True
    """Whether the box collides. If not, only the vehicle's `collisions` do."""

    friction: NonNegative = 0.4
    """Coulomb friction coefficient; a contact has the product of both surfaces."""

    restitution: Fraction01 = 0.0
    """Coefficient of restitution of collisions."""

    linear_damping_per_s: NonNegative = 0.0
    """Share by which every velocity of all bodies of the vehicle decreases per second."""

    angular_damping_per_s: NonNegative = 0.0
    """Share by which every angular velocity of all bodies of the vehicle decreases per second."""

    drag_area_m2: NonNegative = 0.0
    """Drag coefficient times frontal area; the drag force is proportional to the speed squared."""

    def __post_init__(self) -> None:
        moments = self.inertia_kgm2 or (0.0,)
        if (largest := max(moments)) > ROUNDED * (sum(moments) - largest):
            raise ValueError(
                f"no body has an `inertia_kgm2` of {list(moments)}: expected none above the "
                "sum of the others. Fix: omit it to use the box's"
            )


class VehicleModel(Spec, frozen=True, kw_only=True):
    """Model of a vehicle."""

    name: str
    """Name of the model, also of the URDF that ROS receives."""

    base_frame: Frame = "base_link"
    """tf frame of the base, without the vehicle's `frame_prefix`."""

    chassis: Chassis
    """Sprung body of the vehicle."""

    suspension: Suspension
    """Suspension of all wheels that have none of their own."""

    wheels: Annotated[tuple[Wheel, ...], Meta(min_length=2)]
    """Wheels of the vehicle, road wheels and casters included."""

    drive: Drive
    """Drive of the vehicle. `kind` selects it."""

    battery: Battery | None = None
    """Battery of the motors; none: a supply that never runs empty."""

    joints: tuple[Joint, ...] = ()
    """Joints other than wheel joints, parents before children."""

    mounts: dict[str, Mount] = field(default_factory=dict)
    """Sensor mounts by name."""

    collisions: tuple[Solid, ...] = ()
    """Collision solids of the base link, beside the chassis box, such as a mast."""

    visuals: tuple[Solid, ...] = ()
    """Visual solids of the base link, for sensors and viewers, in the base frame."""

    materials: dict[str, Material] = field(default_factory=dict)
    """Materials of the model. A material of the world with the same name takes precedence."""

    def __post_init__(self) -> None:
        names = [wheel.name for wheel in self.wheels]
        if len(set(names)) < len(names):
            raise ValueError("two `wheels` have the same name. Fix: rename one")
        for wheel in self.wheels:
            spring = wheel.suspension or self.suspension
            # Limits for a wheel in the air: a numerically stable step keeps its oscillation from
            # growing.
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
        check_joints(self.joints, (*names, *(joint.name for joint in self._drive_joints())))

    @property
    def base_height_m(self) -> float:
        """Height of the base frame above level ground, with springs at rest under load."""
        return max(wheel.radius_m - wheel.center_m[2] for wheel in self.wheels)

    def stands_on(self, wheel: Wheel) -> bool:
        """Return whether a wheel touches level ground."""
        return wheel.radius_m - wheel.center_m[2] > self.base_height_m - LOADED_M

    def link_names(self) -> tuple[str, ...]:
        """Return the links in the order of `VehicleState.link_poses`: base, wheels, joints."""
        names = [part.name for parts in (self.wheels, self.joints) for part in parts]
        return (self.base_frame, *(f"{name}_link" for name in names))

    def _drive_joints(self) -> tuple[JointInterface, ...]:
        driven = (shaft.name for shaft in self.drive.shafts(self.wheels) if shaft.driven)
        return (
            *(JointInterface(name, ("velocity", "effort")) for name in driven),
            *(JointInterface(name, ("position",)) for name in self.drive.steering_joints),
        )

    def joint_interfaces(self) -> tuple[JointInterface, ...]:
        """Return the joints that take commands: driven shafts, steering joints, other joints."""
        servos = (JointInterface(joint.name, ("position",)) for joint in self.joints)
        return (*self._drive_joints(), *servos)

    @property
    def counted(self) -> tuple[Shaft, ...]:
        """Shafts that have encoders."""
        return self.drive.counted(self.wheels)

    @property
    def least_radius_m(self) -> float:
        """Smallest turning radius of the base's origin; 0 for a vehicle that turns in place."""
        drive = self.drive
        return drive.least_radius_m(self.wheels) if isinstance(drive, Ackermann) else 0.0

    @property
    def top_speed_mps(self) -> float:
        """Largest speed in a straight line, at the largest speed of the driven shafts."""
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
