# SPDX-License-Identifier: Apache-2.0
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundlink.episode.fault_messages import Faults
from groundlink.messages import base as messages
from groundlink.messages import ground_truth, imagery, navigation
from groundlink.messages.base import (
    POINT,
    BadBusMessage,
    BusMessage,
    Relayed,
    all_messages,
    decode,
    encode,
    packed,
)
from groundlink.messages.ground_truth import BatteryState, Contact, Vitals
from groundlink.messages.missing_readings import MissingReadings, MissingSpan
from groundlink.scenario.faults import Bias, Stuck
from groundlink.world.ruts import TILE

TRUE_POINTS = np.zeros(2, ground_truth.TRUE_POINT)
TRUE_POINTS["z"], TRUE_POINTS["body"] = [1.5, -2], [0, 2**32 - 1]
LABELED_POINTS = np.zeros(2, ground_truth.LABELED_POINT)
LABELED_POINTS["z"], LABELED_POINTS["instance"] = [1.5, -2], [0, 65535]
POINTS = np.zeros(3, POINT)
POINTS["x"], POINTS["ring"], POINTS["time"] = [1.5, -2, 3], [0, 7, 65535], [0, 0.05, 0.1]

VEHICLE = messages.VehicleState(
    link_poses=packed(np.arange(14.0).reshape(2, 7)),
    base_velocity=packed(np.arange(6.0)),
    joint_positions=packed(np.array([1e3, -1e-3])),
    joint_velocities=packed(np.array([0.5, 0.25])),
)
REPORT = messages.StreamReport(
    topic="/points",
    type="sensor_msgs/msg/PointCloud2",
    declared_hz=10.0,
    measured_hz=None,
    age_seconds=0.01,
    messages=99,
    lost=1,
)
CHARGE = BatteryState(0.75, 25.5, 12.0)
COVARIANCE = packed(np.arange(36.0))
STATE = messages.State("run", 10**18, 10**18, 400, 10**9, "ab" * 32, {"rover": VEHICLE})
EXAMPLES: list[BusMessage] = [
    STATE,
    messages.StateBatch((STATE, STATE)),
    messages.State("run", 0, 0, 0, 0, "", {}, memoryview(bytes(2 * 7 * 8))),
    messages.State("run", 0, 0, 0, 0, "", {}, ruts=messages.Ruts(b"12345678")),
    messages.State(
        *("run", 0, 0, 0, 0, "", {}),
        ruts=messages.Ruts(b"12345678", bytes(8), packed(np.zeros(2, TILE))),
    ),
    messages.Clock(2**62, 2**61, 3, 2**61),
    messages.Command(5, (0.5, 0.0, 0.0), (0.0, 0.0, -1.0)),
    messages.WheelCommand(5, {"left_track": 1.5}, {"front_left_wheel": -0.1}),
    messages.Imu(7, "imu", (0.0, 0.0, 0.0, 1.0), (1.0, 2.0, 3.0), (0.0, 0.0, 9.8), 0.0, 1e-9, 1.0),
    messages.PointCloud(8, "lidar", packed(POINTS)),
    messages.PointCloud(8, "lidar", packed(POINTS[:0])),
    messages.WheelEncoders(9, "base", ("left", "right"), (2**63 - 1, -(2**63))),
    imagery.Image(10, "camera", 2, 3, "rgb8", 9, packed(np.arange(18, dtype=np.uint8))),
    imagery.CompressedImage(11, "camera", "jpeg", packed(np.arange(7, dtype=np.uint8))),
    imagery.CameraInfo(
        *(12, "camera", 480, 640, "plumb_bob", packed(np.arange(5.0)), packed(np.eye(3))),
        *(packed(np.eye(3)), packed(np.eye(3, 4))),
    ),
    imagery.LaserScan(
        *(13, "laser", -1.5, 0.5, 1e-4, 0.1, 0.1, 30.0),
        *(packed(np.float32([1, 2, np.inf])), packed(np.float32([3, 4, 0]))),
    ),
    imagery.LaserScan(13, "laser", 0.0, 0.5, 0.0, 0.1, 0.1, 30.0, memoryview(b""), memoryview(b"")),
    imagery.Range(14, "sonar", "ultrasound", 0.5, 0.25, 4.0, 1.5, 0.0),
    imagery.RadarDetections(14, "radar", packed(np.zeros(2, imagery.RADAR_POINT))),
    navigation.PoseStamped(15, "map", (1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8)),
    navigation.Odometry(
        *(16, "odom", "base_link", (1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8)),
        *((0.5, 0.0, 0.0), (0.0, 0.0, 0.25), COVARIANCE, COVARIANCE),
    ),
    navigation.OccupancyGrid(
        *(17, "map", 5, 0.25, 3, 2, (-1.0, -2.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
        packed(np.array([0, 100, -1, 50, 0, 1], np.int8)),
    ),
    navigation.Transforms(
        (
            navigation.Transform(18, "odom", "base", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
            navigation.Transform(17, "base", "arm", (0.0, 0.0, 1.0), (0.6, 0.0, 0.0, 0.8)),
        )
    ),
    navigation.JointState(
        *(19, "", ("left", "right"), packed(np.array([0.5, 0.25]))),
        *(packed(np.array([1.0, -1.0])), memoryview(b"")),
    ),
    navigation.Text(20, "<robot/>"),
    navigation.NavSatFix(20, "gps", 0, 9, 50.25, 18.5, 250.0, packed(np.diag([1.0, 1.0, 4.0])), 2),
    ground_truth.TruePoints(8, "lidar", packed(TRUE_POINTS)),
    ground_truth.LabeledPoints(8, "lidar", packed(LABELED_POINTS)),
    ground_truth.LabelTable(8, "lidar", ("table", "chair"), packed(np.uint16([5, 65535]))),
    ground_truth.Detections2D(
        *(10, "camera", ("table_1", "rover"), packed(np.uint16([5, 32]))),
        *(packed(np.array([0.25, 1.0])), packed(np.arange(8.0))),
    ),
    ground_truth.Detections3D(
        *(10, "camera", ("table_1",), packed(np.uint16([5])), packed(np.array([0.25]))),
        packed(np.arange(10.0)),
        clock_error_nanos=-7,
    ),
    ground_truth.Bodies(21, ("rover/base_link", "wall"), packed(np.arange(14.0))),
    Relayed(22, "nav_msgs/msg/Path", memoryview(bytes(24))),
    messages.Ack(10, 11, -1, b"7", {"rover": 10}),
    messages.Health("gateway", 4321, 400, {"refused": 0}, (REPORT,), "a-host"),
    Vitals(
        *(21, "rover", 40, 12.5, 0.25, (Contact("table_3_leg_1", 337.5, 39, 7),), CHARGE),
        (ground_truth.WheelInSoil("front_left_wheel", 0.2, 0.035),),
        ground_truth.InWater(0.45, True),
    ),
    Faults(22, "rover/imu", 40, (Stuck(at_s=0.1), Bias(value=(0.0, 0.5, 0.0), for_s=2.0))),
    MissingReadings(
        23, "rover/camera", (MissingSpan("overloaded", 7, 21, 3, ("", "camera_info")),)
    ),
    messages.WheelEncoders(9, "base", ("left",), (1,), clock_error_nanos=-5),
]
NAMES = [type(example).__name__ for example in EXAMPLES]
TYPES = sorted(all_messages(), key=lambda t: t.__name__)


def read(payload: bytes, message_type: type[BusMessage]) -> None:
    """Decode and look at all of it: only `BadBusMessage` may come of it."""
    try:
        message = decode(payload, message_type)
    except BadBusMessage:
        return
    if isinstance(message, messages.State):
        for vehicle in message.vehicles.values():
            assert vehicle.poses().shape[1] == 7
            assert messages.floats(vehicle.joint_positions).dtype == np.float64
    if isinstance(message, ground_truth.Bodies):
        assert message.world_from_body().shape == (len(message.names), 7)
    if isinstance(message, ground_truth.TruePoints):
        assert message.records().dtype == ground_truth.TRUE_POINT
    if isinstance(message, ground_truth.LabeledPoints):
        assert message.records().dtype == ground_truth.LABELED_POINT
    if isinstance(message, imagery.RadarDetections):
        assert message.records().dtype == imagery.RADAR_POINT
    if isinstance(message, messages.PointCloud):
        assert message.records().dtype == POINT
    encode(message)


def test_every_message_has_an_example() -> None:
    assert {type(example) for example in EXAMPLES} == all_messages()


@pytest.mark.parametrize("message", EXAMPLES, ids=NAMES)
def test_they_come_back_as_they_went(message: BusMessage) -> None:
    payload = encode(message)
    assert decode(payload, type(message)) == message
    assert decode(memoryview(bytearray(payload)), type(message)) == message
    assert encode(decode(payload, type(message))) == payload


LARGE = packed(np.arange(22 * messages.LARGE_BYTES, dtype=np.uint8))


@pytest.mark.parametrize(
    ("message", "pieces"),
    [
        (messages.PointCloud(8, "lidar", LARGE, layout="ouster", clock_error_nanos=5), 3),
        (imagery.Image(10, "camera", 1, 3, "rgb8", len(LARGE), LARGE), 3),
        (messages.PointCloud(8, "lidar", packed(POINTS)), 1),
        (STATE, 1),
    ],
)
def test_pieces_are_those_of_the_message(message: BusMessage, pieces: int) -> None:
    found = messages.encode_in_pieces(message)
    assert len(found) == pieces
    assert b"".join(found) == encode(message)
    assert pieces == 1 or found[1].obj is LARGE.obj, "the array was copied"  # type: ignore[union-attr]


def test_arrays_are_read_in_place() -> None:
    payload = encode(messages.PointCloud(8, "lidar", packed(POINTS)))
    cloud = decode(payload, messages.PointCloud)
    assert (cloud.records() == POINTS).all()
    assert cloud.points.obj is payload
    poses = VEHICLE.poses()
    assert poses.tolist() == np.arange(14.0).reshape(2, 7).tolist()
    assert not poses.flags.owndata


ARRAYS = {
    "none": np.empty(0),
    "no_rows": np.empty((0, 7)),
    "strided": np.arange(12.0).reshape(3, 4)[:, ::2],
    "transposed": np.arange(12.0).reshape(3, 4).T,
    "scalar": np.array(1.0),
    "points": POINTS,
    "strided_points": POINTS[::2],
    "no_points": POINTS[:0],
}


@pytest.mark.parametrize("array", ARRAYS.values(), ids=ARRAYS)
def test_any_array_can_be_packed(array: Any) -> None:
    assert bytes(packed(array)) == array.tobytes()


@pytest.mark.parametrize(
    ("field", "size"),
    [
        ("link_poses", 7 * 8),
        ("base_velocity", 6 * 8),
        ("joint_positions", 8),
        ("joint_velocities", 8),
    ],
)
@pytest.mark.parametrize("off", [1, -1])
def test_a_bin_of_a_wrong_length_is_refused_by_name(field: str, size: int, off: int) -> None:
    document = msgspec.msgpack.decode(encode(EXAMPLES[0]))
    document["vehicles"]["rover"][field] = bytes(size + off)
    with pytest.raises(BadBusMessage, match=f"`{field}` has {size + off} bytes, .* of {size}"):
        decode(msgspec.msgpack.encode(document), messages.State)


def test_a_cloud_with_half_a_point_is_refused() -> None:
    document = {"stamp_nanos": 1, "frame": "f", "points": bytes(33)}
    with pytest.raises(BadBusMessage, match="`points` has 33 bytes, expected a multiple of 22"):
        decode(msgspec.msgpack.encode(document), messages.PointCloud)


OF_ANY_SIZE = messages.State | messages.PointCloud | imagery.CompressedImage | Relayed
LENGTHS = [
    (type(example), field, len(value))
    for example in EXAMPLES
    if not isinstance(example, OF_ANY_SIZE)
    for field in example.__struct_fields__
    if isinstance(value := getattr(example, field), memoryview) and len(value)
]


@pytest.mark.parametrize(("message_type", "field", "size"), LENGTHS)
@pytest.mark.parametrize("off", [1, -1])
def test_an_array_that_disagrees_with_its_message_is_refused(
    message_type: type[BusMessage], field: str, size: int, off: int
) -> None:
    example = next(e for e in EXAMPLES if type(e) is message_type)
    document = msgspec.msgpack.decode(encode(example))
    document[field] = bytes(size + off)
    with pytest.raises(BadBusMessage, match=f"`{field}` has {size + off} bytes, expected"):
        decode(msgspec.msgpack.encode(document), message_type)


def test_counters_beyond_64_bits_are_refused() -> None:
    document = {"stamp_nanos": 1, "frame": "f", "names": ["w"], "ticks": [2**63]}
    with pytest.raises(BadBusMessage, match=r"not a WheelEncoders: .*ticks"):
        decode(msgspec.msgpack.encode(document), messages.WheelEncoders)


@pytest.mark.parametrize("message", EXAMPLES, ids=NAMES)
def test_every_cut_is_refused(message: BusMessage) -> None:
    payload = encode(message)
    for end in range(len(payload)):
        with pytest.raises(BadBusMessage):
            decode(payload[:end], type(message))
    with pytest.raises(BadBusMessage):
        decode(payload + b"\x00", type(message))


HAVE_DEFAULTS = {("Health", "streams"), ("Health", "host")} | {
    ("Ack", "memory"),
    ("Ack", "commanded"),
    ("Ack", "commands"),
    ("Vitals", "battery"),
    ("Vitals", "soil"),
    ("Vitals", "water"),
    ("WheelCommand", "angles_rad"),
    ("State", "actors"),
    ("State", "ruts"),
    ("PointCloud", "layout"),
}


@pytest.mark.parametrize("message", EXAMPLES, ids=NAMES)
def test_a_missing_field_is_refused(message: BusMessage) -> None:
    document = msgspec.msgpack.decode(encode(message))
    for field in message.__struct_encode_fields__:
        if (type(message).__name__, field) in HAVE_DEFAULTS or field == "clock_error_nanos":
            continue
        rest = {name: value for name, value in document.items() if name != field}
        with pytest.raises(BadBusMessage, match=f"`{field}`"):
            decode(msgspec.msgpack.encode(rest), type(message))


@pytest.mark.parametrize("message_type", TYPES, ids=lambda t: t.__name__)
@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xc1",
        b"\xc0",
        b"\x80",
        b"\x81\xa1\xff\xc0",
        b"\x81\xa1x" + b"\x91" * 100_000,
        b"\x81\xa1x" * 100_000,
        b"\xdf\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        b"\x81\xa1x\xd7\xff" + b"\xff" * 8,
    ],
    ids=lambda p: p[:6].hex() or "nothing",
)
def test_spiteful_bytes_are_refused(message_type: type[BusMessage], payload: bytes) -> None:
    with pytest.raises(BadBusMessage):
        decode(payload, message_type)


@given(payload=st.binary(max_size=200), message_type=st.sampled_from(TYPES))
def test_arbitrary_bytes_raise_nothing_else(payload: bytes, message_type: type[BusMessage]) -> None:
    read(payload, message_type)


@given(data=st.data(), example=st.integers(0, len(EXAMPLES) - 1))
def test_garbled_messages_raise_nothing_else(data: st.DataObject, example: int) -> None:
    message = EXAMPLES[example]  # Not sampled: it cannot be hashed.
    payload = bytearray(encode(message))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(payload) - 1))
        length = data.draw(st.integers(0, 3))
        payload[at : at + length] = data.draw(st.binary(max_size=4))
        if not payload:
            return
    read(bytes(payload), type(message))


@given(
    payload=st.recursive(
        st.none()
        | st.booleans()
        | st.integers(-(2**63), 2**64 - 1)
        | st.floats()
        | st.text()
        | st.binary(max_size=60),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(
                st.sampled_from(["stamp_nanos", "frame", "points", "ticks", "vehicles", "tick"]),
                inner,
            )
        ),
        max_leaves=10,
    ),
    message_type=st.sampled_from(TYPES),
)
def test_other_messagepack_raises_nothing_else(
    payload: Any, message_type: type[BusMessage]
) -> None:
    read(msgspec.msgpack.encode(payload), message_type)
