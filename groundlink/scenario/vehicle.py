# SPDX-License-Identifier: Apache-2.0
"""Vehicle model: bodies, wheels on springs, joints and visuals. `running_gear` has the drives.

The model has enough information for a URDF, and nothing specific to a physics engine. The base
frame is at axle height in the middle between the wheels, x forward, y left, z up (REP 103, 105). On
level ground all wheels touch the ground, except those that are mounted higher on purpose, such as
at the ends of a track.
"""

from collections.abc import Collection
from math import cos, radians, sin
from typing import Annotated, Literal, Self, get_args

from msgspec import UNSET, Meta, UnsetType, field
from msgspec.structs import replace

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.fields import Fraction01, NonNegative, Positive, Size3, Spec, Vector3
from groundlink.world.solids import Material, Solid

from .every_sensor import Frame, Mount, Name
from .joints import Arm, Joint, JointInterface, Linkage
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


Effect = Literal["vibration", "tire_slip", "bumper"]
"""Fields of a model that act only where a vehicle's `effects` name them."""

EFFECTS: tuple[Effect, ...] = get_args(Effect)

MAX_SHAKE_HZ = 150.0
"""Highest frequency of a vibration: ticks of 400 Hz do not carry much more."""


class Tread(Spec, frozen=True, kw_only=True):
    """Links of tracks, or lugs of tires: the wheels rise and fall as they roll over them."""

    pitch_m: Positive
    """Distance from one link or lug to the next."""

    rise_m: Positive
    """Height by which a wheel rises and falls, peak to peak."""


class EngineOrder(Spec, frozen=True, kw_only=True):
    """A vibration that repeats a number of times in each revolution of the engine."""

    order: Positive
    """Periods per revolution: half the number of cylinders for the firing of a four-stroke engine.
    """

    acceleration_mps2: NonNegative
    """Amplitude of the hull's vertical acceleration at the highest speed of the engine. At lower
    speeds it falls with the square of the speed, as forces of inertia do."""


class Engine(Spec, frozen=True, kw_only=True):
    """Combustion engine that shakes the hull. Its speed rises with the vehicle's."""

    idle_rpm: Positive
    """Speed at standstill."""

    max_rpm: Positive
    """Speed at the vehicle's top speed."""

    orders: Annotated[tuple[EngineOrder, ...], Meta(min_length=1)]
    """Orders of the vibration. An order is left out while its frequency is above 150 Hz."""

    def __post_init__(self) -> None:
        if self.max_rpm < self.idle_rpm:
            raise ValueError("`max_rpm` is below `idle_rpm`; expected more")


class Vibration(Spec, frozen=True, kw_only=True):
    """Vibration of a moving vehicle. It acts on the body, so all of its sensors feel the same."""

    tread: Tread | None = None
    """Links or lugs under all wheels; none: smooth treads."""

    engine: Engine | None = None
    """Combustion engine; none: electric motors."""


class TireSlip(Spec, frozen=True, kw_only=True):
    """Slip of rolling tires below the limit of friction, alike for all wheels.

    Without it a tire that rolls below its limit slips neither forward nor sideways.
    """

    cornering_stiffness_nprad: Positive
    """Largest cornering stiffness of one tire over all loads: lateral force by slip angle, at small
    angles. The force by longitudinal slip rises alike."""

    load_n: Positive
    """Load at which a tire has this stiffness. At other loads N it has the share
    sin(2 atan(N / load_n))."""


class Bumper(Spec, frozen=True, kw_only=True):
    """Elasticity of the chassis in contacts, so that a collision lasts.

    Without it a collision ends within a few ticks. A vehicle of mass m that meets a wall is slowed
    for pi sqrt(m / stiffness), if nothing damps it.
    """

    stiffness_npm: Positive
    """Force by depth, over all points of contact together. The chassis enters what it hits by this
    depth."""

    damping_nspm: NonNegative = 0.0
    """Force by speed of entry, likewise."""


class Payload(Spec, frozen=True, kw_only=True):
    """A load that is fixed to the body. It neither collides nor is seen."""

    mass_kg: Positive
    """Mass of the load."""

    at_m: Vector3
    """Center of mass of the load in the base frame."""

    size_m: Size3 | None = None
    """Full lengths of the load along x, y, z, a uniform box; none: a point."""


class Wading(Spec, frozen=True, kw_only=True):
    """How a vehicle takes standing water."""

    depth_m: Positive | None = None
    """Depth of water at the deepest wheel beyond which the motors stop for good; none: they run
    at any depth."""

    displaced_m3: NonNegative | None = None
    """Water that the body displaces when it is under water; none: the volume of its box. A body
    that fills with water displaces little."""


class Towing(Spec, frozen=True, kw_only=True):
    """Hitch by which another vehicle tows this one: a ball that turns freely in its coupling."""

    vehicle: Name
    """Name of the towing vehicle, which is listed earlier."""

    hitch_m: Vector3
    """Center of the ball in the base frame of the towing vehicle."""

    coupling_m: Vector3
    """Place of the coupling in this vehicle's base frame."""

    angle_deg: float = 0.0
    """Heading from that of the towing vehicle at the start, counterclockwise."""

    def behind(self, x_m: float, y_m: float, yaw_deg: float) -> tuple[float, float, float]:
        """Return x, y (m) and heading (deg) of this vehicle's start, by those of the other."""
        turned_deg = yaw_deg + self.angle_deg
        for at, turn_deg, sign in ((self.hitch_m, yaw_deg, 1), (self.coupling_m, turned_deg, -1)):
            c, s = cos(radians(turn_deg)), sin(radians(turn_deg))
            x_m += sign * (c * at[0] - s * at[1])
            y_m += sign * (s * at[0] + c * at[1])
        return x_m, y_m, turned_deg


