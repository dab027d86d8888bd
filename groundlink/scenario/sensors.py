# SPDX-License-Identifier: Apache-2.0
"""What each kind of sensor can be told, with the defaults of an ideal one.

Rule: one class a kind; the tag is the kind, and the kind is the name of the process's folder in
`services/sensors`. A data sheet is a file of these fields; the scenario's own fields win over it.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from groundlink.clock import exact
from groundlink.world.solids import Fraction01, NonNegative, Positive, Spec, Vector3

from .inertial import GyroscopeNoise, InertialNoise

Rate = Annotated[float, Meta(gt=0, le=400)]
RosTopic = Annotated[str, Meta(pattern=r"^/[A-Za-z0-9_/]+$")]


class Mount(Spec, frozen=True):
    """Where a sensor sits: base_from_sensor."""

    xyz_m: Vector3 = (0.0, 0.0, 0.0)
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw about the base's fixed axes (REP 103)."""

    def rpy_radians(self) -> Vector3:
        """Return roll, pitch and yaw in radians."""
        roll, pitch, yaw = map(math.radians, self.rpy_deg)
        return roll, pitch, yaw


class RepairBy(Spec, frozen=True):
    """One way of making lost datagrams good, with its figure."""

    fec: Annotated[float, Meta(gt=0, le=1)] | None = None
    """Repair data for each message, as a share of it; needs the package raptorq at both ends."""

    resend: Annotated[float, Meta(ge=0.001, le=60)] | None = None
    """Lost parts are asked for and sent again until the message is this old, in seconds."""

    def __post_init__(self) -> None:
        if (self.fec is None) == (self.resend is None):
            raise ValueError("expected `fec: share` or `resend: seconds`, one of the two")


Repair = Literal["none", "resend"] | RepairBy
"""How the gateway makes good what is lost of a stream; `resend` alone is half a second."""


class SensorSpec(Spec, frozen=True, tag_field="kind"):
    """What every sensor has."""

    name: Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]*$")]
    topic: RosTopic
    """ROS topic of its readings."""

    frame: str
    """tf frame of its readings, before the vehicle's `frame_prefix`."""

    mount: Mount = Mount()
    push: bool = True
    """Send to the gateway's peer unasked; if not, only to those who subscribe."""

    repair: Repair = "none"
    mounted: ClassVar[bool] = True
    """Whether `frame` is a place on the vehicle, for the static transforms."""

    datasheet: str = ""
    """Title of the data sheet that the fields were taken from, with its source."""


class Lidar(SensorSpec, frozen=True, tag="lidar", kw_only=True):
    """A spinning 3D LiDAR that fires all its lasers once per azimuth step."""

    rotation_rate_hz: Rate = 10.0
    firings_per_revolution: Annotated[int, Meta(ge=16, le=36000)] = 3600
    """Azimuth steps; 3600 at 10 Hz is 0.1 degrees."""

    block_deg: NonNegative = 0.0
    """Azimuth that one message holds: 0 for whole revolutions, or a whole part of 360."""

    elevations_deg: tuple[float, ...]
    """One a laser, from the lowest (ring 0) to the highest."""

    vertical_offsets_m: tuple[float, ...] = ()
    """Of each laser's origin above the sensor's; none means zero."""

    laser_times_us: tuple[float, ...] = ()
    """Of each laser after the start of its firing; none means all at once."""

    min_range_m: NonNegative = 0.0
    max_range_m: Positive = 100.0
    range_stddev_m: NonNegative = 0.0
    """White noise of one measurement, 1 sigma."""

    laser_bias_m: NonNegative = 0.0
    """Half width of the uniform distribution of each laser's constant error."""

    range_resolution_m: NonNegative = 0.0
    """Ranges are rounded to multiples of it; 0 for none."""

    dropout: Fraction01 = 0.0
    """Share of returns that are lost at random."""

    def __post_init__(self) -> None:
        if not self.block_deg:
            return
        blocks = 360 / exact(self.block_deg)
        if blocks.denominator != 1 or not 1 <= blocks <= self.firings_per_revolution:
            raise ValueError(
                f"`block_deg` is {self.block_deg:g}; expected 0 or 360 divided by a whole number "
                f"up to the {self.firings_per_revolution} firings of a revolution"
            )

    @property
    def blocks_per_revolution(self) -> int:
        """How many messages a revolution is sent in."""
        return int(360 / exact(self.block_deg)) if self.block_deg else 1


