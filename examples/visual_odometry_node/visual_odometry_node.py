# SPDX-License-Identifier: Apache-2.0
"""Visual odometry of a depth camera as a ROS 2 node, by OpenCV.

    python visual_odometry_node.py [--ros-args -p camera:=/camera -p odometry:=/visual_odometry]

Subscribes to CAMERA/color/image_raw/compressed, CAMERA/depth/image_rect_raw and
CAMERA/color/camera_info; color and depth have the same pixels. The odometry has the frame
`visual_odom`, which is the camera's frame at the first picture.

Corners of a key frame get their positions from its depth. They are tracked from picture to picture
by optical flow (KLT), and each picture's pose is that of the tracked points (PnP with RANSAC). A
picture that has lost too many of them is the next key frame.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import rclpy
from geometry_msgs.msg import Quaternion
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

Floats = NDArray[np.float64]
Gray = NDArray[np.uint8]

FRAME = "visual_odom"
CORNERS = 600
KEPT_SHARE = 0.6
"""Share of a key frame's corners below which the next picture is a key frame."""

FEWEST = 20
"""Tracked points below which there is no pose: the camera is assumed to move as before."""

BACK_PX = 0.7
"""Largest distance of a corner that is tracked into the next picture and back again."""

DEPTH_M = (0.3, 8.0)
WAITING = 20
"""Largest number of pictures that wait for another of their messages."""


@dataclass
class KeyFrame:
    """Corners of a picture with their positions, and where they are in the newest picture."""

    odom_from_camera: Floats
    points: Floats
    """Positions in the camera's frame, shape (N, 3)."""

    pixels: NDArray[np.float32]
    """In the newest picture, shape (N, 2)."""

    count: int
    """Of corners at the beginning."""


class VisualOdometry:
    """Estimates odom_from_camera, shape (4, 4), from pictures with depth."""

    def __init__(self, camera: Floats) -> None:
        self._camera = camera
        self._gray: Gray | None = None
        self._key: KeyFrame | None = None
        self._pose, self._motion = np.eye(4), np.eye(4)

    def track(self, gray: Gray, depth_m: Floats) -> Floats:
        """Return the pose of a picture; `depth_m` is 0 or NaN where it is unknown."""
        if self._key is not None:
            found = self._found(self._key, gray)
            pose = self._pose @ self._motion if found is None else found
            self._motion = np.linalg.inv(self._pose) @ pose
            self._pose = pose
        if self._key is None or len(self._key.pixels) < KEPT_SHARE * self._key.count:
            self._key = self._key_frame(gray, depth_m)
        self._gray = gray
        return self._pose

    def _found(self, key: KeyFrame, gray: Gray) -> Floats | None:
        """Return the pose of a picture by the corners of the key frame that are still seen."""
        if len(key.pixels) < FEWEST:
            return None
        pixels, seen, _ = cv2.calcOpticalFlowPyrLK(self._gray, gray, key.pixels, None)
        back, seen_back, _ = cv2.calcOpticalFlowPyrLK(gray, self._gray, pixels, None)
        good = (seen & seen_back).ravel().astype(bool)
        good &= np.hypot(*(back - key.pixels).T) < BACK_PX
        key.points, key.pixels = key.points[good], pixels[good]
        if len(key.pixels) < FEWEST:
            return None
        is_found, rotation, translation, inliers = cv2.solvePnPRansac(
            key.points, key.pixels, self._camera, None, reprojectionError=2.0, confidence=0.999
        )
        if not is_found or len(inliers) < FEWEST:
            return None
        chosen = inliers.ravel()
        key.points, key.pixels = key.points[chosen], key.pixels[chosen]
        rotation, translation = cv2.solvePnPRefineLM(
            key.points, key.pixels, self._camera, None, rotation, translation
        )
        camera_from_key = np.eye(4)
        camera_from_key[:3, :3], camera_from_key[:3, 3] = cv2.Rodrigues(rotation)[0], translation.T
        return key.odom_from_camera @ np.linalg.inv(camera_from_key)

    def _key_frame(self, gray: Gray, depth_m: Floats) -> KeyFrame:
        low, high = DEPTH_M
        known = ((depth_m > low) & (depth_m < high)).astype(np.uint8)
        corners = cv2.goodFeaturesToTrack(gray, CORNERS, 0.005, 8, mask=known)
        pixels = np.empty((0, 2), np.float32) if corners is None else corners.reshape(-1, 2)
        columns, rows = np.rint(pixels).astype(int).T
        rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(self._camera).T
        points = rays * depth_m[rows, columns, None]
        return KeyFrame(self._pose, points, pixels, len(pixels))


