# SPDX-License-Identifier: Apache-2.0
"""Message of the bus: one measurement of the magnetic field."""

from groundlink.core.fields import Vector3
from groundlink.messages.base import Reading


class MagneticField(Reading, frozen=True):
    """Magnetic field in the sensor's frame (sensor_msgs/MagneticField)."""

    stamp_nanos: int
    frame: str
    field_t: Vector3
    """Flux density along x, y and z, in tesla."""

    variance_t2: float
    """Variance of each axis."""
