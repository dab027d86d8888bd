# SPDX-License-Identifier: Apache-2.0
"""Specification of a satellite receiver in a scenario. The defaults are those of an ideal one."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta

from groundlink.core.fields import NonNegative, Spec
from groundlink.messages.base import packed
from groundlink.messages.navigation import NavSatFix
from groundlink.scenario.every_sensor import Address, Carrier, SensorSpec
from groundlink.scenario.faults import Quantity


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

SolutionType = Literal["single_point", "sbas", "rtk_float", "rtk_fix"]


class Walker(Spec, frozen=True):
    """Satellites of one system on circular orbits, as a Walker delta pattern.

    Walker (1984), "Satellite constellations": `satellites` / `planes` / `phasing` at an
    inclination. The nodes of the planes are evenly spaced around the equator.
    """

    system: Literal["gps", "glonass", "galileo", "beidou"]
    """System that the satellites belong to, for the messages."""

    satellites: Annotated[int, Meta(ge=1, le=36)]
    """Number of satellites in all planes."""

    planes: Annotated[int, Meta(ge=1)]
    """Number of orbital planes, a divisor of `satellites`."""

    phasing: Annotated[int, Meta(ge=0)]
    """Lead of a satellite over its neighbor in the plane to the west, in units of 360 degrees /
    `satellites`."""

    inclination_deg: Annotated[float, Meta(ge=0, le=180)]
    """Angle between the planes and the equator."""

    semi_major_axis_km: Annotated[float, Meta(ge=6500, le=100_000)]
    """Radius of the orbits from the Earth's center."""

    node_deg: float = 0.0
    """Longitude east of Greenwich of the first plane's ascending node, at `sky_time_s: 0`."""

    argument_deg: float = 0.0
    """Angle of the first satellite from its ascending node, at `sky_time_s: 0`."""


class Multipath(Spec, frozen=True):
    """Reflection of satellite signals by walls: solids and vehicles with vertical surfaces."""

    amplitude: Annotated[float, Meta(ge=0, lt=1)] = 0.5
    """Amplitude of a reflected signal relative to a direct one, with the loss in the antenna."""

    reach_m: Annotated[float, Meta(gt=0, le=300)] = 50.0
    """Walls beyond this distance do not reflect."""

    correlator_chips: Annotated[float, Meta(gt=0, le=1)] = 0.1
    """Distance of the receiver's early and late correlators, in chips of 293 m."""


class Solution(Spec, frozen=True):
    """A type of solution that the receiver reaches, its conditions and its errors."""

    type: SolutionType
    """Type of solution, as in the receiver's `solution`."""

    satellites: Annotated[int, Meta(ge=4)] = 4
    """Smallest number of satellites."""

    after_s: NonNegative = 0.0
    """Time for which this many satellites must have been received without interruption."""

    horizontal: PositionNoise = PositionNoise()
    """Errors of the east and north position, each."""

    vertical: PositionNoise = PositionNoise()
    """Errors of the altitude."""

    @property
    def by_carrier(self) -> bool:
        """Whether the position is that of carrier phases, which need direct signals."""
        return self.type.startswith("rtk")


class Gnss(SensorSpec, frozen=True, tag="gnss"):
    """A satellite navigation receiver; its mount is the phase center of the antenna."""

    native: Address | None = None
    """Address for the receiver's own messages by UDP, sent in addition."""

    native_format: Literal["nmea", "ubx"] = "nmea"
    """Format of the receiver's own messages: NMEA 0183, or UBX of u-blox. Data sheets set that of
    their device."""

    quantities: ClassVar = {"position": Quantity("m", ("east", "north", "up"))}
    rate_hz: Annotated[float, Meta(gt=0, le=20)] = 5.0
    """Fixes per second of sim time."""

    solution: SolutionType = "single_point"
    """Type of solution, which determines NavSatFix.status and the quality in GGA."""

    solutions: tuple[Solution, ...] = ()
    """Types of solution from the worst to the best, in place of `solution`, `satellites_needed`,
    `horizontal` and `vertical`. A fix is of the last type whose conditions hold."""

    horizontal: PositionNoise = PositionNoise()
    """Errors of the east and north position, each."""

    vertical: PositionNoise = PositionNoise()
    """Errors of the altitude."""

    drift_time_s: Annotated[float, Meta(ge=1)] = 60.0
    """Correlation time of the drift: its autocorrelation falls to 1/e."""

    velocity_stddev_mps: NonNegative = 0.0
    """White noise of each axis of the velocity, 1 sigma. Velocities are in the native messages."""

    startup_s: NonNegative = 0.0
    """Sim time until the first fix. Earlier messages have no fix."""

    latency_s: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Time from the instant of measurement, which is the stamp, to the message."""

    latency_jitter_s: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Further time, drawn anew for each fix, evenly from 0 to this. No fix overtakes another."""

    outages: tuple[Polygon, ...] = ()
    """Areas without a fix."""

    sky_view: bool = False
    """Whether solids and vehicles block satellites from the antenna."""

    multipath: Multipath | None = None
    """Reflections of signals; needs `sky_view`. None: walls only block."""

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

    constellations: tuple[Walker, ...] = ()
    """Satellites that move by sim time, in place of `satellites_deg`."""

    sky_time_s: float = 0.0
    """Time of the constellations at sim time 0. Another time is another sky."""

    elevation_mask_deg: Annotated[float, Meta(ge=0, lt=90)] = 0.0
    """Satellites at or below this elevation are not received."""

    def ranked_solutions(self) -> tuple[Solution, ...]:
        """Return the types of solution from the worst to the best."""
        if self.solutions:
            return self.solutions
        # Without `sky_view` all satellites are received, whatever their number.
        needed = self.satellites_needed if self.sky_view else 4
        return (Solution(self.solution, needed, 0.0, self.horizontal, self.vertical),)

    def largest_message(self, carrier: Carrier) -> NavSatFix:
        """Return a fix; all have the same size."""
        frame = carrier.frame_prefix + self.frame
        return NavSatFix(0, frame, 0, 0, 0.0, 0.0, 0.0, packed(np.zeros(9)), 0)
