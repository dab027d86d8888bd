# SPDX-License-Identifier: Apache-2.0
"""The messages of the bus and their bytes.

Rule: a message is a Struct whose MessagePack map is the format; arrays travel as one bin each and
are read in place. What does not fit its schema raises `BadBusMessage` with a reason, never more.
Stamps are the instant of measurement: nanoseconds of the run's epoch plus sim time. Those of images
and ranges are in `imagery`, those of poses, maps and transforms in `navigation`.
"""

from __future__ import annotations

from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundlink.core.fields import Quaternion, Vector3

Int64 = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]

POINT = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring", "time"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2", "<f4"],
        "offsets": [0, 4, 8, 12, 16, 18],
        "itemsize": 22,
    }
)
"""A LiDAR return as sensor_msgs/PointCloud2 carries it: metres in the sensor's frame, reflectivity
0..255, laser number from below, seconds from the cloud's stamp."""


class BadBusMessage(ValueError):
    """Bytes from the bus that are not the message they should be; the text says why."""


class BusMessage(msgspec.Struct, frozen=True):
    """A message of the bus."""


class Reading(BusMessage, frozen=True, kw_only=True, omit_defaults=True):
    """What a sensor has measured, stamped by the sensor's own clock."""

    clock_error_nanos: int = 0
    """By how much that clock is off on purpose; the stamp less this is the instant of measurement.
    """


def all_messages() -> set[type[BusMessage]]:
    """Return every type of message that was imported."""
    return {*BusMessage.__subclasses__(), *Reading.__subclasses__()} - {Reading}


def measured_nanos(message: BusMessage) -> int:
    """Return the instant of a message on the run's time line, whatever a sensor's clock says."""
    stamp: int = message.stamp_nanos  # type: ignore[attr-defined]
    return stamp - message.clock_error_nanos if isinstance(message, Reading) else stamp


def whole(array: memoryview, record_bytes: int, field: str) -> None:
    """Refuse a bin that does not hold a whole number of records."""
    if len(array) % record_bytes:
        raise ValueError(f"`{field}` has {len(array)} bytes, expected a multiple of {record_bytes}")


def exactly(array: memoryview, size_bytes: int, field: str) -> None:
    """Refuse a bin that is not as long as the message's other fields say."""
    if len(array) != size_bytes:
        raise ValueError(f"`{field}` has {len(array)} bytes, expected {size_bytes}")


class VehicleState(msgspec.Struct, frozen=True):
    """Where a vehicle's links are, how its base moves, where its joints are."""

    link_poses: memoryview
    """float64, rows of x, y, z, qx, qy, qz, qw: world_from_link, in the order of the model's links
    (base first, then wheels, then other joints)."""

    base_velocity: memoryview
    """float64, 6: linear (m/s), then angular (rad/s) velocity of the base's origin, in world."""

    joint_positions: memoryview
    """float64, one a wheel in the order of the model's wheels: radians, never wrapped."""

    joint_velocities: memoryview
    """float64, rad/s, in the same order."""

    servo_positions: memoryview = memoryview(b"")
    """float64, one a joint that is none of a wheel, in the model's order: rad, or m."""

    servo_velocities: memoryview = memoryview(b"")
    """float64, rad/s or m/s, in the same order."""

    def __post_init__(self) -> None:
        whole(self.link_poses, 7 * 8, "link_poses")
        whole(self.base_velocity, 6 * 8, "base_velocity")
        whole(self.joint_positions, 8, "joint_positions")
        whole(self.joint_velocities, 8, "joint_velocities")
        whole(self.servo_positions, 8, "servo_positions")
        whole(self.servo_velocities, 8, "servo_velocities")

    def poses(self) -> NDArray[np.float64]:
        """Return world_from_link, shape (links, 7): position xyz in m, quaternion xyzw."""
        return floats(self.link_poses).reshape(-1, 7)


class State(BusMessage, frozen=True):
    """The truth at one tick, from physics, 400 a second of sim time."""

    run: str
    episode: int = msgspec.field(name="life")
    """Identifies an episode of the run: each start and each reset of physics begins one, at tick 0.
    Its value is the wall clock in nanoseconds at that time."""

    epoch_nanos: int
    """Stamp of sim time zero."""

    tick: int
    sim_nanos: int
    world_hash: str
    vehicles: dict[str, VehicleState]
    actors: memoryview = memoryview(b"")
    """float64, rows of x, y, z, qx, qy, qz, qw: world_from_actor, in the scenario's order."""

    def __post_init__(self) -> None:
        whole(self.actors, 7 * 8, "actors")

    @property
    def stamp_nanos(self) -> int:
        """The instant of this state on the run's time line."""
        return self.epoch_nanos + self.sim_nanos


class Clock(BusMessage, frozen=True):
    """The run's time, for ROS nodes that use sim time."""

    stamp_nanos: int
    epoch_nanos: int
    tick: int
    episode: int = msgspec.field(name="life")
    """See `State.episode`."""


class Command(BusMessage, frozen=True):
    """A velocity that a vehicle is asked for (geometry_msgs/Twist), in its base frame."""

    stamp_nanos: int
    """Sim instant at which the command was current; it acts at the tick after it."""

    linear_mps: Vector3
    angular_radps: Vector3


