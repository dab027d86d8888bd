# SPDX-License-Identifier: Apache-2.0
"""Messages of the bus and their encoding.

A message is a Struct; its MessagePack map is the wire format. Each array is one bin and is read in
place. A payload that does not fit its schema raises `BadBusMessage` with a reason, and no other
error. Stamps are instants of measurement in nanoseconds: the run's epoch plus sim time. Images and
ranges are in `imagery`; poses, maps and transforms are in `navigation`.
"""

import os
import struct
from copy import copy
from typing import Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np
from msgspec.structs import force_setattr
from numpy.typing import NDArray

from groundlink.core.fields import Quaternion, Vector3
from groundlink.world.ruts import TILE

Int64 = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]

POINT = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring", "time"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2", "<f4"],
        "offsets": [0, 4, 8, 12, 16, 18],
        "itemsize": 22,
    }
)
"""A LiDAR return in the layout of sensor_msgs/PointCloud2: position in meters in the sensor's
frame, reflectivity 0..255, laser number from below, seconds after the cloud's stamp."""

CloudLayout = Literal["velodyne", "ouster", "hesai", "livox"]
"""Layouts of a cloud in ROS, by the drivers that have them; on the bus points are `POINT` records
in any case."""


class BadBusMessage(ValueError):
    """Payload from the bus that is not a valid message of its type; the text gives the reason."""


class BusMessage(msgspec.Struct, frozen=True):
    """Base of all messages of the bus."""


class Reading(BusMessage, frozen=True, kw_only=True, omit_defaults=True):
    """Base of sensor readings, stamped by the sensor's own clock."""

    clock_error_nanos: int = 0
    """Injected error of the sensor's clock. The stamp minus this value is the instant of
    measurement."""


def all_messages() -> set[type[BusMessage]]:
    """Return all message types of imported modules."""
    return {*BusMessage.__subclasses__(), *Reading.__subclasses__()} - {Reading, EncodedState}


def measured_nanos(message: BusMessage) -> int:
    """Return the instant of a message on the run's time line, without the clock error."""
    stamp: int = message.stamp_nanos  # type: ignore[attr-defined]
    return stamp - message.clock_error_nanos if isinstance(message, Reading) else stamp


def whole(array: memoryview, record_bytes: int, field: str) -> None:
    """Refuse a bin that does not hold a whole number of records."""
    if len(array) % record_bytes:
        raise ValueError(f"`{field}` has {len(array)} bytes, expected a multiple of {record_bytes}")


def exactly(array: memoryview, size_bytes: int, field: str) -> None:
    """Refuse a bin whose size does not match the message's other fields."""
    if len(array) != size_bytes:
        raise ValueError(f"`{field}` has {len(array)} bytes, expected {size_bytes}")


class VehicleState(msgspec.Struct, frozen=True):
    """State of a vehicle: link poses, base velocity, and positions and velocities of joints."""

    link_poses: memoryview
    """float64, rows of x, y, z (m), qx, qy, qz, qw: world_from_link, in the order of the model's
    links (base first, then wheels, then other joints)."""

    base_velocity: memoryview
    """float64, 6: linear (m/s), then angular (rad/s) velocity of the base's origin, in world."""

    joint_positions: memoryview
    """float64, rad, one value per wheel in the order of the model's wheels; angles are not wrapped.
    """

    joint_velocities: memoryview
    """float64, rad/s, one value per wheel in the same order."""

    servo_positions: memoryview = memoryview(b"")
    """float64, rad or m, one value per joint other than wheel joints, in the model's order, then
    one per arm."""

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


class Ruts(msgspec.Struct, frozen=True, omit_defaults=True):
    """Ruts of a terrain at a tick, and how they have changed since the tick before."""

    digest: bytes
    """Of their content, see `groundlink.world.ruts`."""

    before: bytes = b""
    """Digest of the ruts in which `tiles` are new or replace others; left out without tiles."""

    tiles: memoryview = memoryview(b"")
    """Records of 520 bytes: the tile's row (north) times the number of tiles in a row, plus its
    column (east), int64; 16 x 16 depths by row and column, uint16, 0.1 mm. Vertices are at most
    0.05 m from each other and divide the cells of the map; the first one is the map's."""

    def __post_init__(self) -> None:
        whole(self.tiles, TILE.itemsize, "tiles")


