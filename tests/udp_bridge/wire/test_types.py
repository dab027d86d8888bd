# SPDX-License-Identifier: Apache-2.0
import re

import pytest

from tests.udp_bridge.vectors import VECTORS
from udp_bridge import MSG_TYPES, type_number
from udp_bridge.wire.types import ANY_ROS_TYPE, ROS_TYPES, SUBSCRIBE, TYPED, MessageType


def test_every_ros_type_has_a_vector_which_pins_its_number() -> None:
    sent = {message["msg_type"] for vector in VECTORS for message in vector.meaning["messages"]}
    assert sent - {SUBSCRIBE} == ROS_TYPES


@pytest.mark.parametrize("row", MSG_TYPES.values(), ids=lambda row: row.name)
def test_row_is_complete(row: MessageType) -> None:
    assert MSG_TYPES[row.number] is row
    assert type_number(row.name) == row.number
    assert row.direction in ("to ROS", "from ROS", "both")
    if row.number == TYPED:
        assert (row.name, row.ros_type, row.default_topic) == ("Typed", ANY_ROS_TYPE, "")
    elif row.ros_type is None:
        assert row.name in ("Subscribe", "Control", "Resend", "Repair")
        assert row.default_topic == ""
    else:
        assert re.fullmatch(rf"\w+_msgs/msg/{row.name}", row.ros_type)
        assert row.default_topic.startswith("/")


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"unknown message type 'Pointcloud2'; .*PointCloud2, Imu"):
        type_number("Pointcloud2")
