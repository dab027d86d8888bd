# SPDX-License-Identifier: Apache-2.0
"""The example with KISS-ICP reads clouds and writes odometry; the program itself is replaced."""

import runpy
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")

NODE = Path(__file__).parents[2] / "examples/kiss_icp_node/kiss_icp_node.py"


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The names of the script, without KISS-ICP."""
    for name, content in (("kiss_icp", ""), ("config", "load_config"), ("kiss_icp", "KissICP")):
        module = ModuleType(name)
        if content:
            setattr(module, content, None)
        monkeypatch.setitem(sys.modules, f"kiss_icp.{name}" if content else name, module)
    return runpy.run_path(str(NODE))


def cloud(points: np.ndarray[Any, np.dtype[Any]]) -> Any:
    from sensor_msgs.msg import PointCloud2, PointField

    message = PointCloud2()
    message.header.frame_id = "lidar_link"
    message.header.stamp.sec, message.header.stamp.nanosec = 7, 950_000_000
    message.fields = [
        PointField(name=name, offset=points.dtype.fields[name][1], datatype=7, count=1)
        for name in points.dtype.names
        if name != "ring"
    ]
    message.point_step = points.itemsize
    message.data = points.tobytes()
    return message


def test_points_and_times_are_read_by_name(example: dict[str, Any]) -> None:
    kind = [(n, "<f4") for n in ("x", "y", "z", "intensity")] + [("ring", "<u2"), ("time", "<f4")]
    points = np.array([(1, 2, 3, 9, 4, 0.0), (4, 5, 6, 9, 5, 0.1)], kind)
    xyz, seconds = example["points_and_times"](cloud(points))
    assert xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert seconds == pytest.approx([0.0, 0.1])


@pytest.mark.parametrize("turn", [0.0, 0.3, 2.0, 3.1, -3.1])
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0.6, 0.0, 0.8)])
def test_pose_has_the_stamp_of_the_last_point(
    example: dict[str, Any], turn: float, axis: tuple[float, float, float]
) -> None:
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])  # Rodrigues
    pose = np.eye(4)
    pose[:3, :3] += np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross
    pose[:3, 3] = 1.0, 2.0, 3.0
    odometry = example["odometry_of"](pose, cloud(np.zeros(1, [("x", "<f4")])), 0.1)
    assert (odometry.header.stamp.sec, odometry.header.stamp.nanosec) == (8, 50_000_000)
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("lidar_odom", "lidar_link")
    place, q = odometry.pose.pose.position, odometry.pose.pose.orientation
    assert (place.x, place.y, place.z) == (1.0, 2.0, 3.0)
    expected = np.array([*(np.sin(turn / 2) * np.array(axis)), np.cos(turn / 2)])
    found = np.array([q.x, q.y, q.z, q.w])
    assert abs(found @ expected) == pytest.approx(1.0)