class Imu(SensorSpec, frozen=True, tag="imu"):
    """Accelerometer, gyroscope and orientation filter in one housing."""

    rate_hz: Rate = 400.0
    accelerometer: InertialNoise = InertialNoise()
    """In m/s^2."""

    gyroscope: GyroscopeNoise = GyroscopeNoise()
    """In rad/s."""

    orientation_stddev_deg: NonNegative = 0.0
    noise_source: Literal["marsaglia", "numpy"] = "marsaglia"
    """How normal numbers are made: by the polar method, as in the paper, or by numpy's ziggurat."""


class Encoders(SensorSpec, frozen=True, tag="encoders"):
    """Incremental encoders on every driven wheel, counted by the motor controller."""

    rate_hz: Rate = 50.0
    ticks_per_revolution: Annotated[int, Meta(gt=0)] = 4096
    """Periods of the encoder in one turn of the shaft that it sits on; 6 for Hall sensors, whose
    shaft turns by a pair of poles. With the next three fields at 1: counts for one turn of the
    wheel, x4 decoding and gearing included."""

    quadrature: Literal[1, 2, 4] = 1
    """Edges that are counted in a period."""

    pole_pairs: Annotated[int, Meta(gt=0)] = 1
    """Of a motor whose Hall sensors are counted."""

    gear_ratio: Positive = 1.0
    """Turns of the encoder's shaft for one of the wheel."""

    reversed_wheels: tuple[str, ...] = ()
    """Wheels whose counter counts down when they roll forward: motors mounted mirror-wise."""

    start_ticks: Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)] = 0
    """What every counter says when physics starts; beyond 64 bits counters wrap."""

    missed_ticks: Fraction01 = 0.0
    """Probability that an edge goes by uncounted."""

    resets_s: tuple[NonNegative, ...] = ()
    """Sim times after which the counters begin at zero again, in order."""

    def __post_init__(self) -> None:
        if list(self.resets_s) != sorted(self.resets_s):
            raise ValueError("`resets_s` is out of order; expected each time after the one before")

    @property
    def ticks_per_wheel_revolution(self) -> float:
        """Counts for one turn of the wheel, if none is missed."""
        return self.ticks_per_revolution * self.quadrature * self.pole_pairs * self.gear_ratio


class WheelOdometry(SensorSpec, frozen=True, tag="wheel_odometry", kw_only=True):
    """Where the motor controller believes to be, by the counters of its wheels alone."""

    mounted: ClassVar[bool] = False

    encoders: str
    """The vehicle's sensor of kind `encoders` whose counters it reads."""

    rate_hz: Rate = 50.0
    track_multiplier: Positive | None = None
    """Effective over geometric track, as the controller is told; none: that of the drive."""

    wheel_radius_m: Positive | None = None
    """As the controller is told; none: that of the vehicle's model."""

    travel_stddev: NonNegative = 0.02
    """By which each side's travel is believed to be wrong after a metre, in metres; it grows with
    the root of the way."""

    turn_stddev: NonNegative = 0.15
    """By which the heading is believed to be wrong, beyond that, after a turn of a radian, in
    radians; it grows with the root of the angle."""


class PositionNoise(Spec, frozen=True):
    """Errors of a satellite receiver along an axis, with the whole sky in view."""

    white_stddev_m: NonNegative = 0.0
    """1 sigma of what is new in each fix."""

    drift_stddev_m: NonNegative = 0.0
    """1 sigma of what wanders slowly (a Gauss-Markov process), as the atmosphere's share does."""


Polygon = Annotated[tuple[tuple[float, float], ...], Meta(min_length=3)]
"""Corners x, y in the world, in metres; the last is joined to the first."""