HITCH_APART_M = 0.05
"""Largest difference of heights above level ground between hitch and coupling."""


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

    linkage: Linkage | UnsetType = UNSET
    """Arms between body and wheels; none: all wheels are on the body."""

    mounts: dict[str, Mount] = field(default_factory=dict)
    """Sensor mounts by name."""

    collisions: tuple[Solid, ...] = ()
    """Collision solids of the base link, beside the chassis box, such as a mast."""

    visuals: tuple[Solid, ...] = ()
    """Visual solids of the base link, for sensors and viewers, in the base frame."""

    materials: dict[str, Material] = field(default_factory=dict)
    """Materials of the model. A material of the world with the same name takes precedence."""

    vibration: Vibration | None = None
    """Vibration by tracks, lugs and engine, where `effects` of the vehicle has it."""

    tire_slip: TireSlip | None = None
    """Slip of rolling tires, where `effects` of the vehicle has it."""

    bumper: Bumper | None = None
    """Elasticity of the chassis in contacts, where `effects` of the vehicle has it."""

    wading: Wading | UnsetType = UNSET
    """Wading through standing water; none: the body is tight, and the motors run at any depth."""

    def __post_init__(self) -> None:
        names = [wheel.name for wheel in self.wheels]
        if len(set(names)) < len(names):
            raise ValueError("two `wheels` have the same name. Fix: rename one")
        if self.linkage:
            if isinstance(self.drive, Tracked):
                raise ValueError("`linkage`: a `tracked` drive has none; expected another drive")
            others = [joint.name for joint in self._drive_joints()]
            self.linkage.check(names, [*others, *(joint.name for joint in self.joints)])
        places = {wheel.name: wheel.center_m for wheel in self.wheels}
        for wheel in self.wheels:
            spring, mass_kg, part = wheel.suspension or self.suspension, wheel.mass_kg, "wheel"
            if self.linkage:
                mass_kg = self.linkage.moved_kg(wheel.name, mass_kg, places)
                part = "wheel and arm"
            # Limits for a wheel in the air: a numerically stable step keeps its oscillation from
            # growing.
            if (most := 1.5 * mass_kg / TICK_SECONDS) < spring.damping_nspm:
                raise ValueError(
                    f"the damper of `{wheel.name}` is too hard for its {mass_kg:.4g} kg; "
                    f"expected `damping_nspm` of at most {most:.0f}, or a heavier {part}"
                )
            if (most := mass_kg / TICK_SECONDS**2) < spring.stiffness_npm:
                raise ValueError(
                    f"the spring of `{wheel.name}` is too stiff for its {mass_kg:.4g} kg; "
                    f"expected `stiffness_npm` of at most {most:.0f}, or a heavier {part}"
                )
        self.drive.check(self.wheels)
        check_joints(self.joints, (*names, *(joint.name for joint in self._drive_joints())))
        for name, mount in self.mounts.items():
            try:
                self.link_of(mount)
            except ValueError as error:
                raise ValueError(f"`mounts.{name}.joint`: {error}") from None

    def with_effects(self, effects: Collection[Effect]) -> Self:
        """Return the model with these effects alone.

        Raises
        ------
        ValueError
            when the model has no figures of an effect, or figures that ticks do not carry.
        """
        for effect in effects:
            if getattr(self, effect) is None:
                raise ValueError(f"`effects`: model `{self.name}` has no `{effect}`")
        acting = replace(self, **{name: None for name in EFFECTS if name not in effects})
        if acting.vibration and (tread := acting.vibration.tread):
            if (least := self.top_speed_mps / MAX_SHAKE_HZ) > tread.pitch_m:
                raise ValueError(
                    f"`vibration.tread` shakes faster than {MAX_SHAKE_HZ:g} Hz at top speed; "
                    f"expected a `pitch_m` of at least {least:.3f}"
                )
        return acting

    @property
    def arms(self) -> tuple[Arm, ...]:
        """Arms that carry wheels."""
        return self.linkage.arms if self.linkage else ()

    @property
    def moving_names(self) -> tuple[str, ...]:
        """Names of the joints in `VehicleState.servo_positions`: joints, then arms."""
        return (*(joint.name for joint in self.joints), *(arm.name for arm in self.arms))

    @property
    def base_height_m(self) -> float:
        """Height of the base frame above level ground, with springs at rest under load."""
        return max(wheel.radius_m - wheel.center_m[2] for wheel in self.wheels)

    def stands_on(self, wheel: Wheel) -> bool:
        """Return whether a wheel touches level ground."""
        return wheel.radius_m - wheel.center_m[2] > self.base_height_m - LOADED_M

    def link_of(self, mount: Mount) -> int:
        """Return the place in `link_names` of the link that carries a mount.

        Raises
        ------
        ValueError
            when the vehicle has no such joint.
        """
        if mount.joint is UNSET:
            return 0
        names = self.moving_names
        if mount.joint not in names:
            known = ", ".join(names) or "none: omit it for the base"
            raise ValueError(f"no joint `{mount.joint}` carries a mount; expected one of {known}")
        return 1 + len(self.wheels) + names.index(mount.joint)

    def link_names(self) -> tuple[str, ...]:
        """Return the links in the order of `VehicleState.link_poses`.

        Base, wheels, joints, arms.
        """
        names = (*(wheel.name for wheel in self.wheels), *self.moving_names)
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
        shafts = self.drive.shafts(self.wheels)
        driven = [shaft for shaft in shafts if shaft.driven] or shafts
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
