# SPDX-License-Identifier: Apache-2.0
"""Running gear: wheels, suspension, and the kinds of drives.

One class a kind of drive; its tag is the kind. A drive says which wheels share a shaft and which
shafts have a motor. Physics computes how wheels and ground move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians, tan
from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import Fraction01, NonNegative, Positive, Spec, Vector3
from groundlink.world.solids import Solid

from .every_sensor import Name

LEFT_TRACK, RIGHT_TRACK = "left_track", "right_track"


class Suspension(Spec, frozen=True):
    """A spring and damper that carries one wheel along the base's z."""

    travel_m: Positive = 0.06
    """To each side of the loaded rest."""

    stiffness_npm: Positive = 8000.0
    damping_nspm: Positive = 500.0


class Wheel(Spec, frozen=True, kw_only=True):
    """One wheel; its joint is `<name>`, its link `<name>_link`."""

    name: Name
    center_m: Vector3
    """In the base frame, springs at their loaded rest."""

    radius_m: Positive
    width_m: Positive
    mass_kg: Positive
    inertia_kgm2: Positive | None = None
    """About its axle; none: that of the uniform cylinder."""

    friction: NonNegative = 0.8
    axle_friction_ratio: Fraction01 = 1.0
    """Friction along the axle as a share of that in rolling direction: less skids round easier,
    and sideways down a slope."""

    restitution: Fraction01 = 0.0
    rolling_resistance: NonNegative = 0.0
    """Force against rolling as a share of the load."""

    axle_damping_nmsprad: NonNegative = 0.0
    """Torque of the bearing against the turning wheel, for each rad/s."""

    caster: bool = False
    """Never driven or braked: a ball that slides in every direction, by `friction`, as a wheel does
    that swivels freely. A few hundredths stand for its rolling resistance."""

    suspension: Suspension | None = None
    """None: the vehicle's. There is always one: where the real wheel has no spring, its tire."""

    material: str = "rubber"
    """What it looks like: a cylinder of radius and width about its axle, the link's y."""

    visuals: tuple[Solid, ...] = ()
    """What it looks like if not that, in its link's frame."""

    @property
    def axle_inertia_kgm2(self) -> float:
        """Moment of inertia about the axle."""
        return self.inertia_kgm2 or self.mass_kg * self.radius_m**2 / 2


@dataclass(frozen=True)
class Shaft:
    """Wheels that turn together: those of a track, or one wheel alone."""

    name: str
    """Of the wheel, or of the track: what its motor, its counter and its commands are called."""

    wheels: tuple[int, ...]
    """By their place in the model. They roll equally fast, whatever their radii."""

    radius_m: float
    """By which the shaft's speed (rad/s) becomes that of the tread (m/s)."""

    driven: bool = True
    inertia_kgm2: float = 0.0
    """Of what turns with it beside the wheels."""


class Motor(Spec, frozen=True, kw_only=True):
    """A direct current motor with its gear, one for each driven shaft, seen from the shaft.

    At full voltage its torque falls in a line from `stall_torque_nm` at rest to nothing at
    `no_load_speed_radps`; both fall with the battery's voltage.
    """

    stall_torque_nm: Positive
    no_load_speed_radps: Positive
    latency_s: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """From a command's instant to that at which the motor begins to act on it."""


class Battery(Spec, frozen=True, kw_only=True):
    """What feeds the motors: its voltage falls with its charge and with the current."""

    capacity_ah: Positive
    full_v: Positive
    """With no current, at full charge; the motor's figures are at this voltage."""

    empty_v: Positive
    resistance_ohm: NonNegative = 0.0
    idle_power_w: NonNegative = 0.0
    """What computers and sensors draw all the time."""

    charge: Fraction01 = 1.0
    """At the start of the run, of its capacity."""

    def __post_init__(self) -> None:
        if self.empty_v > self.full_v:
            raise ValueError("`empty_v` is above `full_v`; expected less")


class DriveSpec(Spec, frozen=True, tag_field="kind", kw_only=True):
    """What every drive has: limits of its joints and of its controller."""

    max_wheel_torque_nm: Positive
    """Of each driven shaft, also when it brakes: what the controller lets the motor do."""

    max_wheel_speed_radps: Positive
    motor: Motor | None = None
    """None: one that has all of the above at any speed, at once."""

    max_acceleration_mps2: Positive = 3.0
    max_angular_acceleration_radps2: Positive = 6.0
    """How fast the controller lets the commanded velocity change."""

    command_timeout_s: Positive = 0.5
    """Sim time after which an unrepeated command no longer moves the vehicle."""

    def shafts(self, wheels: Sequence[Wheel]) -> tuple[Shaft, ...]:
        """Return every shaft, driven or not; casters have none."""
        return tuple(
            Shaft(wheel.name, (i,), wheel.radius_m, self.drives(i, wheels))
            for i, wheel in enumerate(wheels)
            if not wheel.caster
        )

    def drives(self, index: int, wheels: Sequence[Wheel]) -> bool:
        """Return whether a wheel that is no caster has a motor."""
        return True

    def counted(self, wheels: Sequence[Wheel]) -> tuple[Shaft, ...]:
        """Return the shafts that have encoders: by these a vehicle knows where it has come to."""
        return tuple(shaft for shaft in self.shafts(wheels) if shaft.driven)

    def pivot_x_m(self, wheels: Sequence[Wheel]) -> float:
        """Return where along x the point is that does not move sideways in a turn."""
        return 0.0

    def _counted_x_m(self, wheels: Sequence[Wheel]) -> float:
        counted = [wheels[i].center_m[0] for shaft in self.counted(wheels) for i in shaft.wheels]
        return sum(counted) / len(counted)

    def check(self, wheels: Sequence[Wheel]) -> None:
        """Refuse wheels that this drive cannot have.

        Raises
        ------
        ValueError
            with what was expected.
        """
        sides = {wheels[i].center_m[1] > 0 for shaft in self.counted(wheels) for i in shaft.wheels}
        if len(sides) != 2:
            raise ValueError("`drive` needs driven wheels on both sides (y > 0 and y < 0)")


