# SPDX-License-Identifier: Apache-2.0
"""A scene of the Unity package and the ROS 2 node: its sensors are topics, /cmd_vel drives it."""

import subprocess
from pathlib import Path

from tests.udp_bridge.csharp.programs import library_in, scene_beside

from .conftest import SENSOR_DATA, Ros

CLOUD = "sensor_msgs/msg/PointCloud2"
IMAGE = "sensor_msgs/msg/CompressedImage"


def test_ros_sees_the_sensors_of_a_scene_and_drives_it(ros: Ros, tmp_path: Path) -> None:
    scene = scene_beside(library_in(tmp_path))
    _, address = ros.bridge()
    topics = {CLOUD: "/points", IMAGE: "/camera/image_raw/compressed"}
    listener = ros.listen(*((kind, topic, SENSOR_DATA) for kind, topic in topics.items()))
    ros.talk("geometry_msgs/msg/Twist", "/cmd_vel", 20.0)
    command = ["mono", str(scene), str(address[1])]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    speeds = [float(row[3]) for row in rows if row[0] == "linear"]  # Unity's z, ahead
    assert speeds[1] == speeds[0] + 1 > 1
    for topic in topics.values():
        listener.wait_until(lambda topic=topic: listener.messages(topic), topic)
    assert listener.messages("/points")[0][1][1] == "lidar_link"
