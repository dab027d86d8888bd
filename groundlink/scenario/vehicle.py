# SPDX-License-Identifier: Apache-2.0
"""A vehicle as data: bodies, wheels on springs, how it is driven, what it looks like.

Rule: enough to write a URDF from and nothing that only one physics engine knows. The base frame is
at axle height in the middle between the wheels, x forward, y left, z up (REP 103, 105).
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, field

from groundlink.world.solids import Fraction01, NonNegative, Positive, Size3, Solid, Spec, Vector3

from .sensors import Mount


class Chassis(Spec, frozen=True):
    """The sprung body: a uniform box that meets walls and ground."""

    mass_kg: Positive
    size_m: Size3
    center_m: Vector3 = (0.0, 0.0, 0.0)
    """Of the box, in the base frame."""

    friction: NonNegative = 0.4
    restitution: Fraction01 = 0.0


class Suspension(Spec, frozen=True):
    """A spring and damper that carries one wheel along the base's z."""

    travel_m: Positive = 0.06
    """To each side of the loaded rest."""

    stiffness_npm: Positive = 8000.0
    damping_nspm: Positive = 500.0


class Wheel(Spec, frozen=True):
    """One driven wheel; its joint is `<name>`, its link `<name>_link`."""

    name: Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]*$")]
    center_m: Vector3
    """In the base frame, springs at their loaded rest."""

    radius_m: Positive
    width_m: Positive
    mass_kg: Positive
    friction: NonNegative = 0.8
    axle_friction_ratio: Fraction01 = 1.0
    """Friction along the axle as a share of that in rolling direction: less skids round easier."""

    material: str = "rubber"
    """What it looks like; a cylinder of radius and width about its axle, the link's y."""


class SkidSteer(Spec, frozen=True, tag_field="kind", tag="skid_steer"):
    """Wheels of one side turn alike; the difference between the sides turns the vehicle."""

    max_wheel_torque_nm: Positive
    max_wheel_speed_radps: Positive
    track_multiplier: Positive = 1.0
    """Effective over geometric track: what the controller multiplies the yaw rate's share by."""

    max_acceleration_mps2: Positive = 3.0
    max_angular_acceleration_radps2: Positive = 6.0
    """How fast the controller lets the commanded velocity change."""

    command_timeout_s: Positive = 0.5
    """Sim time after which an unrepeated command no longer moves the vehicle."""


class VehicleModel(Spec, frozen=True, kw_only=True):
    """A kind of vehicle."""

    name: str
    base_frame: str = "base_link"
    chassis: Chassis
    suspension: Suspension
    wheels: tuple[Wheel, ...]
    drive: SkidSteer
    mounts: dict[str, Mount] = field(default_factory=dict)
    """Places for sensors, by name."""

    collisions: tuple[Solid, ...] = ()
    """What else of the base link meets things, beside the chassis' box: a mast."""

    visuals: tuple[Solid, ...] = ()
    """What the base link looks like to sensors and people, in the base frame."""

    @property
    def base_height_m(self) -> float:
        """Of the base frame above level ground, with springs at their loaded rest."""
        return max(wheel.radius_m - wheel.center_m[2] for wheel in self.wheels)

    def link_names(self) -> tuple[str, ...]:
        """Return the links in the order of `VehicleState.link_poses`: base, then wheels."""
        return (self.base_frame, *(f"{wheel.name}_link" for wheel in self.wheels))