class VisualOdometryNode(Node):
    """Publishes the pose of each picture with depth."""

    def __init__(self) -> None:
        super().__init__("visual_odometry")
        self.declare_parameter("camera", "/camera")
        self.declare_parameter("odometry", "/visual_odometry")
        camera, odometry = (self.get_parameter(name).value for name in ("camera", "odometry"))
        self._odometry: VisualOdometry | None = None
        self._waiting: dict[tuple[int, int], dict[type, Any]] = {}
        self._publisher = self.create_publisher(Odometry, odometry, 10)
        topics = {
            f"{camera}/color/image_raw/compressed": CompressedImage,
            f"{camera}/color/camera_info": CameraInfo,
            f"{camera}/depth/image_rect_raw": Image,
        }
        for topic, kind in topics.items():
            self.create_subscription(kind, topic, self._join, 10)
        self.get_logger().info(f"{', '.join(topics)} -> {odometry}")

    def _join(self, message: CompressedImage | CameraInfo | Image) -> None:
        """Estimate the pose of a picture once all of its three messages are there."""
        stamp = message.header.stamp.sec, message.header.stamp.nanosec
        joined = self._waiting.setdefault(stamp, {})
        joined[type(message)] = message
        if len(joined) == 3:
            self._estimate(joined[CompressedImage], joined[CameraInfo], joined[Image])
        if len(joined) == 3 or len(self._waiting) > WAITING:
            self._waiting = {s: j for s, j in self._waiting.items() if s > stamp}

    def _estimate(self, color: CompressedImage, info: CameraInfo, depth: Image) -> None:
        if self._odometry is None:
            self._odometry = VisualOdometry(np.array(info.k).reshape(3, 3))
        gray = cv2.imdecode(np.frombuffer(color.data, np.uint8), cv2.IMREAD_GRAYSCALE)
        pose = self._odometry.track(gray, meters(depth))
        self._publisher.publish(odometry_of(pose, color))


def meters(image: Image) -> Floats:
    """Return the distances along the optical axis; 0 where they are unknown."""
    kind, unit_m = {"16UC1": (np.uint16, 1e-3), "32FC1": (np.float32, 1.0)}[image.encoding]
    rows = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)
    depth = rows.view(kind)[:, : image.width] * unit_m
    return np.nan_to_num(depth, posinf=0.0)


def odometry_of(pose: Floats, image: CompressedImage) -> Odometry:
    """Return a pose, shape (4, 4), as a message with the stamp of a picture."""
    message = Odometry()
    message.header.stamp, message.header.frame_id = image.header.stamp, FRAME
    message.child_frame_id = image.header.frame_id
    place = message.pose.pose.position
    place.x, place.y, place.z = pose[:3, 3].tolist()
    message.pose.pose.orientation = quaternion(pose[:3, :3])
    return message


def quaternion(rotation: Floats) -> Quaternion:
    """Return a rotation matrix as a unit quaternion."""
    vector = cv2.Rodrigues(rotation)[0].ravel()
    angle = np.linalg.norm(vector)
    x, y, z = (vector * 0.5 * np.sinc(angle / (2 * np.pi))).tolist()
    return Quaternion(x=x, y=y, z=z, w=float(np.cos(angle / 2)))


def main() -> None:
    """Run the node until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(VisualOdometryNode())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