Azimuth = Annotated[float, Meta(ge=0, lt=360)]
Elevation = Annotated[float, Meta(gt=0, le=90)]


class Gnss(SensorSpec, frozen=True, tag="gnss"):
    """A receiver of satellite navigation; its mount is where the antenna's phase centre is."""

    rate_hz: Annotated[float, Meta(gt=0, le=20)] = 5.0
    solution: Literal["single_point", "sbas", "rtk_float", "rtk_fix"] = "single_point"
    """What the receiver says of its fixes: NavSatFix.status, the quality in GGA."""

    horizontal: PositionNoise = PositionNoise()
    """Of east and of north, each."""

    vertical: PositionNoise = PositionNoise()
    drift_time_s: Annotated[float, Meta(ge=1)] = 60.0
    """After which the drift has forgotten all but 1/e of itself."""

    velocity_stddev_mps: NonNegative = 0.0
    """White, of each axis; velocities are in the NMEA sentences."""

    startup_s: NonNegative = 0.0
    """Sim time until the first fix; messages without a fix come before."""

    latency_s: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """From the instant of measurement, the stamp, to the message."""

    outages: tuple[Polygon, ...] = ()
    """Where there is no fix."""

    sky_view: bool = False
    """Solids and vehicles hide satellites from the antenna."""

    satellites_needed: Annotated[int, Meta(ge=4)] = 4
    """With fewer in view there is no fix."""

    satellites_deg: Annotated[tuple[tuple[Azimuth, Elevation], ...], Meta(min_length=4)] = (
        (15.0, 72.0),
        (48.0, 25.0),
        (82.0, 47.0),
        (121.0, 14.0),
        (155.0, 58.0),
        (190.0, 31.0),
        (228.0, 64.0),
        (263.0, 18.0),
        (301.0, 43.0),
        (338.0, 22.0),
    )
    """Azimuth, clockwise from north, and elevation of each; they stand still. The default is made
    up."""


class Range(SensorSpec, frozen=True, tag="range", kw_only=True):
    """A device that measures one distance: by ultrasound, or by infrared light in either way."""

    rate_hz: Rate = 20.0
    radiation: Literal["ultrasound", "infrared"]
    field_of_view_deg: Annotated[float, Meta(gt=0, le=120)]
    """Full angle of the cone about x in which things are met."""

    rays: Annotated[int, Meta(ge=1, le=4096)] = 128
    """That fill the cone; 1 is the axis alone."""

    echo: Literal["nearest", "mean"] = "nearest"
    """What a device reports of all it meets: sound the first echo, light the mean over its spot."""

    max_incidence_deg: Annotated[float, Meta(gt=0, le=90)] = 90.0
    """Surfaces that are met at a larger angle from their normal send nothing back."""

    min_range_m: NonNegative = 0.0
    max_range_m: Positive
    full_range_reflectivity: Fraction01 = 0.0
    """Of a surface that is seen up to the largest range; one of a quarter of it, up to half as far.
    0 for no influence."""

    range_stddev_m: NonNegative = 0.0
    """White noise of one measurement, 1 sigma."""

    range_stddev_share: NonNegative = 0.0
    """White noise that grows with the distance, as a share of it."""

    range_stddev_per_m: NonNegative = 0.0
    """White noise that grows with the distance squared, as triangulation has it: metres at 1 m."""

    turn_on_bias_m: NonNegative = 0.0
    """1 sigma of the constant offset drawn for a run."""

    range_resolution_m: NonNegative = 0.0
    """Ranges are rounded to multiples of it; 0 for none."""

    dropout: Fraction01 = 0.0
    """Share of measurements that fail, which the device tells (NaN)."""

    def __post_init__(self) -> None:
        if self.min_range_m >= self.max_range_m:
            raise ValueError(
                f"`min_range_m` is {self.min_range_m:g}; expected less than `max_range_m`, "
                f"{self.max_range_m:g}"
            )


Sensor = Lidar | Imu | Encoders | Gnss | Range | WheelOdometry
