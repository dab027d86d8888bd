# SPDX-License-Identifier: Apache-2.0
"""Scenario fields of the shipped kinds of sensors; the defaults describe ideal devices.

Each kind is a class. Its tag is the kind, and the kind is the name of the process's folder in
`services/sensors`. A data sheet is a file of these fields; fields of the scenario override it.
"""

from typing import Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta

from groundlink.core.clock import TICK_NANOS
from groundlink.core.fields import Fraction01, NonNegative, Positive, Spec
from groundlink.messages import base as messages
from groundlink.messages.base import packed
from groundlink.messages.navigation import NavSatFix, Odometry
from groundlink.messages.reading_schedule import Events, ReadingSchedule

from .cameras import Camera, Optics
from .depth_cameras import DepthCamera, StereoCamera
from .every_sensor import (
    MOUNT_FROM_OPTICAL,
    Address,
    Carrier,
    Mount,
    Rate,
    Repair,
    RepairBy,
    RosTopic,
    SensorSpec,
)
from .faults import EACH_WHEEL, Quantity
from .inertial import GyroscopeNoise, InertialNoise
from .lidars import Lidar, Lidar2d, RotatingLidar

__all__ = [
    "MOUNT_FROM_OPTICAL",
    "Address",
    "Camera",
    "DepthCamera",
    "Encoders",
    "Gnss",
    "InertialUnit",
    "Lidar",
    "Lidar2d",
    "Mount",
    "Optics",
    "PositionNoise",
    "Rate",
    "Repair",
    "RepairBy",
    "RosTopic",
    "RotatingLidar",
    "SensorSpec",
    "StereoCamera",
    "WheelOdometry",
]


class InertialUnit(SensorSpec, frozen=True, tag="imu"):
    """Accelerometer, gyroscope and orientation filter in one housing."""

    quantities: ClassVar = {
        "acceleration": Quantity("m/s^2", ("x", "y", "z"), "linear_acceleration_mps2"),
        "angular_velocity": Quantity("rad/s", ("x", "y", "z"), "angular_velocity_radps"),
    }
    rate_hz: Rate = 400.0
    accelerometer: InertialNoise = InertialNoise()
    """Errors of the accelerometer, in m/s^2."""

    gyroscope: GyroscopeNoise = GyroscopeNoise()
    """Errors of the gyroscope, in rad/s."""

    orientation_stddev_deg: NonNegative = 0.0
    noise_source: Literal["marsaglia", "numpy"] = "marsaglia"
    """Generator of normally distributed numbers: Marsaglia's polar method as in the paper, or
    numpy's ziggurat."""

    def schedule(self) -> ReadingSchedule:
        """Return the schedule of samples; it begins after the low passes have settled."""
        ticks = max(triad.low_pass_ticks for triad in (self.accelerometer, self.gyroscope))
        filled = Events(self.rate_hz).at_or_after(TICK_NANOS * ticks)
        return Events(self.rate_hz, filled + 1)

    def largest_message(self, carrier: Carrier) -> messages.Imu:
        """Return a sample; all have the same size."""
        frame, still = carrier.frame_prefix + self.frame, (0.0, 0.0, 0.0)
        return messages.Imu(0, frame, (0.0, 0.0, 0.0, 1.0), still, still, 0.0, 0.0, 0.0)


class Encoders(SensorSpec, frozen=True, tag="encoders"):
    """Incremental encoders, counted by the motor controller.

    They are on every driven wheel, on each track's sprocket, or on the wheels of a car that are not
    steered.
    """

    quantities: ClassVar = {"ticks": Quantity("ticks", EACH_WHEEL)}
    rate_hz: Rate = 50.0
    ticks_per_revolution: Annotated[int, Meta(gt=0)] = 4096
    """Periods of the encoder per revolution of its own shaft; 6 for Hall sensors, per electrical
    revolution (one pole pair). If the next three fields are 1: counts per revolution of the
    wheel, with x4 decoding and gearing included."""

    quadrature: Literal[1, 2, 4] = 1
    """Edges that are counted per period."""

    pole_pairs: Annotated[int, Meta(gt=0)] = 1
    """Pole pairs of a motor whose Hall sensors are counted."""

    gear_ratio: Positive = 1.0
    """Revolutions of the encoder's shaft per revolution of the wheel."""

    reversed_wheels: tuple[str, ...] = ()
    """Wheels whose counters count down when they roll forward, such as motors mounted in mirror
    image."""

    start_ticks: Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)] = 0
    """Initial value of every counter. Counters wrap at 64 bits."""

    missed_ticks: Fraction01 = 0.0
    """Probability that an edge is not counted."""

    scale_stddev: NonNegative = 0.0
    """1 sigma of the relative scale error of each wheel, drawn once per run. It stands for a tire
    whose radius differs from the nominal one."""

    slip_stddev: NonNegative = 0.0
    """1 sigma, in radians after one radian, of the difference between a wheel's counted angle and
    the angle that it rolled on the ground. It grows with the square root of the angle."""

    resets_s: tuple[NonNegative, ...] = ()
    """Sim times, in order, at which the counters restart at zero."""

    def __post_init__(self) -> None:
        if list(self.resets_s) != sorted(self.resets_s):
            raise ValueError("`resets_s` is out of order; expected each time after the one before")

    @property
    def ticks_per_wheel_revolution(self) -> float:
        """Counts per revolution of the wheel, without missed edges."""
        return self.ticks_per_revolution * self.quadrature * self.pole_pairs * self.gear_ratio

    def largest_message(self, carrier: Carrier) -> messages.WheelEncoders:
        """Return the counters of all shafts."""
        frame, shafts = carrier.frame_prefix + self.frame, carrier.shafts
        return messages.WheelEncoders(0, frame, shafts, (0,) * len(shafts))


