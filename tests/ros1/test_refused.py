# SPDX-License-Identifier: Apache-2.0
"""Bodies that are no message of their type are refused, in one line, and end nothing."""

import pytest

from tests.ros import bodies
from tests.ros.conftest import FarEnd

from .conftest import Ros1

pytestmark = pytest.mark.system

IMU, TF = 2, 35


def test_invalid_messages_are_refused_and_valid_ones_continue(ros1: Ros1) -> None:
    node = ros1.bridge("127.0.0.1:0")
    host, port = node.wait_for(r"receiving at ([\d.]+):(\d+)").groups()
    far_end = FarEnd((host, int(port)))
    ears = ros1.listen(("sensor_msgs/Imu", "/imu"), ("tf2_msgs/TFMessage", "/tf_static"))
    far_end.send(TF, "/tf_static", 0, bodies.transforms(0, {"lidar": 1.0}))
    ears.wait_until(lambda: ears.messages("/tf_static"), "transforms")
    far_end.send(IMU, "/imu", 1, bodies.imu(1)[:40])
    far_end.reach(ears, IMU, "/imu", bodies.imu(2))
    assert {stamp for stamp, _ in ears.messages("/imu")} == {2}
    far_end.close()
    assert node.end() == 0
    assert "can't be published: it ends after 36 bytes, within a field" in node.output
    assert node.lines[-1].endswith("refused 1")
