# SPDX-License-Identifier: Apache-2.0
"""Running gear: wheels, suspension and kinds of drives.

Each kind of drive is a class; its tag is the kind. A drive defines which wheels share a shaft and
which shafts have a motor. Physics computes the motion of wheels and ground contact.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, radians, sin, tan
from typing import Annotated, Literal

from msgspec import UNSET, Meta, UnsetType

from groundlink.core.fields import Fraction01, NonNegative, Positive, Spec, Vector3
from groundlink.world.solids import Solid

from .every_sensor import Name

LEFT_TRACK, RIGHT_TRACK = "left_track", "right_track"


class Suspension(Spec, frozen=True):
    """Spring and damper that carry one wheel along the base's z axis."""

    travel_m: Positive = 0.06
    """Travel in each direction from the position at rest under load."""

    stiffness_npm: Positive = 8000.0
    """Spring rate, N/m."""

    damping_nspm: Positive = 500.0
    """Damping rate, N s/m."""


class Rollers(Spec, frozen=True):
    """Rollers along the rim of an omni or Mecanum wheel, which roll freely on the ground."""

    angle_deg: Annotated[float, Meta(ge=-80, le=80)] = 0.0
    """Direction in which the roller at the ground rolls, counterclockwise from the axle (to the
    wheel's left): 0 for an omni wheel, 45 or -45 for a Mecanum wheel."""

    friction_ratio: Annotated[float, Meta(gt=0, le=1)] = 0.02
    """Friction in that direction as a share of the friction across it: bearings of the rollers."""


class Inflation(Spec, frozen=True, kw_only=True):
    """Pressure of a tire, which flattens on soil where that carries it."""

    pressure_pa: Positive
    """Pressure of the air above that of the atmosphere."""

    carcass_pa: NonNegative = 0.0
    """Ground pressure that the stiffness of the carcass adds."""


class Wheel(Spec, frozen=True, kw_only=True):
    """A wheel; its joint is `<name>`, its link `<name>_link`."""

    name: Name
    """Name of the wheel, unique in the vehicle."""

    center_m: Vector3
    """Center of the wheel in the base frame, with springs at rest under load."""

    radius_m: Positive
    """Radius of the unloaded wheel."""

    width_m: Positive
    """Width of the tread."""

    mass_kg: Positive
    """Mass of the wheel."""

    inertia_kgm2: Positive | None = None
    """Moment of inertia about the axle; none: that of a uniform cylinder."""

    friction: NonNegative = 0.8
    """Friction coefficient of the tire; multiplied by that of the ground."""

    axle_friction_ratio: Fraction01 = 1.0
    """Friction along the axle as a share of the friction in rolling direction. Lower values make
    skid turns easier, and let the vehicle slide sideways on a slope."""

    restitution: Fraction01 = 0.0
    """Coefficient of restitution of the wheel's contacts: 0 for no bounce."""

    rolling_resistance: NonNegative = 0.0
    """Rolling resistance force as a share of the load."""

    axle_damping_nmsprad: NonNegative = 0.0
    """Friction torque of the bearing, for each rad/s of the wheel."""

    caster: bool = False
    """A caster is never driven or braked. It is modeled as a sphere that slides in all directions
    with `friction`, like a wheel that swivels freely. A few hundredths represent its rolling
    resistance."""

    suspension: Suspension | None = None
    """Suspension of this wheel; none: the vehicle's. A suspension always exists; for a real wheel
    without a spring it stands for the tire."""

    rollers: Rollers | UnsetType = UNSET
    """Rollers along the rim, for an `omnidirectional` drive; none: a tread."""

    yaw_deg: float | UnsetType = UNSET
    """Direction in which the wheel rolls, counterclockwise from the base's x axis, for an
    `omnidirectional` drive; none: along x."""

    inflation: Inflation | UnsetType = UNSET
    """Inflation of the tire, for soft soil; none: the wheel is rigid there."""

    material: str = "rubber"
    """Material of the default visual: a cylinder of radius and width about the axle, the link's y
    axis."""

    visuals: tuple[Solid, ...] = ()
    """Visual solids in the link's frame, instead of the cylinder."""

    @property
    def yaw_rad(self) -> float:
        """Return the direction in which the wheel rolls, in the base frame."""
        return 0.0 if self.yaw_deg is UNSET else radians(self.yaw_deg)

    @property
    def axle_inertia_kgm2(self) -> float:
        """Return the moment of inertia about the axle."""
        return self.inertia_kgm2 or self.mass_kg * self.radius_m**2 / 2


