# SPDX-License-Identifier: Apache-2.0
"""What each kind of sensor can be told, with the defaults of an ideal one.

Rule: one class a kind; the tag is the kind, and the kind is the name of the process's folder in
`services/sensors`. A data sheet is a file of these fields; the scenario's own fields win over it.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from msgspec import Meta

from groundlink.clock import exact
from groundlink.world.solids import Fraction01, Positive, Spec, Vector3

NonNegative = Annotated[float, Meta(ge=0)]
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


class InertialNoise(Spec, frozen=True):
    """Errors of a triad of axes."""

    noise_density: NonNegative = 0.0
    """Per root hertz, of a unit of the quantity; white sigma is this times sqrt(rate)."""

    turn_on_bias: NonNegative = 0.0
    """1 sigma of the constant offset drawn for a run, in the quantity's unit."""


class Imu(SensorSpec, frozen=True, tag="imu"):
    """Accelerometer, gyroscope and orientation filter in one housing."""

    rate_hz: Rate = 400.0
    accelerometer: InertialNoise = InertialNoise()
    """In m/s^2."""

    gyroscope: InertialNoise = InertialNoise()
    """In rad/s."""

    orientation_stddev_deg: NonNegative = 0.0


class Encoders(SensorSpec, frozen=True, tag="encoders"):
    """Incremental encoders on every driven wheel, counted by the motor controller."""

    rate_hz: Rate = 50.0
    ticks_per_revolution: Annotated[int, Meta(gt=0)] = 4096
    """Counts for one turn of the wheel: x4 decoding and gearing included."""


Sensor = Lidar | Imu | Encoders
