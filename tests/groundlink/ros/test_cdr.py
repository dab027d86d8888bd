# SPDX-License-Identifier: Apache-2.0
"""Messages of the bus become ROS messages, byte for byte, and those from ROS come back."""

import json
import math
import os
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from groundlink.bus.shared_slots import SharedBlock, SlotPool, SlotReader
from groundlink.messages.base import (
    LARGE_BYTES,
    POINT,
    BadBusMessage,
    BusMessage,
    Clock,
    Command,
    Imu,
    PointCloud,
    Relayed,
    decode,
    encode_in_pieces,
    packed,
)
from groundlink.messages.imagery import CompressedImage, Image, Range
from groundlink.messages.navigation import JointState, OccupancyGrid, Odometry, PoseStamped
from groundlink.ros.cdr import READERS, ROS_CODECS, reader, to_cdr
from groundlink.ros.types import STORE, TYPES
from groundlink.scenario.ros_side import RosType
from tests.udp_bridge.vectors import FOLDER, load
from tests.vectors.examples import EXAMPLES, SUBSCRIBE, fields
from udp_bridge import Reassembler
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.types import MSG_TYPES, NUMBER_OF_ROS_TYPE

ROS = Path(__file__).resolve().parents[3] / "ros"
OLDER_STORE = get_typestore(Stores.ROS2_JAZZY)
INCOMING = ("pose", "odometry", "map")
TWIST = "geometry_msgs/msg/Twist"
PATH = "nav_msgs/msg/Path"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"


def body(name: str) -> bytes:
    reassembler = Reassembler()
    messages = [reassembler.receive(datagram, "", 0) for datagram in load(name).datagrams]
    assert messages[-1] is not None
    return bytes(messages[-1].body)


@pytest.mark.parametrize("name", EXAMPLES)
def test_bytes_are_those_of_the_vector(name: str) -> None:
    assert bytes(to_cdr(EXAMPLES[name].message)) == body(name)


@given(
    frame=st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=20),
    stamp=st.integers(0, 2**31 * 10**9 - 1),
    numbers=st.lists(st.floats(allow_nan=False), min_size=13, max_size=13),
)
def test_what_a_codec_packs_is_what_the_type_store_writes(
    frame: str, stamp: int, numbers: list[float]
) -> None:
    message = Imu(
        *(stamp, frame, tuple(numbers[:4]), tuple(numbers[4:7]), tuple(numbers[7:10])),
        *numbers[10:],
    )
    codec = ROS_CODECS[Imu]
    written = STORE.serialize_cdr(TYPES[codec.ros_type](**codec.encode(message)), codec.ros_type)
    assert codec.pack is not None
    assert codec.pack(message) == bytes(written)


PIXELS = packed(np.arange(2 * LARGE_BYTES, dtype=np.uint8))


@pytest.mark.parametrize(
    ("message", "in_place"),
    [
        (Image(10, "a camera", 1, len(PIXELS), "mono8", len(PIXELS), PIXELS), True),
        (CompressedImage(10, "c", "jpeg", PIXELS), True),
        (PointCloud(8, "lidar", packed(np.zeros(9000, POINT)), clock_error_nanos=1), True),
        (PointCloud(8, "lidar", packed(np.zeros(9000, POINT)), layout="ouster"), False),
        (OccupancyGrid(1, "map", 1, 1.0, 512, 256, (0, 0, 0), (0, 0, 0, 1), PIXELS), False),
    ],
)
def test_large_arrays_in_shared_memory_are_not_copied(message: BusMessage, in_place: bool) -> None:
    frame = SlotPool().write(encode_in_pieces(message))
    assert frame is not None
    assert frame.file is not None
    payload = SlotReader().payload(frame.content, [os.dup(frame.file)])
    assert payload is not None
    received = decode(payload, type(message))
    for _ in range(2):
        cdr = to_cdr(received)
        assert cdr == to_cdr(message)
        assert isinstance(cdr.obj, SharedBlock) == in_place