@dataclass(frozen=True)
class Shaft:
    """Wheels that rotate together: all wheels of a track, or a single wheel."""

    name: str
    """Name of the wheel or of the track, used for its motor, encoder and commands."""

    wheels: tuple[int, ...]
    """Indices of the wheels in the model. All roll at the same speed, whatever their radii."""

    radius_m: float
    """Radius that converts the shaft's speed (rad/s) to the speed of the tread (m/s)."""

    driven: bool = True
    inertia_kgm2: float = 0.0
    """Inertia of the parts that rotate with the shaft, without the wheels."""


class Motor(Spec, frozen=True, kw_only=True):
    """A DC motor with its gear, one for each driven shaft; all figures apply at the shaft.

    At full voltage its torque falls linearly from `stall_torque_nm` at rest to zero at
    `no_load_speed_radps`. Both are proportional to the battery's voltage.
    """

    stall_torque_nm: Positive
    """Torque at rest and full voltage."""

    no_load_speed_radps: Positive
    """Speed without load at full voltage."""

    latency_s: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Delay from the time of a command until the motor acts on it."""


class Battery(Spec, frozen=True, kw_only=True):
    """Battery of the motors. Its voltage falls with its charge and with the current."""

    capacity_ah: Positive
    """Charge of the full battery."""

    full_v: Positive
    """Open-circuit voltage at full charge. The motor's figures apply at this voltage."""

    empty_v: Positive
    """Open-circuit voltage of the empty battery."""

    resistance_ohm: NonNegative = 0.0
    """Internal resistance."""

    idle_power_w: NonNegative = 0.0
    """Constant power of computers and sensors."""

    charge: Fraction01 = 1.0
    """State of charge at the start of the run, as a share of the capacity."""

    def __post_init__(self) -> None:
        if self.empty_v > self.full_v:
            raise ValueError("`empty_v` is above `full_v`; expected less")


class DriveSpec(Spec, frozen=True, tag_field="kind", kw_only=True):
    """Base of all drives: limits of the joints and of the controller."""

    max_wheel_torque_nm: Positive
    """Torque limit of the controller for each driven shaft, when it drives and when it brakes."""

    max_wheel_speed_radps: Positive
    """Speed limit of the controller for each driven shaft."""

    motor: Motor | None = None
    """Motor of each driven shaft; none: an ideal motor that reaches the torque limit at any speed,
    without delay."""

    max_acceleration_mps2: Positive = 3.0
    """Limit of the linear acceleration that the controller applies to the commanded velocity."""

    max_angular_acceleration_radps2: Positive = 6.0
    """Limit of the angular acceleration that the controller applies to the commanded velocity."""

    command_timeout_s: Positive = 0.5
    """Command timeout: sim time after which the vehicle stops if no command is received."""

    def shafts(self, wheels: Sequence[Wheel]) -> tuple[Shaft, ...]:
        """Return every shaft, driven or not; casters have none."""
        return tuple(
            Shaft(wheel.name, (i,), wheel.radius_m, self.drives(i, wheels))
            for i, wheel in enumerate(wheels)
            if not wheel.caster
        )

    def drives(self, index: int, wheels: Sequence[Wheel]) -> bool:
        """Return whether a wheel other than a caster has a motor."""
        return True

    def counted(self, wheels: Sequence[Wheel]) -> tuple[Shaft, ...]:
        """Return the shafts that have encoders, for wheel odometry."""
        return tuple(shaft for shaft in self.shafts(wheels) if shaft.driven)

    @property
    def steering_joints(self) -> tuple[str, ...]:
        """Names of the joints that steer wheels."""
        return ()

    def pivot_x_m(self, wheels: Sequence[Wheel]) -> float:
        """Return the x coordinate of the point without sideways motion in a turn."""
        return 0.0

    def _counted_x_m(self, wheels: Sequence[Wheel]) -> float:
        counted = [wheels[i].center_m[0] for shaft in self.counted(wheels) for i in shaft.wheels]
        return sum(counted) / len(counted)

    def check(self, wheels: Sequence[Wheel]) -> None:
        """Refuse wheels that this drive cannot have.

        Raises
        ------
        ValueError
            with the expected value.
        """
        for wheel in wheels:
            if wheel.rollers is not UNSET or wheel.yaw_deg is not UNSET:
                raise ValueError(
                    f"`{wheel.name}` has `rollers` or `yaw_deg`; expected neither. Fix: "
                    "`drive: {kind: omnidirectional, ...}`"
                )
        sides = {wheels[i].center_m[1] > 0 for shaft in self.counted(wheels) for i in shaft.wheels}
        if len(sides) != 2:
            raise ValueError("`drive` needs driven wheels on both sides (y > 0 and y < 0)")


