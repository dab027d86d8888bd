# SPDX-License-Identifier: Apache-2.0
"""The messages behind the vectors of one type each, and how those vectors were made.

``python -m tests.vectors.examples`` writes the `.bin` and `.json` of those that are not there yet;
a vector that exists is never written again. The body is the message's CDR, sent in datagrams of 256
bytes so that every type has parts; `fields` in the JSON is the ROS message, numbers as they are.
"""

import hashlib
import json
import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from groundlink.core.clock import NANOS
from groundlink.messages import imagery, navigation
from groundlink.messages.base import BusMessage, packed
from groundlink.ros.cdr import ROS_CODECS, to_cdr
from groundlink.ros.types import STORE, header, pose, vector
from udp_bridge import Message as WireMessage
from udp_bridge import fragments
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.typed import pack_typed
from udp_bridge.wire.types import type_number

FOLDER = Path(__file__).parent
DATAGRAM_BYTES = 256
STAMP = 1_795_246_685_346_812_417

TURN = (0.0, 0.0, 0.6, 0.8)
COVARIANCE = packed(np.arange(36.0) / 8)


class Example(NamedTuple):
    """A vector's content."""

    type_name: str
    topic: str
    seq_number: int
    message: BusMessage


EXAMPLES = {
    "compressed-image": Example(
        *("CompressedImage", "/image/compressed", 3),
        imagery.CompressedImage(
            *(STAMP, "camera", "jpeg"), packed(np.arange(700, dtype=np.uint16).astype(np.uint8))
        ),
    ),
    "nav-sat-fix": Example(
        *("NavSatFix", "/fix", 4),
        navigation.NavSatFix(
            *(STAMP, "gps_link", 1, 9, 50.2887, 18.6774, 246.5),
            *(packed(np.diag([1.5, 1.5, 6.25])), 2),
        ),
    ),
    "range": Example(
        *("Range", "/sonar/front", 5),
        imagery.Range(STAMP, "sonar_link", "infrared", 0.5, 0.25, 4.0, 1.5, 0.0625),
    ),
    "pose": Example(
        *("PoseStamped", "/pose", 6),
        navigation.PoseStamped(STAMP, "map", (1.5, -2.25, 0.125), TURN),
    ),
    "map": Example(
        *("OccupancyGrid", "/map", 7),
        navigation.OccupancyGrid(
            *(STAMP, "map", STAMP - NANOS, 0.25, 30, 20, (-3.75, -2.5, 0.0)),
            *((0.0, 0.0, 0.0, 1.0), packed((np.arange(600) % 102 - 1).astype(np.int8))),
        ),
    ),
    "laser-scan": Example(
        *("LaserScan", "/scan", 8),
        imagery.LaserScan(
            *(STAMP, "laser_link", -1.5, 0.0625, 0.0001220703125, 0.125, 0.25, 30.0),
            packed(np.append(np.arange(48) / 4, np.inf).astype(np.float32)),
            packed((np.arange(49) * 2).astype(np.float32)),
        ),
    ),
    "image": Example(
        *("Image", "/image", 9),
        imagery.Image(
            *(STAMP, "camera", 12, 16, "rgb8", 48),
            packed((np.arange(576) % 251).astype(np.uint8)),
        ),
    ),
    "camera-info": Example(
        *("CameraInfo", "/camera_info", 10),
        imagery.CameraInfo(
            *(STAMP, "camera", 480, 640, "plumb_bob"),
            packed(np.array([-0.25, 0.125, 0.0, 0.0, 0.0])),
            packed(np.array([500.0, 0, 320, 0, 500, 240, 0, 0, 1])),
            packed(np.eye(3)),
            packed(np.array([500.0, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0])),
        ),
    ),
    "transforms": Example(
        *("TFMessage", "/tf", 11),
        navigation.Transforms(
            (
                navigation.Transform(STAMP - 5, "odom", "base_link", (1.5, -2.25, 0.125), TURN),
                navigation.Transform(STAMP, "base_link", "mast", (0, 0, 0.5), (0, 0, 0, 1)),
            )
        ),
    ),
    "odometry": Example(
        *("Odometry", "/odom", 12),
        navigation.Odometry(
            *(STAMP, "odom", "base_link", (1.5, -2.25, 0.125), TURN),
            *((0.5, 0.0, -0.125), (0.0, 0.0625, 0.25), COVARIANCE, COVARIANCE),
        ),
    ),
    "joint-state": Example(
        *("JointState", "/joint_states", 13),
        navigation.JointState(
            *(STAMP, "", ("front_left", "front_right")),
            *(packed(np.array([0.5, -0.25])), packed(np.array([2.0, -2.0])), memoryview(b"")),
        ),
    ),
    "text": Example(
        *("String", "/robot_description", 15), navigation.Text(STAMP, '<robot name="r\u00f6ver"/>')
    ),
}
SUBSCRIBE = Subscribe(type_number("Odometry"), 1, 3, 10.0)