class State(BusMessage, frozen=True):
    """Ground truth of a run at one tick, from physics; 400 ticks per second of sim time."""

    run: str
    episode: int = msgspec.field(name="life")
    """Identifies an episode of the run. Each start and each reset of physics begins an episode, at
    tick 0. The value is the wall clock in nanoseconds at that time."""

    epoch_nanos: int
    """Stamp of sim time zero."""

    tick: int
    sim_nanos: int
    world_hash: str
    vehicles: dict[str, VehicleState]
    actors: memoryview = memoryview(b"")
    """float64, rows of x, y, z (m), qx, qy, qz, qw: world_from_actor, in the scenario's order."""

    ruts: Ruts | msgspec.UnsetType = msgspec.UNSET
    """Left out while there are none."""

    def __post_init__(self) -> None:
        whole(self.actors, 7 * 8, "actors")

    @property
    def stamp_nanos(self) -> int:
        """The instant of this state on the run's time line."""
        return self.epoch_nanos + self.sim_nanos


class StateBatch(BusMessage, frozen=True):
    """States of consecutive ticks, for processes that do not need each at once."""

    states: tuple[State, ...]


class EncodedState(BusMessage, frozen=True):
    """A `State` whose vehicles are encoded; it has the same bytes."""

    run: str
    episode: int = msgspec.field(name="life")
    epoch_nanos: int
    tick: int
    sim_nanos: int
    world_hash: str
    vehicles: msgspec.Raw
    actors: memoryview
    ruts: Ruts | msgspec.UnsetType = msgspec.UNSET


class Clock(BusMessage, frozen=True):
    """Clock of the run, for ROS nodes that use sim time."""

    stamp_nanos: int
    epoch_nanos: int
    tick: int
    episode: int = msgspec.field(name="life")
    """See `State.episode`."""


class Command(BusMessage, frozen=True):
    """Velocity command for a vehicle, in its base frame (geometry_msgs/Twist)."""

    stamp_nanos: int
    """Time of the command. The command acts at the first tick after it."""

    linear_mps: Vector3
    angular_radps: Vector3


class WheelCommand(BusMessage, frozen=True):
    """Command for individual wheels. It acts at once, without acceleration limits."""

    stamp_nanos: int
    """See `Command.stamp_nanos`."""

    speeds_radps: dict[str, float]
    """Speed by name of driven wheel or track, forward > 0. Wheels that are left out stop."""

    angles_rad: dict[str, float] = {}
    """Angle by name of steered wheel, left > 0. Wheels that are left out point straight ahead."""


class Imu(Reading, frozen=True):
    """A sample of an inertial measurement unit, in the sensor's frame (REP 145)."""

    stamp_nanos: int
    frame: str
    orientation: Quaternion
    """world_from_sensor, xyzw."""

    angular_velocity_radps: Vector3
    linear_acceleration_mps2: Vector3
    """Specific force: a level unit at rest measures +9.80665 on z."""

    orientation_variance: float
    angular_velocity_variance: float
    linear_acceleration_variance: float


class PointCloud(Reading, frozen=True):
    """Points of a LiDAR revolution, or of a block of a revolution."""

    stamp_nanos: int
    """Time of the first firing, with or without a return."""

    frame: str
    points: memoryview
    """`POINT` records. Rays without a return have no record."""

    layout: CloudLayout = "velodyne"
    """Fields of the cloud in ROS."""

    def __post_init__(self) -> None:
        whole(self.points, POINT.itemsize, "points")

    def records(self) -> NDArray[np.void]:
        """Return the points as a structured array, shape (N,), dtype `POINT`."""
        return np.frombuffer(self.points, POINT)


class WheelEncoders(Reading, frozen=True):
    """64-bit counters of a vehicle's wheel encoders."""

    stamp_nanos: int
    frame: str
    names: tuple[str, ...]
    ticks: tuple[Int64, ...]


class Ack(BusMessage, frozen=True):
    """Acknowledgement: how far a process has followed physics."""

    episode: int = msgspec.field(name="life")
    """See `State.episode`."""

    tick: int
    """Newest state that the process has received; -1 for none."""

    settled_tick: int
    """Tick up to which the process has published everything. A successor resumes there."""

    memory: bytes = b""
    """Internal state of the process, for a successor that cannot compute it from later states. Its
    format is private to the process."""

    commanded: dict[str, int] = {}
    """By vehicle, the tick of the stamp of the newest command that the process has sent. Physics
    applies the acknowledgement when this command has arrived."""

    commands: dict[str, int] | msgspec.UnsetType = msgspec.UNSET
    """By vehicle, the number of commands with this stamp, where there are several."""