class WheelCommand(BusMessage, frozen=True):
    """What single wheels of a vehicle are asked for, instead of a velocity; at once, not ramped."""

    stamp_nanos: int
    """As a command's."""

    speeds_radps: dict[str, float]
    """By the names of driven wheels or tracks, forward > 0; those left out are to stand still."""

    angles_rad: dict[str, float] = {}
    """By the names of steered wheels, to the left > 0; those left out straight ahead."""


class Imu(Reading, frozen=True):
    """One sample of an inertial measurement unit, in the sensor's frame (REP 145)."""

    stamp_nanos: int
    frame: str
    orientation: Quaternion
    """world_from_sensor, xyzw."""

    angular_velocity_radps: Vector3
    linear_acceleration_mps2: Vector3
    """Specific force: a level unit at rest reads +9.80665 on z."""

    orientation_variance: float
    angular_velocity_variance: float
    linear_acceleration_variance: float


class PointCloud(Reading, frozen=True):
    """The returns of one LiDAR revolution, or of one block of it."""

    stamp_nanos: int
    """The first firing, whether it returned or not."""

    frame: str
    points: memoryview
    """`POINT` records; rays without a return are left out."""

    def __post_init__(self) -> None:
        whole(self.points, POINT.itemsize, "points")

    def records(self) -> NDArray[np.void]:
        """Return the points as a structured array, shape (N,), dtype `POINT`."""
        return np.frombuffer(self.points, POINT)


class WheelEncoders(Reading, frozen=True):
    """The 64-bit counters of a vehicle's wheels."""

    stamp_nanos: int
    frame: str
    names: tuple[str, ...]
    ticks: tuple[Int64, ...]


class Ack(BusMessage, frozen=True):
    """A process's word on how far it has come."""

    episode: int = msgspec.field(name="life")
    """See `State.episode`."""

    tick: int
    """The last state that it has taken in; -1 for none yet."""

    settled_tick: int
    """The tick up to which nothing more will come from it: where a successor may resume."""

    memory: bytes = b""
    """What a successor cannot know from the states since then, in the process's own words."""

    commanded: dict[str, int] = {}
    """By vehicle, the tick of the stamp of the newest command that it sent up to now: physics takes
    its word when that is here."""


NOT_REPORTED = "not reported"
"""Shown for a topic whose receiver sends no reports."""


class StreamReport(msgspec.Struct, frozen=True):
    """What became of one topic between the gateway and the ROS side.

    `sent` = messages + missing + incomplete + late + dropped + in_flight.
    """

    topic: str
    type: str
    declared_hz: float | None
    measured_hz: float | None
    """Counted in stamps: (messages - 1) / (last stamp - first stamp)."""

    age_seconds: float | None
    """From the instant of measurement to publication: the median of the last 10 s."""

    messages: int
    """Published at the other end."""

    lost: int
    """What the wire lost: missing + incomplete + late."""

    direction: str = "to ROS"
    age_p99_seconds: float | None = None
    """What 99 % of the ages do not exceed."""

    sent: int = 0
    missing: int = 0
    """Of which nothing came."""

    incomplete: int = 0
    """Given up for want of parts."""

    late: int = 0
    """Whole behind a newer one."""

    dropped: int = 0
    """Whole, but pushed out by a newer one before it was published, or refused by ROS."""

    in_flight: int = 0
    """On the way, or waiting at the other end, or not yet reported."""

    repaired: int = 0
    """Of those that came whole, the ones that needed repair."""

    superseded: int = 0
    """Pushed out by a newer one before they were sent; no part of `sent`."""

    delivered_bytes: int = 0
    """Bodies of those published."""

    reported: bool = True
    """False where the ROS side has never reported what arrives: then only `sent`, all of it
    `in_flight`, and `superseded` are known, and nothing counts as lost."""


class Health(BusMessage, frozen=True):
    """A process's word about itself, once a second."""

    process: str
    pid: int
    tick: int
    counters: dict[str, int]
    streams: tuple[StreamReport, ...] = ()
    host: str = ""
    """Name of the machine that it runs on."""


M = TypeVar("M", bound=BusMessage)

_ENCODER = msgspec.msgpack.Encoder()
_DECODERS: dict[type[BusMessage], msgspec.msgpack.Decoder[Any]] = {}


def encode(message: BusMessage) -> bytes:
    """Return a message as MessagePack."""
    return _ENCODER.encode(message)


def decode(payload: bytes | memoryview, message_type: type[M]) -> M:
    """Return the message that `payload` holds; its arrays are views into `payload`.

    Raises
    ------
    BadBusMessage
        when the bytes are not MessagePack or do not fit the type's schema.
    """
    decoder = _DECODERS.get(message_type)
    if decoder is None:
        decoder = _DECODERS[message_type] = msgspec.msgpack.Decoder(message_type)
    try:
        return decoder.decode(payload)  # type: ignore[no-any-return]
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BadBusMessage(f"not a {message_type.__name__}: {error}") from None


def floats(packed: memoryview) -> NDArray[np.float64]:
    """Return the float64 array that a bin holds, without a copy, read-only."""
    return np.frombuffer(packed, np.float64)


def packed(array: NDArray[Any]) -> memoryview:
    """Return an array's bytes for a bin field, without a copy where it is contiguous."""
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
