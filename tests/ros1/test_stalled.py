# SPDX-License-Identifier: Apache-2.0
"""A subscriber that sleeps costs nobody but itself, and /diagnostics says what."""

from typing import Any

import pytest

from tests.ros import bodies
from tests.ros.conftest import FarEnd
from tests.ros.waiting import each_period

from .conftest import Ros1

pytestmark = pytest.mark.system

CLOUD, IMU = 1, 2
POINTS = ("sensor_msgs/PointCloud2", "/points")
IMUS = ("sensor_msgs/Imu", "/imu")
SECONDS = 5.0
CLOUDS, IMUS_A_CLOUD = 60, 10


def test_a_subscriber_that_sleeps_loses_its_own_and_is_named(ros1: Ros1) -> None:
    node = ros1.bridge("127.0.0.1:0")
    host, port = node.wait_for(r"receiving at ([\d.]+):(\d+)").groups()
    far_end = FarEnd((host, int(port)))
    asleep = ros1.listen(POINTS, nap_s=SECONDS)
    awake = ros1.listen(IMUS, ("diagnostic_msgs/DiagnosticArray", "/diagnostics"))
    far_end.reach(asleep, CLOUD, "/points", bodies.cloud(0, b""))
    far_end.reach(awake, IMU, "/imu", bodies.imu(0))
    data = bytes(50_000 * bodies.POINT_BYTES)
    stamps = [bodies.NANOS + number for number in range(CLOUDS * IMUS_A_CLOUD)]
    for number in each_period(0.0025, len(stamps)):
        far_end.send(IMU, "/imu", stamps[number], bodies.imu(stamps[number]), "imu")
        if number % IMUS_A_CLOUD == 0:
            far_end.send(CLOUD, "/points", stamps[number], bodies.cloud(stamps[number], data))
    awake.wait_for_stamp("/imu", stamps[-1])
    assert [stamp for stamp, _ in awake.messages("/imu") if stamp] == stamps
    asleep.wait_for_stamp("/points", stamps[-IMUS_A_CLOUD])

    def told() -> dict[str, Any]:
        rows = awake.messages("/diagnostics")
        return dict(rows[-1][1].get("udp_bridge: /points", {})) if rows else {}

    got = [stamp for stamp, _ in asleep.messages("/points") if stamp]
    awake.wait_until(
        lambda: any(name.startswith("not taken by /listener") for name in told()), "its counter"
    )
    (lost,) = [int(told()[name]) for name in told() if name.startswith("not taken by")]
    assert len(got) + lost == CLOUDS
    assert 0 < lost < CLOUDS
    assert (told()["dropped"], told()["missing"]) == ("0", "0")
    assert int(told()["delivered"]) >= CLOUDS
    far_end.close()
    assert node.end() == 0
