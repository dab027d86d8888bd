# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS types that have no number of their own, through the ROS 1 node both ways."""

import pytest

from tests.ros.bodies import NANOS
from tests.ros.conftest import FarEnd
from tests.ros.test_typed import MAGNETIC, TOPIC, magnetic_cdr
from tests.ros.waiting import wait_until
from tests.system.rig import free_port
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.typed import pack_typed
from udp_bridge.wire.types import SUBSCRIBE, TYPED

from .conftest import Ros1

pytestmark = pytest.mark.system


def test_a_type_without_a_number_passes_both_ways(ros1: Ros1) -> None:
    port = free_port()
    node = ros1.bridge(f"127.0.0.1:{port}")
    far_end = FarEnd(("127.0.0.1", port))
    listener = ros1.listen(("sensor_msgs/MagneticField", TOPIC))
    listener.wait_for("ready")
    cdr = magnetic_cdr()
    far_end.reach(listener, TYPED, TOPIC, pack_typed(MAGNETIC, cdr))
    stamp, (frame,) = listener.messages(TOPIC)[0][:2]
    assert (stamp, frame) == (1_795_246_685_346_812_417, "imu_link")
    for _ in range(3):
        far_end.send(TYPED, "/pose", NANOS, pack_typed("no_such_msgs/msg/Thing", b"\0\1\0\0"))
    node.wait_for("/pose: no_such_msgs/msg/Thing can't be published: ROS package no_such_msgs is")

    message = "{header: {frame_id: mast}, magnetic_field: {x: 2.0}}"
    pub = ("/usr/bin/rostopic", "pub", "-r", "10", "/back", "sensor_msgs/MagneticField", message)
    ros1.start(*pub)

    def arrives() -> bool:
        far_end.send(SUBSCRIBE, "/back", 0, Subscribe(TYPED, lease_s=30).pack())
        return bool(far_end.of_type(TYPED))

    wait_until(arrives, "the message of ROS")
    back = far_end.of_type(TYPED)[0]
    assert (back.topic, back.link) == ("/back", "mast")
    assert bytes(back.body[:30]) == b"\x1d" + MAGNETIC.encode()
    far_end.close()
    node.end()
    assert node.output.count("no_such_msgs/msg/Thing can't be published") == 1
