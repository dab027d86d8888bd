# SPDX-License-Identifier: Apache-2.0
"""Messages of ground truth: poses of all bodies, true points behind LiDAR clouds, vitals.

They have no errors and therefore no covariances. The true motion of a vehicle and its wheels uses
the messages of `navigation`.
"""

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from .base import POINT, BusMessage, exactly, floats, whole

WORLD_FRAME = "world"
"""World frame (ENU), in which the scenario's placements are given."""

TRUE_POINT = np.dtype([*POINT.descr, ("body", "<u4")])
"""`POINT` with the number of the body that the point is on, as in `groundlink.scene.bodies`, or its
`NO_BODY`."""


class Bodies(BusMessage, frozen=True):
    """Poses of all bodies of a run (tf2_msgs/TFMessage)."""

    stamp_nanos: int
    names: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Names of all bodies. The index of a name is the body's number (`groundlink.scene.bodies`)."""

    poses: memoryview
    """float64, a row of x, y, z (m), qx, qy, qz, qw for each body: world_from_body."""

    def __post_init__(self) -> None:
        exactly(self.poses, len(self.names) * 7 * 8, "poses")

    def world_from_body(self) -> NDArray[np.float64]:
        """Return the poses, shape (bodies, 7): position xyz in m, quaternion xyzw."""
        return floats(self.poses).reshape(-1, 7)


class TruePoints(BusMessage, frozen=True):
    """True points of a LiDAR cloud, without errors and as if measured at one instant."""

    stamp_nanos: int
    """Stamp of the cloud."""

    frame: str
    points: memoryview
    """`TRUE_POINT` records, one for each point of the cloud, in the same order. A point is where
    its ray met a surface, moved with that surface to the stamp, in the sensor's frame at the
    stamp."""

    def __post_init__(self) -> None:
        whole(self.points, TRUE_POINT.itemsize, "points")

    def records(self) -> NDArray[np.void]:
        """Return the points as a structured array, shape (N,), dtype `TRUE_POINT`."""
        return np.frombuffer(self.points, TRUE_POINT)


VITALS_HZ = 10


class Contact(Struct, frozen=True):
    """An object that a vehicle touched since the last message."""

    name: str
    """Name of the solid, or of the other vehicle."""

    force_n: float
    """Largest normal force of a contact point in one tick."""

    tick: int
    """Tick of the largest force."""

    ticks: int
    """Number of ticks with contact."""


class BatteryState(Struct, frozen=True):
    """Charge, voltage and current of a vehicle's battery."""

    charge: float
    """State of charge, 0..1."""

    voltage_v: float
    current_a: float


class Vitals(BusMessage, frozen=True):
    """Motor energy, contacts and battery of a vehicle, 10 times per second of sim time.

    Energies are sums since the start of the run; contacts are those since the last message. Contact
    of wheels with the ground is not included.
    """

    stamp_nanos: int
    vehicle: str
    tick: int
    motor_work_j: float
    """Mechanical work of the motors in drive since the start."""

    braked_j: float
    """Mechanical work that the motors absorbed in braking since the start; positive."""

    contacts: tuple[Contact, ...]
    """Contacts in the order of the first touch."""

    battery: BatteryState | None = None
    """Battery; none if the vehicle's model has no battery."""