class SideSteered(DriveSpec, frozen=True, kw_only=True):
    """Base of the drives that turn by a speed difference between left and right."""

    track_multiplier: Positive = 1.0
    """Effective over geometric track width, a factor on the controller's yaw rate term."""


class SkidSteer(SideSteered, frozen=True, tag="skid_steer"):
    """All wheels are driven; the wheels of one side turn at the same speed."""

    def check(self, wheels: Sequence[Wheel]) -> None:
        """Refuse casters."""
        super().check(wheels)
        if caster := next((wheel for wheel in wheels if wheel.caster), None):
            raise ValueError(f"`{caster.name}` is a caster, which only a `differential` drive has")


class Differential(SideSteered, frozen=True, tag="differential"):
    """Two driven wheels; all others are casters."""

    def pivot_x_m(self, wheels: Sequence[Wheel]) -> float:
        """Return the x coordinate of the driven wheels' axle."""
        return self._counted_x_m(wheels)

    def check(self, wheels: Sequence[Wheel]) -> None:
        """Refuse any other number of driven wheels than two."""
        driven = sum(not wheel.caster for wheel in wheels)
        if driven != 2:
            raise ValueError(
                f"a `differential` drive has two driven wheels, not {driven}; "
                "expected `caster: true` for all others"
            )
        super().check(wheels)


class Tracked(SideSteered, frozen=True, tag="tracked"):
    """Two tracks: the road wheels of a side turn together, and one encoder counts each side.

    A track touches the ground where its wheels do. An `axle_friction_ratio` below 1 makes it turn
    as easily as a real track.
    """

    sprocket_radius_m: Positive | None = None
    """Radius of the sprockets, at which the figures of motors and encoders apply; none: the radius
    of the road wheels."""

    belt_mass_kg: NonNegative = 0.0
    """Mass of each belt, for its inertia. The chassis includes its weight."""

    def shafts(self, wheels: Sequence[Wheel]) -> tuple[Shaft, ...]:
        """Return the two tracks."""
        tracks = []
        for name, is_left in ((LEFT_TRACK, True), (RIGHT_TRACK, False)):
            side = tuple(i for i, w in enumerate(wheels) if (w.center_m[1] > 0) is is_left)
            radius = self.sprocket_radius_m or (wheels[side[0]].radius_m if side else 1.0)
            tracks.append(Shaft(name, side, radius, True, self.belt_mass_kg * radius**2))
        return tuple(tracks)

    def check(self, wheels: Sequence[Wheel]) -> None:
        """Refuse casters and fewer than two wheels on a side."""
        if any(wheel.caster for wheel in wheels):
            raise ValueError("a `tracked` drive has no casters")
        if any(wheel.inflation for wheel in wheels):
            raise ValueError("a `tracked` drive has no `inflation`: links press the soil")
        if min(len(track.wheels) for track in self.shafts(wheels)) < 2:
            raise ValueError("a `tracked` drive needs two road wheels or more on each side")


