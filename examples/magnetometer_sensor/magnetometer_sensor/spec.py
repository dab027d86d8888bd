# SPDX-License-Identifier: Apache-2.0
"""Specification: what a scenario can say about a magnetometer. Defaults are an ideal sensor."""

from typing import ClassVar

from groundlink.core.fields import NonNegative, Vector3
from groundlink.scenario.every_sensor import Carrier, Rate, SensorSpec
from groundlink.scenario.faults import Quantity

from .message import MagneticField


class Magnetometer(SensorSpec, frozen=True, tag="magnetometer"):
    """A magnetometer with three axes that measures the Earth's field."""

    quantities: ClassVar = {"field": Quantity("T", ("x", "y", "z"), "field_t")}

    rate_hz: Rate = 100.0
    """Messages per second of sim time."""

    earth_field_t: Vector3 = (0.0, 20e-6, -45e-6)
    """Earth's field along the world's east, north and up, in tesla."""

    noise_stddev_t: NonNegative = 0.0
    """White noise of each axis, 1 sigma."""

    turn_on_bias_t: NonNegative = 0.0
    """1 sigma of each axis' constant offset, drawn for a run."""

    resolution_t: NonNegative = 0.0
    """Readings are rounded to multiples of it; 0 for none."""

    def largest_message(self, carrier: Carrier) -> MagneticField:
        """Return a measurement; all are of one size."""
        return MagneticField(0, carrier.frame_prefix + self.frame, (0.0, 0.0, 0.0), 0.0)
