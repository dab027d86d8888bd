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


class Gnss(SensorSpec, frozen=True, tag="gnss"):
    """A satellite navigation receiver; its mount is the phase center of the antenna."""

    native: Address | None = None
    """Address for the receiver's NMEA sentences by UDP, sent in addition."""

    quantities: ClassVar = {"position": Quantity("m", ("east", "north", "up"))}
    rate_hz: Annotated[float, Meta(gt=0, le=20)] = 5.0
    """Fixes per second of sim time."""

    solution: Literal["single_point", "sbas", "rtk_float", "rtk_fix"] = "single_point"
    """Type of solution, which determines NavSatFix.status and the quality in GGA."""

    horizontal: PositionNoise = PositionNoise()
    """Errors of the east and north position, each."""

    vertical: PositionNoise = PositionNoise()
    """Errors of the altitude."""

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
