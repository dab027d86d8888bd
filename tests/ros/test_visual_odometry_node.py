# SPDX-License-Identifier: Apache-2.0
"""The example of visual odometry finds the motion of a camera in pictures of a known scene."""

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")

NODE = Path(__file__).parents[2] / "examples/visual_odometry_node/visual_odometry_node.py"
CAMERA = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
HEIGHT, WIDTH = 240, 320


@pytest.fixture(scope="module")
def example() -> dict[str, Any]:
    return runpy.run_path(str(NODE))


@pytest.fixture(scope="module")
def texture() -> np.ndarray[Any, Any]:
    """Two walls' paint: blobs of 4 pixels, smoothed."""
    import cv2

    rng = np.random.default_rng(5)
    blobs = cv2.resize(rng.integers(0, 255, (300, 400)).astype(np.uint8), None, fx=4, fy=4)
    return cv2.GaussianBlur(blobs, (0, 0), 2.0)


def seen(pose: np.ndarray[Any, Any], texture: Any) -> tuple[Any, Any]:
    """Return picture and depth from a pose: walls at z = 2 m left of the middle and 3 m right."""
    import cv2

    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(CAMERA).T
    rays = rays @ pose[:3, :3].T
    near, far = ((z - pose[2, 3]) / rays[..., 2] for z in (2.0, 3.0))
    depth = np.where(pose[0, 3] + near * rays[..., 0] < 0, near, far)
    hits = pose[:3, 3] + depth[..., None] * rays
    places = (hits[..., :2] * 150.0 + (800, 600)).astype(np.float32)
    gray = cv2.remap(texture, places[..., 0], places[..., 1], cv2.INTER_LINEAR)
    # Along the optical axis, not along the ray.
    return gray, depth


def moved(step: int) -> np.ndarray[Any, Any]:
    """Return the pose of a camera that turns about its vertical axis while it moves."""
    turn = 0.02 * step
    pose = np.eye(4)
    pose[:3, :3] = [
        [np.cos(turn), 0, np.sin(turn)],
        [0, 1, 0],
        [-np.sin(turn), 0, np.cos(turn)],
    ]
    pose[:3, 3] = 0.02 * step, 0.005 * step, 0.03 * step
    return pose


def test_the_motion_is_found_over_several_key_frames(example: dict[str, Any], texture: Any) -> None:
    odometry = example["VisualOdometry"](CAMERA)
    for step in range(15):
        found = odometry.track(*seen(moved(step), texture))
        assert found[:3, 3] == pytest.approx(moved(step)[:3, 3], abs=0.01 + 0.001 * step)
        assert found[:3, :3] == pytest.approx(moved(step)[:3, :3], abs=0.01)


def test_without_corners_the_camera_moves_on_as_before(
    example: dict[str, Any], texture: Any
) -> None:
    odometry = example["VisualOdometry"](CAMERA)
    for step in range(4):
        odometry.track(*seen(moved(step), texture))
    dark = np.zeros((HEIGHT, WIDTH), np.uint8)
    found = odometry.track(dark, np.zeros((HEIGHT, WIDTH)))
    assert found[:3, 3] == pytest.approx(moved(4)[:3, 3], abs=0.02)
    before = odometry.track(*seen(moved(5), texture))
    after = odometry.track(*seen(moved(6), texture))
    step = np.linalg.inv(before) @ after
    assert step == pytest.approx(np.linalg.inv(moved(5)) @ moved(6), abs=0.01)


@pytest.mark.parametrize(
    ("encoding", "kind", "value"), [("16UC1", np.uint16, 1500), ("32FC1", np.float32, 1.5)]
)
def test_depth_is_read_in_meters(
    example: dict[str, Any], encoding: str, kind: Any, value: float
) -> None:
    from sensor_msgs.msg import Image

    image = Image(encoding=encoding, height=2, width=3)
    rows = np.zeros((2, 4), kind)  # each row has a pixel of padding
    rows[1, 2] = value
    image.step, image.data = rows.strides[0], rows.tobytes()
    assert example["meters"](image) == pytest.approx(np.array([[0, 0, 0], [0, 0, 1.5]]))


def test_an_odometry_message_has_the_stamp_and_the_frame_of_its_picture(
    example: dict[str, Any],
) -> None:
    from sensor_msgs.msg import CompressedImage

    image = CompressedImage()
    image.header.stamp.sec, image.header.frame_id = 7, "camera_optical_frame"
    message = example["odometry_of"](moved(10), image)
    assert message.header.stamp.sec == 7
    assert (message.header.frame_id, message.child_frame_id) == (
        "visual_odom",
        "camera_optical_frame",
    )
    place, q = message.pose.pose.position, message.pose.pose.orientation
    assert (place.x, place.y, place.z) == pytest.approx((0.2, 0.05, 0.3))
    assert (q.x, q.y, q.z, q.w) == pytest.approx((0, np.sin(0.1), 0, np.cos(0.1)))
