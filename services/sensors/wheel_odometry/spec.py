# SPDX-License-Identifier: Apache-2.0
"""Specification of wheel odometry in a scenario."""

from typing import ClassVar

import numpy as np

from groundlink.core.fields import NonNegative, Positive
from groundlink.messages.base import packed
from groundlink.messages.navigation import Odometry
from groundlink.scenario.every_sensor import Carrier, Rate, SensorSpec
from groundlink.scenario.faults import Quantity


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
    """Messages per second of sim time."""

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

    @property
    def accumulates(self) -> bool:
        """Return whether readings depend on all states before: a pose is the sum of all travel."""
        return True

    def largest_message(self, carrier: Carrier) -> Odometry:
        """Return an odometry message; all have the same size."""
        still, level = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
        frames = (carrier.frame_prefix + self.frame, carrier.frame_prefix + carrier.base_frame)
        unsure = packed(np.zeros(36))
        return Odometry(0, *frames, still, level, still, still, unsure, unsure)
