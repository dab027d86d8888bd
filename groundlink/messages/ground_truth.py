# SPDX-License-Identifier: Apache-2.0
"""Messages of ground truth: poses of all bodies, true points behind LiDAR clouds, labels, vitals.

They have no errors and therefore no covariances. The true motion of a vehicle and its wheels uses
the messages of `navigation`. Labels have the stamps of their sensor's readings, its clock error
included.
"""

from typing import Annotated

import numpy as np
from msgspec import UNSET, Meta, Struct, UnsetType
from numpy.typing import NDArray

from .base import POINT, BusMessage, Reading, exactly, floats, whole

WORLD_FRAME = "world"
"""World frame (ENU), in which the scenario's placements are given."""

TRUE_POINT = np.dtype([*POINT.descr, ("body", "<u4")])
"""`POINT` with the number of the body that the point is on, as in `groundlink.scene.bodies`, or its
`NO_BODY`."""

LABELED_POINT = np.dtype([*POINT.descr, ("label", "<u2"), ("instance", "<u2")])
"""`POINT` with the numbers of the class and of the object that the point is on; 0 for none."""


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


class LabeledPoints(Reading, frozen=True):
    """Points of a LiDAR cloud, each with its class and its object."""

    stamp_nanos: int
    """Stamp of the cloud."""

    frame: str
    points: memoryview
    """`LABELED_POINT` records: those of the cloud, in the same order."""

    def __post_init__(self) -> None:
        whole(self.points, LABELED_POINT.itemsize, "points")

    def records(self) -> NDArray[np.void]:
        """Return the points as a structured array, shape (N,), dtype `LABELED_POINT`."""
        return np.frombuffer(self.points, LABELED_POINT)


class LabelTable(Reading, frozen=True):
    """Names of the numbers in an image or a cloud of labels (vision_msgs/LabelInfo)."""

    stamp_nanos: int
    """Stamp of the image or cloud."""

    frame: str
    names: tuple[str, ...]
    numbers: memoryview
    """uint16, one for each name: a class, or an object."""

    def __post_init__(self) -> None:
        exactly(self.numbers, len(self.names) * 2, "numbers")


class Detections2D(Reading, frozen=True):
    """Boxes around what a picture shows of each object (vision_msgs/Detection2DArray)."""

    stamp_nanos: int
    """Stamp of the image."""

    frame: str
    """Optical frame of the camera."""

    names: tuple[str, ...]
    """Names of the objects, which identify them from picture to picture."""

    classes: memoryview
    """uint16: class of each object."""

    visible: memoryview
    """float64: share of each object's pixels that nothing else hides, 0..1."""

    boxes_px: memoryview
    """float64, a row of x, y, width, height for each object: the middle of its box and the size.
    Pixel centers have integer coordinates."""

    def __post_init__(self) -> None:
        _of_objects(self.names, self.classes, self.visible)
        exactly(self.boxes_px, len(self.names) * 4 * 8, "boxes_px")


class Detections3D(Reading, frozen=True):
    """Boxes around objects in the frame of a sensor (vision_msgs/Detection3DArray)."""

    stamp_nanos: int
    """Stamp of the image or cloud."""

    frame: str
    """Frame of the sensor; of a camera, its optical frame."""

    names: tuple[str, ...]
    """Names of the objects, which identify them from message to message."""

    classes: memoryview
    """uint16: class of each object."""

    visible: memoryview
    """float64: share of each object's pixels that nothing else hides, 0..1; of a LiDAR, 1."""

    boxes: memoryview
    """float64, a row of x, y, z (m), qx, qy, qz, qw, length, width, height (m) for each object:
    the middle of its box, the box's rotation, and its size along its own axes."""

    def __post_init__(self) -> None:
        _of_objects(self.names, self.classes, self.visible)
        exactly(self.boxes, len(self.names) * 10 * 8, "boxes")


def _of_objects(names: tuple[str, ...], classes: memoryview, visible: memoryview) -> None:
    """Refuse classes and shares that are not one for each object."""
    exactly(classes, len(names) * 2, "classes")
    exactly(visible, len(names) * 8, "visible")


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


class WheelInSoil(Struct, frozen=True):
    """A wheel on soft soil."""

    wheel: str
    """Name of the wheel in the vehicle's model."""

    slip: float
    """Of a driven wheel 1 - v / (r w), of a braked wheel (r w) / v - 1, in the direction of travel:
    1 for a wheel that spins on the spot, -1 for a locked one. It follows over the way in which slip
    digs, a radius of the wheel."""

    sinkage_m: float
    """Depth of the wheel's lowest point below the untouched surface."""


class InWater(Struct, frozen=True):
    """A vehicle in standing water."""

    depth_m: float
    """Depth of the lowest point of the deepest wheel below the surface."""

    drowned: bool
    """Whether the water was too deep for the motors, which have stopped for good."""


class Vitals(BusMessage, frozen=True):
    """Motor energy, contacts, battery and sinkage of a vehicle, 10 times per second of sim time.

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

    soil: tuple[WheelInSoil, ...] | UnsetType = UNSET
    """Wheels that stand on soil. Left out where none does."""

    water: InWater | UnsetType = UNSET
    """Standing water around the vehicle. Left out on dry ground, unless the motors have drowned."""

    @property
    def has_drowned(self) -> bool:
        """Whether the motors have stopped in water that was too deep."""
        return not isinstance(self.water, UnsetType) and self.water.drowned