@pytest.mark.parametrize("name", EXAMPLES)
def test_fields_are_those_of_the_vector(name: str) -> None:
    meaning = json.loads((FOLDER / f"{name}.json").read_text())["messages"][0]["fields"]
    assert fields(body(name), type(EXAMPLES[name].message)) == meaning


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of what rclpy imports
@pytest.mark.parametrize("name", EXAMPLES)
def test_ros_itself_reads_and_writes_the_same(name: str) -> None:
    serialization = pytest.importorskip("rclpy.serialization", reason="no ROS 2 here")
    package, kind, type_name = ROS_CODECS[type(EXAMPLES[name].message)].ros_type.split("/")
    message_class = getattr(import_module(f"{package}.{kind}"), type_name)
    message = serialization.deserialize_message(body(name), message_class)
    # Behind an empty sequence of float64 rclpy leaves the gap before numbers that are not there.
    again = serialization.serialize_message(message)[: len(body(name))]
    message_type = type(EXAMPLES[name].message)
    assert fields(again, message_type) == fields(body(name), message_type)


def test_subscribe_vector_matches_its_json() -> None:
    assert Subscribe.parse(body("subscribe")) == SUBSCRIBE


def test_definitions_are_those_of_the_packages_for_ros() -> None:
    files = [*ROS.glob("groundlink_msgs/msg/*.msg"), *ROS.glob("vision_msgs/msg/*.msg")]
    known = {f"{file.parts[-3]}/msg/{file.stem}": file.read_text() for file in files}
    packages = ("groundlink_msgs/", "vision_msgs/")
    assert known.keys() == {name for name in STORE.types if name.startswith(packages)}
    for name, text in known.items():
        assert get_types_from_msg(text, name)[name] == STORE.fielddefs[name]


def test_every_type_of_the_wire_is_on_the_bus() -> None:
    of_ros = set(NUMBER_OF_ROS_TYPE)
    of_bus = {form.ros_type for form in ROS_CODECS.values()}
    by_name = {kind for kind in of_bus if kind.startswith("vision_msgs/")}
    assert of_ros == of_bus - by_name | {TWIST, TWIST_STAMPED, PATH}
    from_ros = {
        name
        for name, number in NUMBER_OF_ROS_TYPE.items()
        if MSG_TYPES[number].direction != "to ROS"
    }
    assert from_ros == {*READERS, PATH}
    requestable = {name.replace("/", "/msg/") for name in get_args(RosType)}
    assert requestable == of_ros - {"rosgraph_msgs/msg/Clock"}


def test_relayed_bytes_are_unchanged_if_the_type_matches() -> None:
    read = reader(Relayed, PATH)
    assert read(body("path"), 7) == Relayed(7, PATH, memoryview(body("path")))
    assert bytes(to_cdr(read(body("path"), 7))) == body("path")
    for wrong_one in (body("path")[:-9], b"", body("pose")):
        with pytest.raises(BadBusMessage, match="not a nav_msgs/msg/Path"):
            read(wrong_one, 7)


@pytest.mark.parametrize("name", INCOMING)
def test_messages_round_trip(name: str) -> None:
    message = EXAMPLES[name].message
    assert READERS[ROS_CODECS[type(message)].ros_type](body(name), 1) == message


@pytest.mark.parametrize(
    "message",
    [
        Clock(2**62, 0, 0, 0),
        Range(0, "f", "infrared", 1e300, 0.0, 1.0, 0.5, 0.0),
    ],
    ids=["a stamp after 2038", "beyond float32"],
)
def test_values_outside_ros_types_are_refused(message: BusMessage) -> None:
    with pytest.raises(BadBusMessage, match=r"no .* holds this"):
        to_cdr(message)


def wrong(message: Any, **changes: Any) -> bytes:
    """Return a message's body with values that the schema of the bus has no word against."""
    plain = {name: getattr(message, name) for name in message.__struct_fields__}
    return bytes(to_cdr(type(message)(**(plain | changes))))