class WheelOdometry(SensorSpec, frozen=True, tag="wheel_odometry", kw_only=True):
    """Odometry of the motor controller, from the wheel counters alone."""

    mounted: ClassVar[bool] = False
    quantities: ClassVar = {
        "position": Quantity("m", ("x", "y", "z"), "position_m"),
        "yaw": Quantity("rad"),
    }

    encoders: str
    """Name of the vehicle's sensor of kind `encoders` whose counters are used."""

    rate_hz: Rate = 50.0
    track_multiplier: Positive | None = None
    """Effective over geometric track width, as configured in the controller; none: the value of the
    drive, 1 for a car."""

    wheel_radius_m: Positive | None = None
    """Radius of wheels or sprockets, as configured in the controller; none: the radius of the
    vehicle model."""

    travel_stddev: NonNegative = 0.001
    """1 sigma of each side's travel after one meter, in meters, in addition to the errors of the
    encoders. It grows with the square root of the distance."""

    turn_stddev_share: NonNegative | None = None
    """1 sigma of the relative error of the effective track width, constant for a run; none: the
    value of the drive."""

    skid_stddev_s: NonNegative | None = None
    """1 sigma of the skid velocity (m/s), along and sideways, for each m/s^2 of lateral
    acceleration, constant for a run; none: the value of the drive."""

    def largest_message(self, carrier: Carrier) -> Odometry:
        """Return an odometry message; all have the same size."""
        still, level = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
        frames = (carrier.frame_prefix + self.frame, carrier.frame_prefix + carrier.base_frame)
        unsure = packed(np.zeros(36))
        return Odometry(0, *frames, still, level, still, still, unsure, unsure)


class PositionNoise(Spec, frozen=True):
    """Errors of a satellite receiver along an axis, with an unobstructed sky."""

    white_stddev_m: NonNegative = 0.0
    """1 sigma of the white noise of each fix."""

    drift_stddev_m: NonNegative = 0.0
    """1 sigma of the slow drift (a Gauss-Markov process), such as the error of the atmosphere."""


Polygon = Annotated[tuple[tuple[float, float], ...], Meta(min_length=3)]
"""Corners x, y in the world frame, in meters. The last corner is connected to the first."""

Azimuth = Annotated[float, Meta(ge=0, lt=360)]
Elevation = Annotated[float, Meta(gt=0, le=90)]


class Gnss(SensorSpec, frozen=True, tag="gnss"):
    """A satellite navigation receiver; its mount is the phase center of the antenna."""

    native: Address | None = None
    """Address for the receiver's NMEA sentences by UDP, sent in addition."""

    quantities: ClassVar = {"position": Quantity("m", ("east", "north", "up"))}
    rate_hz: Annotated[float, Meta(gt=0, le=20)] = 5.0
    solution: Literal["single_point", "sbas", "rtk_float", "rtk_fix"] = "single_point"
    """Type of solution, which determines NavSatFix.status and the quality in GGA."""

    horizontal: PositionNoise = PositionNoise()
    """Errors of the east and north position, each."""

    vertical: PositionNoise = PositionNoise()
    drift_time_s: Annotated[float, Meta(ge=1)] = 60.0
    """Correlation time of the drift: its autocorrelation falls to 1/e."""

    velocity_stddev_mps: NonNegative = 0.0
    """White noise of each axis of the velocity, 1 sigma. Velocities are in the NMEA sentences."""

    startup_s: NonNegative = 0.0
    """Sim time until the first fix. Earlier messages have no fix."""

    latency_s: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Time from the instant of measurement, which is the stamp, to the message."""

    outages: tuple[Polygon, ...] = ()
    """Areas without a fix."""

    sky_view: bool = False
    """Whether solids and vehicles block satellites from the antenna."""

    satellites_needed: Annotated[int, Meta(ge=4)] = 4
    """Smallest number of satellites in view for a fix."""

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
    """Azimuth, clockwise from north, and elevation of each satellite; they do not move. The default
    is an invented constellation."""

    def largest_message(self, carrier: Carrier) -> NavSatFix:
        """Return a fix; all have the same size."""
        frame = carrier.frame_prefix + self.frame
        return NavSatFix(0, frame, 0, 0, 0.0, 0.0, 0.0, packed(np.zeros(9)), 0)