class Ackermann(DriveSpec, frozen=True, tag="ackermann", kw_only=True):
    """Car-like steering: the axles of the front wheels meet on the line of the rear axle.

    Encoders are on the wheels that are not steered.
    """

    steered: tuple[str, str]
    """Names of the steered wheels."""

    driven: Literal["rear", "front", "all"] = "rear"
    """Driven wheels. The steered wheels are the front ones."""

    max_steering_deg: Annotated[float, Meta(gt=0, lt=80)] = 30.0
    """Largest steering angle in each direction: the range of each steered wheel's joint."""

    steering_speed_degps: Positive = 120.0
    """Largest speed of the steering joint."""

    steering_torque_nm: Positive = 200.0
    """Largest torque that turns or holds each steered wheel."""

    def drives(self, index: int, wheels: Sequence[Wheel]) -> bool:
        """Return whether a wheel has a motor; the steered wheels are the front ones."""
        return self.driven == "all" or (wheels[index].name in self.steered) == (
            self.driven == "front"
        )

    def counted(self, wheels: Sequence[Wheel]) -> tuple[Shaft, ...]:
        """Return the wheels that are not steered."""
        return tuple(s for s in self.shafts(wheels) if s.name not in self.steered)

    def pivot_x_m(self, wheels: Sequence[Wheel]) -> float:
        """Return the x coordinate of the axle that is not steered."""
        return self._counted_x_m(wheels)

    @property
    def steering_joints(self) -> tuple[str, ...]:
        """Names of the joints that steer wheels, in the order of `steered`."""
        return tuple(f"{name}_steering" for name in self.steered)

    def least_radius_m(self, wheels: Sequence[Wheel]) -> float:
        """Return the turning radius with the inner wheel at its largest steering angle."""
        pivot_x_m, slope = self.pivot_x_m(wheels), tan(radians(self.max_steering_deg))
        centers = [wheel.center_m for wheel in wheels if wheel.name in self.steered]
        return max((x - pivot_x_m) / slope + abs(y) for x, y, _ in centers)

    def check(self, wheels: Sequence[Wheel]) -> None:
        """Refuse steered wheels that are not in front of the others."""
        names = [wheel.name for wheel in wheels]
        for name in self.steered:
            if name not in names:
                raise ValueError(f"`steered`: no wheel `{name}`; expected two of {names}")
        super().check(wheels)
        pivot_x_m = self.pivot_x_m(wheels)
        for wheel in wheels:
            if wheel.name in self.steered and wheel.center_m[0] <= pivot_x_m:
                raise ValueError(
                    f"`{wheel.name}` is steered, but is not in front of the other wheels"
                )


class Omnidirectional(DriveSpec, frozen=True, tag="omnidirectional", kw_only=True):
    """Wheels with rollers, all driven, that move the base in all directions.

    They are Mecanum wheels in pairs, or omni wheels around the base. Casters may help to carry it.
    """

    def rows(self, wheels: Sequence[Wheel]) -> tuple[tuple[float, float, float], ...]:
        """Return the speed of each driven wheel, rad/s, for 1 m/s along x, 1 m/s along y, 1 rad/s.

        A wheel grips the ground across the direction in which its rollers roll. Source: Lynch and
        Park, Modern Robotics (2017), section 13.2.
        """
        rows = []
        for wheel in wheels:
            if wheel.rollers is UNSET:
                continue
            rollers = radians(wheel.rollers.angle_deg)
            grips = wheel.yaw_rad + rollers
            along, aside = cos(grips), sin(grips)
            x, y, _ = wheel.center_m
            share = wheel.radius_m * cos(rollers)
            rows.append((along / share, aside / share, (aside * x - along * y) / share))
        return tuple(rows)

    def check(self, wheels: Sequence[Wheel]) -> None:
        """Refuse wheels that do not move the base along x, along y and about z."""
        for wheel in wheels:
            if wheel.caster is (wheel.rollers is not UNSET):
                raise ValueError(
                    f"`{wheel.name}` of an `omnidirectional` drive: expected either `rollers` or "
                    "`caster: true`"
                )
        if LEAST_HOLD > _hold(self.rows(wheels)):
            raise ValueError(
                "the `rollers` leave the base free to move; expected wheels that drive it along "
                "x, along y and about z. Fix: for Mecanum wheels, `angle_deg` of -45 at front left "
                "and rear right, 45 at the others"
            )


class Towed(DriveSpec, frozen=True, tag="towed", kw_only=True):
    """No motor: all wheels roll freely, as those of a trailer do. Encoders may be on any."""

    max_wheel_torque_nm: Positive = 1.0
    """Without effect."""

    max_wheel_speed_radps: Positive = 200.0
    """Largest speed that encoders count."""

    def drives(self, index: int, wheels: Sequence[Wheel]) -> bool:
        """Return that no wheel has a motor."""
        return False

    def counted(self, wheels: Sequence[Wheel]) -> tuple[Shaft, ...]:
        """Return all wheels but casters."""
        return self.shafts(wheels)

    def pivot_x_m(self, wheels: Sequence[Wheel]) -> float:
        """Return the x coordinate of the mean axle."""
        return self._counted_x_m(wheels)


Drive = SkidSteer | Differential | Tracked | Ackermann | Omnidirectional | Towed

LEAST_HOLD = 1e-3
"""Determinant, relative to that of wheels that hold a base alike in all directions, below which
it is free."""


def _hold(rows: Sequence[tuple[float, float, float]]) -> float:
    """Return the determinant of the wheels' normal equations over the product of its diagonal."""
    (a, b, c), (_, d, e), (_, _, f) = [
        [sum(row[i] * row[k] for row in rows) for k in range(3)] for i in range(3)
    ]
    whole = a * d * f
    return (a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)) / (whole or 1.0)