def plain(value: Any) -> Any:
    """Return a ROS message of rosbags as JSON has it; what is not finite as a word."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list):
        return [plain(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        names = [name for name in value.__dataclass_fields__ if name != "__msgtype__"]
        return {name: plain(getattr(value, name)) for name in names}
    return str(value) if isinstance(value, float) and abs(value) == float("inf") else value


def fields(body: bytes, message_type: type[BusMessage]) -> Any:
    """Return what rosbags reads in a body."""
    return plain(STORE.deserialize_cdr(body, ROS_CODECS[message_type].ros_type))


def _write(
    name: str, type_name: str, topic: str, link: str, number: int, body: bytes, meaning: Any
) -> None:
    if (FOLDER / f"{name}.bin").exists():
        return
    message = WireMessage(type_number(type_name), topic, link, STAMP, number, body)
    datagrams = [header + bytes(part) for header, part in fragments(message, DATAGRAM_BYTES)]
    sec, nsec = divmod(STAMP, NANOS)
    row = {
        "body_sha256": hashlib.sha256(body).hexdigest(),
        "body_size": len(body),
        "fields": meaning,
        "link": link,
        "msg_type": message.msg_type,
        "parts": len(datagrams),
        "seq_number": number,
        "time_nsec": nsec,
        "time_sec": sec,
        "topic": topic,
    }
    (FOLDER / f"{name}.bin").write_bytes(
        b"".join(struct.pack("<I", len(datagram)) + datagram for datagram in datagrams)
    )
    text = json.dumps({"messages": [row]}, indent=1, sort_keys=True)
    (FOLDER / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def main() -> None:
    """Write the vectors that are not there."""
    for name, (type_name, topic, number, message) in EXAMPLES.items():
        body, link = bytes(to_cdr(message)), getattr(message, "frame", "")
        _write(name, type_name, topic, link, number, body, fields(body, type(message)))
    _write("subscribe", "Subscribe", "/odom", "", 14, SUBSCRIBE.pack(), SUBSCRIBE._asdict())

    def message_of(ros_type: str, frame: str, **parts: Any) -> tuple[bytes, Any]:
        """Return a message that no process sends, as CDR and as JSON has it."""
        message = STORE.types[ros_type](header=header(STAMP, frame), **parts)
        return bytes(STORE.serialize_cdr(message, ros_type)), plain(message)

    twist = STORE.types["geometry_msgs/msg/Twist"](
        linear=vector((0.5, 0, 0)), angular=vector((0, 0, -1.25))
    )
    stamped = message_of("geometry_msgs/msg/TwistStamped", "base_link", twist=twist)
    _write("twist-stamped", "TwistStamped", "/cmd_vel", "base_link", 16, *stamped)
    pose_stamped = STORE.types["geometry_msgs/msg/PoseStamped"]
    plan = [
        pose_stamped(header=header(STAMP, "map"), pose=pose((x, x / 2, 0.0), TURN))
        for x in (0.5, 1.0, 1.5, 2.0)
    ]
    path = message_of("nav_msgs/msg/Path", "map", poses=plan)
    _write("path", "Path", "/plan", "map", 17, *path)
    magnetic = "sensor_msgs/msg/MagneticField"
    body, meaning = message_of(
        *(magnetic, "imu_link"),
        magnetic_field=vector((1.9e-05, -2.5e-06, 4.5e-05)),
        magnetic_field_covariance=np.arange(9.0),
    )
    typed = pack_typed(magnetic, body), {"ros_type": magnetic, "message": meaning}
    _write("magnetic-field", "Typed", "/magnetic_field", "imu_link", 18, *typed)


if __name__ == "__main__":
    main()