POSE, ODOMETRY, MAP = (EXAMPLES[name].message for name in INCOMING)
BAD_COVARIANCE = packed(np.full(36, np.nan))
REFUSED = [
    (POSE, wrong(POSE, position_m=(0.0, math.nan, 0.0)), "finite"),
    (POSE, wrong(POSE, orientation=(0.0, 0.0, 0.0, 0.0)), "orientation"),
    (POSE, wrong(POSE, orientation=(math.inf, 0.0, 0.0, 0.0)), "orientation"),
    (POSE, wrong(POSE, frame="x" * 300), "frame"),
    (ODOMETRY, wrong(ODOMETRY, linear_mps=(math.inf, 0.0, 0.0)), "finite"),
    (ODOMETRY, wrong(ODOMETRY, twist_covariance=BAD_COVARIANCE), "finite"),
    (ODOMETRY, wrong(ODOMETRY, child_frame="x" * 300), "frame"),
    (MAP, wrong(MAP, resolution_m=math.nan), "finite"),
    (MAP, wrong(MAP, resolution_m=0.0), "resolution"),
    (MAP, wrong(MAP, origin_orientation=(0.0, 0.0, 0.0, 2.0)), "orientation"),
]


@pytest.mark.parametrize(("message", "bad", "why"), REFUSED, ids=lambda x: str(x)[:20])
def test_what_makes_no_sense_is_refused(message: BusMessage, bad: bytes, why: str) -> None:
    with pytest.raises(BadBusMessage, match=why):
        READERS[ROS_CODECS[type(message)].ros_type](bad, 0)


def test_a_map_whose_sizes_disagree_is_refused() -> None:
    store = OLDER_STORE
    grid: Any = store.deserialize_cdr(body("map"), "nav_msgs/msg/OccupancyGrid")
    for width in (29, 31, 2**32 - 1):
        info = replace(grid.info, width=width)
        bad = store.serialize_cdr(replace(grid, info=info), "nav_msgs/msg/OccupancyGrid")
        with pytest.raises(BadBusMessage, match="cells"):
            READERS["nav_msgs/msg/OccupancyGrid"](bad, 0)


def test_an_orientation_of_few_digits_becomes_unit_length() -> None:
    rough = wrong(POSE, orientation=(0.0, 0.0, 0.601, 0.8))
    pose = READERS["geometry_msgs/msg/PoseStamped"](rough, 0)
    assert isinstance(pose, PoseStamped)
    assert math.hypot(*pose.orientation) == pytest.approx(1.0, abs=1e-12)


@given(data=st.data(), ros_type=st.sampled_from(sorted({*READERS, PATH})))
def test_garbled_bodies_raise_nothing_else(data: st.DataObject, ros_type: str) -> None:
    whole = {
        "geometry_msgs/msg/PoseStamped": body("pose"),
        "nav_msgs/msg/Odometry": body("odometry"),
        "nav_msgs/msg/OccupancyGrid": body("map"),
        PATH: body("path"),
        TWIST: b"\0\1\0\0" + bytes(48),
        TWIST_STAMPED: body("twist-stamped"),
        "sensor_msgs/msg/JointState": body("joint-state"),
    }[ros_type]
    garbled = bytearray(whole)
    for _ in range(data.draw(st.integers(0, 4))):
        at = data.draw(st.integers(0, max(0, len(garbled) - 1)))
        garbled[at : at + data.draw(st.integers(0, 8))] = data.draw(st.binary(max_size=8))
    cut = data.draw(st.integers(0, len(garbled)))
    read = READERS.get(ros_type) or reader(Relayed, ros_type)
    try:
        message = read(bytes(garbled[cut:] if data.draw(st.booleans()) else garbled), 7)
    except BadBusMessage:
        return
    assert isinstance(
        message, Command | JointState | PoseStamped | Odometry | OccupancyGrid | Relayed
    )
