# SPDX-License-Identifier: Apache-2.0
"""The kit for recordings of sensors listens to a running ROS 2 system."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros_domains import next_domain

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytestmark = pytest.mark.system

KIT = Path(__file__).resolve().parents[2] / "conformance" / "src"

PUBLISHER = """
import time
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Imu
from std_msgs.msg import String

with rclpy.init():
    node = rclpy.create_node("imu")
    imu = node.create_publisher(Imu, "/imu", 10)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(String, "/description", latched).publish(String(data="robot"))
    while True:
        message = Imu()
        message.header.stamp = node.get_clock().now().to_msg()
        message.header.frame_id = "imu_link"
        message.linear_acceleration.z = 1.0
        imu.publish(message)
        time.sleep(0.02)
"""


def test_live_topics_are_checked() -> None:
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("ROS_", "RMW_"))}
    environment = kept | {
        "ROS_DOMAIN_ID": next_domain(),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "PYTHONPATH": str(KIT),
    }
    publisher = subprocess.Popen([sys.executable, "-c", PUBLISHER], env=environment)
    try:
        command = [sys.executable, "-m", "sensor_conformance", "--live", "--duration", "6", "-v"]
        done = subprocess.run(
            [*command, "--only", "imu.*", "--only", "stamps.set"],
            env=environment,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    finally:
        publisher.kill()
        publisher.wait()
    assert done.returncode == 1, done.stdout + done.stderr
    assert "FAILED imu.gravity /imu: median 1.000 m/s2" in done.stdout
    assert "passed stamps.set /imu: 0 of " in done.stdout
    assert done.stdout.splitlines()[-1].startswith("live topics: ")