NOT_REPORTED = "not reported"
"""Text for a topic whose receiver sends no reports."""


class StreamReport(msgspec.Struct, frozen=True):
    """Delivery statistics of one topic between the gateway and the ROS side.

    `sent` = messages + missing + incomplete + late + dropped + in_flight.
    """

    topic: str
    type: str
    declared_hz: float | None
    measured_hz: float | None
    """Rate by stamps: (messages - 1) / (last stamp - first stamp)."""

    age_seconds: float | None
    """Median age of the last 10 s, from the instant of measurement to publication."""

    messages: int
    """Messages that the other end has published."""

    lost: int
    """Messages lost on the network: missing + incomplete + late."""

    direction: str = "to ROS"
    age_p99_seconds: float | None = None
    """99th percentile of the age."""

    sent: int = 0
    missing: int = 0
    """Messages of which no part arrived."""

    incomplete: int = 0
    """Messages that were given up because parts were missing."""

    late: int = 0
    """Complete messages that arrived after a newer one."""

    dropped: int = 0
    """Complete messages that were replaced by a newer one before publication, or that ROS refused.
    """

    in_flight: int = 0
    """Messages that are on the way, waiting at the other end, or not yet reported."""

    repaired: int = 0
    """Complete messages that needed repair."""

    superseded: int = 0
    """Messages that were replaced by a newer one before they were sent; not included in `sent`."""

    delivered_bytes: int = 0
    """Size of the bodies of the published messages."""

    reported: bool = True
    """False if the ROS side has never reported what arrives. In that case only `sent` (all of it
    `in_flight`) and `superseded` are known, and nothing counts as lost."""


class Health(BusMessage, frozen=True):
    """Health report of a process, once per second."""

    process: str
    pid: int
    tick: int
    counters: dict[str, int]
    streams: tuple[StreamReport, ...] = ()
    host: str = ""
    """Name of the machine that the process runs on."""


M = TypeVar("M", bound=BusMessage)

LARGE_BYTES = 1 << 16
"""Size above which an array is a piece of its own, and a message is passed by shared memory."""

_PLACEHOLDER = memoryview(os.urandom(16))
_ENCODED_PLACEHOLDER = msgspec.msgpack.encode(_PLACEHOLDER)
_BIN32, _BIN32_MARK = struct.Struct(">BI"), 0xC6
_ENCODER = msgspec.msgpack.Encoder()
_DECODERS: dict[type[BusMessage], msgspec.msgpack.Decoder[Any]] = {}


def encode(message: BusMessage) -> bytes:
    """Return a message as MessagePack."""
    return _ENCODER.encode(message)


def encode_in_pieces(message: BusMessage) -> tuple[bytes | memoryview, ...]:
    """Return a message as MessagePack in pieces, of which a large array is one, not copied."""
    large = [
        name
        for name in message.__struct_fields__
        if isinstance(array := getattr(message, name), memoryview) and len(array) > LARGE_BYTES
    ]
    if not large:
        return (encode(message),)
    around = copy(message)
    force_setattr(around, large[0], _PLACEHOLDER)
    before, _, after = encode(around).partition(_ENCODED_PLACEHOLDER)
    array = getattr(message, large[0])
    return before + _BIN32.pack(_BIN32_MARK, len(array)), array, after


def decode(payload: bytes | memoryview, message_type: type[M]) -> M:
    """Return the message in `payload`; its arrays are views into `payload`.

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
    """Return the float64 array of a bin, as a read-only view."""
    return np.frombuffer(packed, np.float64)


def packed(array: NDArray[Any]) -> memoryview:
    """Return an array's bytes for a bin field; a view if the array is contiguous."""
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data


class Relayed(BusMessage, frozen=True):
    """A ROS 2 message of a vehicle's stack, unchanged. `groundlink.ros.cdr` checks its CDR."""

    stamp_nanos: int
    """Run time of its arrival. The stamp of its publisher is in the message."""

    ros_type: str
    """ROS type, such as nav_msgs/msg/Path."""

    cdr: memoryview
    """CDR with its encapsulation header."""
