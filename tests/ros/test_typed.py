# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS types that have no number of their own, through the ROS 2 node both ways."""

from tests.udp_bridge.vectors import load
from udp_bridge import Reassembler
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.typed import pack_typed, parse_typed
from udp_bridge.wire.types import SUBSCRIBE, TYPED

from .bodies import NANOS
from .conftest import RELIABLE, FarEnd, Ros
from .waiting import wait_until

MAGNETIC = "sensor_msgs/msg/MagneticField"
TOPIC = "/magnetic_field"


def magnetic_cdr() -> bytes:
    """Return the CDR in the vector."""
    (datagram,) = load("magnetic-field").datagrams
    message = Reassembler().receive(datagram, "", 0)
    assert message is not None
    return bytes(message.body[parse_typed(message.body).offset :])


def test_a_type_without_a_number_is_published_by_its_name(ros: Ros, bridge: FarEnd) -> None:
    listener = ros.listen((MAGNETIC, TOPIC, RELIABLE))
    cdr = magnetic_cdr()
    bridge.reach(listener, TYPED, TOPIC, pack_typed(MAGNETIC, cdr))
    assert bytes.fromhex(listener.messages(TOPIC)[0][1])[: len(cdr)] == cdr


def test_missing_type_is_reported_once_and_counted(ros: Ros) -> None:
    process, address = ros.bridge()
    far_end = FarEnd(address)
    for _ in range(3):
        far_end.send(TYPED, "/pose", NANOS, pack_typed("no_such_msgs/msg/Thing", b"\0\1\0\0"))
        far_end.send(TYPED, "/time", NANOS, pack_typed("json/msg/Thing", b"\0\1\0\0"))
    far_end.send(TYPED, "/other", NANOS, b"\x03no")
    process.wait_for("/time: json/msg/Thing can't be published: ROS package json is not")
    far_end.close()
    process.end()
    line = (
        "/pose: no_such_msgs/msg/Thing can't be published: ROS package no_such_msgs is not"
        " installed. Fix: install ros-"
    )
    assert process.output.count(line) == 1
    assert "not published, by reason: type_name 1, type_not_installed 6" in process.output
    assert process.output.endswith("refused 7")


def test_a_topic_is_requested_whatever_its_type(ros: Ros, bridge: FarEnd) -> None:
    cdr = magnetic_cdr()
    ros.start("-m", "tests.ros.replayer", MAGNETIC, TOPIC, cdr.hex())

    def arrives() -> bool:
        bridge.send(SUBSCRIBE, TOPIC, 0, Subscribe(TYPED, lease_s=30).pack())
        return bool(bridge.of_type(TYPED))

    wait_until(arrives, "the message of ROS")
    message = bridge.of_type(TYPED)[0]
    assert (message.topic, message.link) == (TOPIC, "imu_link")
    assert bytes(message.body)[: 32 + len(cdr)] == pack_typed(MAGNETIC, cdr)