class SideSteered(DriveSpec, frozen=True, kw_only=True):
    """The difference between the sides turns the vehicle."""

    track_multiplier: Positive = 1.0
    """Effective over geometric track: what the controller multiplies the yaw rate's share by."""


class SkidSteer(SideSteered, frozen=True, tag="skid_steer"):
    """All wheels are driven; those of one side turn alike."""

    def check(self, wheels: Sequence[Wheel]) -> None:
        """Refuse casters."""
        super().check(wheels)
        if caster := next((wheel for wheel in wheels if wheel.caster), None):
            raise ValueError(f"`{caster.name}` is a caster; with them the drive is `differential`")


class Differential(SideSteered, frozen=True, tag="differential"):
    """Two driven wheels; all others are casters."""

    def pivot_x_m(self, wheels: Sequence[Wheel]) -> float:
        """Return where the driven wheels' axle is."""
        return self._counted_x_m(wheels)

    def check(self, wheels: Sequence[Wheel]) -> None:
        """Refuse other numbers."""
        driven = sum(not wheel.caster for wheel in wheels)
        if driven != 2:
            raise ValueError(
                f"a `differential` drive has two driven wheels, not {driven}; "
                "expected `caster: true` for all others"
            )
        super().check(wheels)


class Tracked(SideSteered, frozen=True, tag="tracked"):
    """Two tracks: the road wheels of a side turn together, and one encoder counts each side.

    A track touches the ground where its wheels do; give them an `axle_friction_ratio` below 1 to
    skid round as easily as the real one.
    """

    sprocket_radius_m: Positive | None = None
    """Motors' and encoders' figures are those of sprockets of this radius; none: of the road
    wheels."""

    belt_mass_kg: NonNegative = 0.0
    """Of each track, for its inertia; its weight belongs to the chassis."""

    def shafts(self, wheels: Sequence[Wheel]) -> tuple[Shaft, ...]:
        """Return the two tracks."""
        tracks = []
        for name, is_left in ((LEFT_TRACK, True), (RIGHT_TRACK, False)):
            side = tuple(i for i, w in enumerate(wheels) if (w.center_m[1] > 0) is is_left)
            radius = self.sprocket_radius_m or (wheels[side[0]].radius_m if side else 1.0)
            tracks.append(Shaft(name, side, radius, True, self.belt_mass_kg * radius**2))
        return tuple(tracks)

    def check(self, wheels: Sequence[Wheel]) -> None:
        """Refuse casters and fewer than two wheels a side."""
        if any(wheel.caster for wheel in wheels):
            raise ValueError("a `tracked` drive has no casters")
        if min(len(track.wheels) for track in self.shafts(wheels)) < 2:
            raise ValueError("a `tracked` drive needs two road wheels or more on each side")


class Ackermann(DriveSpec, frozen=True, tag="ackermann", kw_only=True):
    """Steered like a car: the front wheels' axles meet on the line of the rear ones.

    Encoders are on the wheels that are not steered.
    """

    steered: tuple[str, str]
    """Names of the steered wheels."""

    driven: Literal["rear", "front", "all"] = "rear"
    max_steering_deg: Annotated[float, Meta(gt=0, lt=80)] = 30.0
    """To each side: the range of each steered wheel's joint."""

    steering_speed_degps: Positive = 120.0
    """How fast the joint turns at most."""

    steering_torque_nm: Positive = 200.0
    """With which it turns or holds each wheel at most."""

    def drives(self, index: int, wheels: Sequence[Wheel]) -> bool:
        """Return whether a wheel has a motor; the steered ones are the front's."""
        return self.driven == "all" or (wheels[index].name in self.steered) == (
            self.driven == "front"
        )

    def counted(self, wheels: Sequence[Wheel]) -> tuple[Shaft, ...]:
        """Return the wheels that are not steered."""
        return tuple(s for s in self.shafts(wheels) if s.name not in self.steered)

    def pivot_x_m(self, wheels: Sequence[Wheel]) -> float:
        """Return where the axle is that is not steered."""
        return self._counted_x_m(wheels)

    def least_radius_m(self, wheels: Sequence[Wheel]) -> float:
        """Return the radius of the circle on which the inner wheel is steered as far as it goes."""
        pivot_x_m, slope = self.pivot_x_m(wheels), tan(radians(self.max_steering_deg))
        centers = [wheel.center_m for wheel in wheels if wheel.name in self.steered]
        return max((x - pivot_x_m) / slope + abs(y) for x, y, _ in centers)

    def check(self, wheels: Sequence[Wheel]) -> None:
        """Refuse steered wheels that do not stand before the others."""
        names = [wheel.name for wheel in wheels]
        for name in self.steered:
            if name not in names:
                raise ValueError(f"`steered`: no wheel `{name}`; expected two of {names}")
        super().check(wheels)
        pivot_x_m = self.pivot_x_m(wheels)
        for wheel in wheels:
            if wheel.name in self.steered and wheel.center_m[0] <= pivot_x_m:
                raise ValueError(f"`{wheel.name}` is steered, but does not stand before the others")


Drive = SkidSteer | Differential | Tracked | Ackermann
