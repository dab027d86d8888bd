# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import re

import pytest

from udp_bridge import MSG_TYPES, type_number
from udp_bridge.wire.types import MessageType


def test_numbers_are_those_of_the_wire() -> None:
    assert list(MSG_TYPES) == [*range(1, 12), *range(32, 41), 64, 65, 66]


@pytest.mark.parametrize("row", MSG_TYPES.values(), ids=lambda row: row.name)
def test_row_is_whole(row: MessageType) -> None:
    assert MSG_TYPES[row.number] is row
    assert type_number(row.name) == row.number
    assert row.direction in ("to ROS", "from ROS", "both")
    if row.ros_type is None:
        assert row.name in ("Subscribe", "Control", "Resend", "Repair")
        assert row.default_topic == ""
    else:
        assert re.fullmatch(rf"\w+_msgs/msg/{row.name}", row.ros_type)
        assert row.default_topic.startswith("/")


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"unknown message type 'Pointcloud2'; .*PointCloud2, Imu"):
        type_number("Pointcloud2")
