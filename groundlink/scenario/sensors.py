# SPDX-License-Identifier: Apache-2.0
"""What each kind of sensor can be told, with the defaults of an ideal one.

Rule: one class a kind; the tag is the kind, and the kind is the name of the process's folder in
`services/sensors`. A data sheet is a file of these fields; the scenario's own fields win over it.
"""

from __future__ import annotations

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
    """In m/s^2."""

    gyroscope: GyroscopeNoise = GyroscopeNoise()
    """In rad/s."""

    orientation_stddev_deg: NonNegative = 0.0
    noise_source: Literal["marsaglia", "numpy"] = "marsaglia"
    """How normal numbers are made: by the polar method, as in the paper, or by numpy's ziggurat."""

    def schedule(self) -> ReadingSchedule:
        """Return when samples are due: the first window begins when the low passes are full."""
        ticks = max(triad.low_pass_ticks for triad in (self.accelerometer, self.gyroscope))
        filled = Events(self.rate_hz).at_or_after(TICK_NANOS * ticks)
        return Events(self.rate_hz, filled + 1)

    def largest_message(self, carrier: Carrier) -> messages.Imu:
        """Return a sample; all are of one size."""
        frame, still = carrier.frame_prefix + self.frame, (0.0, 0.0, 0.0)
        return messages.Imu(0, frame, (0.0, 0.0, 0.0, 1.0), still, still, 0.0, 0.0, 0.0)


class Encoders(SensorSpec, frozen=True, tag="encoders"):
    """Incremental encoders, counted by the motor controller.

    On every driven wheel, on each track's sprocket, on those wheels of a car that are not steered.
    """

    quantities: ClassVar = {"ticks": Quantity("ticks", EACH_WHEEL)}
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

    scale_stddev: NonNegative = 0.0
    """1 sigma of each wheel's relative error of scale, drawn for a run: a tire whose radius is not
    the nominal one."""

    slip_stddev: NonNegative = 0.0
    """1 sigma, in radians after a radian, by which a wheel's counted angle strays from what it
    rolled on the ground; it grows with the root of the angle."""

    resets_s: tuple[NonNegative, ...] = ()
    """Sim times after which the counters begin at zero again, in order."""

    def __post_init__(self) -> None:
        if list(self.resets_s) != sorted(self.resets_s):
            raise ValueError("`resets_s` is out of order; expected each time after the one before")

    @property
    def ticks_per_wheel_revolution(self) -> float:
        """Counts for one turn of the wheel, if none is missed."""
        return self.ticks_per_revolution * self.quadrature * self.pole_pairs * self.gear_ratio

    def largest_message(self, carrier: Carrier) -> messages.WheelEncoders:
        """Return the counters of all shafts."""
        frame, shafts = carrier.frame_prefix + self.frame, carrier.shafts
        return messages.WheelEncoders(0, frame, shafts, (0,) * len(shafts))


class WheelOdometry(SensorSpec, frozen=True, tag="wheel_odometry", kw_only=True):
    """Where the motor controller believes to be, by the counters of its wheels alone."""

    mounted: ClassVar[bool] = False
    quantities: ClassVar = {
        "position": Quantity("m", ("x", "y", "z"), "position_m"),
        "yaw": Quantity("rad"),
    }

    encoders: str
    """The vehicle's sensor of kind `encoders` whose counters it reads."""

    rate_hz: Rate = 50.0
    track_multiplier: Positive | None = None
    """Effective over geometric track, as the controller is told; none: that of the drive, 1 for a
    car's."""

    wheel_radius_m: Positive | None = None
    """As the controller is told, of wheels or sprockets; none: that of the vehicle's model."""

    travel_stddev: NonNegative = 0.001
    """1 sigma of each side's travel after a meter, in meters, beyond what the encoders err by; it
    grows with the root of the distance."""

    turn_stddev_share: NonNegative | None = None
    """1 sigma of the effective track's relative error, a constant of a run; none: that of the
    drive."""

    skid_stddev_s: NonNegative | None = None
    """1 sigma of the skid velocity, along and sideways, for each m/s^2 of lateral acceleration
    (m/s), a constant of a run; none: that of the drive."""

    def largest_message(self, carrier: Carrier) -> Odometry:
        """Return an odometry; all are of one size."""
        still, level = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
        frames = (carrier.frame_prefix + self.frame, carrier.frame_prefix + carrier.base_frame)
        unsure = packed(np.zeros(36))
        return Odometry(0, *frames, still, level, still, still, unsure, unsure)


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

    native: Address | None = None
    """Where the receiver's NMEA sentences go besides, by UDP."""

    quantities: ClassVar = {"position": Quantity("m", ("east", "north", "up"))}
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

    def largest_message(self, carrier: Carrier) -> NavSatFix:
        """Return a fix; all are of one size."""
        frame = carrier.frame_prefix + self.frame
        return NavSatFix(0, frame, 0, 0, 0.0, 0.0, 0.0, packed(np.zeros(9)), 0)
