# SPDX-License-Identifier: Apache-2.0
"""IMUs, odometry, poses with covariance, satellite fixes and joints."""

from typing import Any

import numpy as np

from .base import Floats, TopicReadings, quaternion, vector


def _rows(values: list[Any], width: int) -> Floats:
    return np.array(values, np.float64).reshape(-1, width)


class ImuReadings(TopicReadings):
    """Readings of sensor_msgs/Imu."""

    types = ("sensor_msgs/msg/Imu",)

    def prepare(self) -> None:
        """Create the lists."""
        self._rows: list[tuple[float, ...]] = []
        self._covariances: list[Any] = []

    def take(self, index: int, message: Any) -> None:
        """Take the vectors and covariances."""
        self._rows.append(
            (
                *vector(message.angular_velocity),
                *vector(message.linear_acceleration),
                *quaternion(message.orientation),
            )
        )
        self._covariances.append(
            (
                message.angular_velocity_covariance,
                message.linear_acceleration_covariance,
                message.orientation_covariance,
            )
        )

    def finish(self) -> None:
        """Make the arrays: rad/s, m/s2, quaternions x y z w."""
        rows = _rows(self._rows, 10)
        self.gyro, self.acceleration, self.orientation = rows[:, :3], rows[:, 3:6], rows[:, 6:]
        covariances = np.array(self._covariances, np.float64).reshape(-1, 3, 3, 3)
        self.covariances = {
            "angular_velocity": covariances[:, 0],
            "linear_acceleration": covariances[:, 1],
            "orientation": covariances[:, 2],
        }

    @property
    def has_orientation(self) -> bool:
        """Whether the IMU estimates its orientation (REP 145: otherwise covariance[0] is -1)."""
        marked = self.covariances["orientation"][:, 0, 0] == -1
        return not marked.any() and bool(np.any(self.orientation != 0))


class OdometryReadings(TopicReadings):
    """Readings of nav_msgs/Odometry."""

    types = ("nav_msgs/msg/Odometry",)

    def prepare(self) -> None:
        """Create the lists."""
        self._rows: list[tuple[float, ...]] = []
        self._covariances: list[Any] = []
        self.child_frames: dict[str, None] = {}

    def take(self, index: int, message: Any) -> None:
        """Take pose, twist and covariances."""
        pose, twist = message.pose.pose, message.twist.twist
        self._rows.append(
            (
                *vector(pose.position),
                *quaternion(pose.orientation),
                *vector(twist.linear),
                *vector(twist.angular),
            )
        )
        self._covariances.append((message.pose.covariance, message.twist.covariance))
        self.child_frames[str(message.child_frame_id)] = None

    def finish(self) -> None:
        """Make the arrays: meters, quaternions x y z w, m/s and rad/s in the child frame."""
        rows = _rows(self._rows, 13)
        self.position, self.orientation = rows[:, :3], rows[:, 3:7]
        self.linear, self.angular = rows[:, 7:10], rows[:, 10:]
        covariances = np.array(self._covariances, np.float64).reshape(-1, 2, 6, 6)
        self.covariances = {"pose": covariances[:, 0], "twist": covariances[:, 1]}


class FixReadings(TopicReadings):
    """Readings of sensor_msgs/NavSatFix."""

    types = ("sensor_msgs/msg/NavSatFix",)

    def prepare(self) -> None:
        """Create the lists."""
        self._rows: list[tuple[float, ...]] = []
        self._covariances: list[Any] = []

    def take(self, index: int, message: Any) -> None:
        """Take position, status and covariance."""
        self._rows.append(
            (
                message.latitude,
                message.longitude,
                message.altitude,
                message.status.status,
                message.position_covariance_type,
            )
        )
        self._covariances.append(message.position_covariance)

    def finish(self) -> None:
        """Make the arrays: degrees, meters above the ellipsoid."""
        rows = _rows(self._rows, 5)
        self.latitude, self.longitude, self.altitude = rows[:, 0], rows[:, 1], rows[:, 2]
        self.has_fix = rows[:, 3] >= 0
        self.covariance_type = rows[:, 4]
        self.covariances = {
            "position": np.array(self._covariances, np.float64).reshape(-1, 3, 3),
        }


class JointReadings(TopicReadings):
    """Readings of sensor_msgs/JointState."""

    types = ("sensor_msgs/msg/JointState",)

    def prepare(self) -> None:
        """Create the lists."""
        self.lengths: set[tuple[int, int, int, int]] = set()
        """Lengths of name, position, velocity and effort, as they appear."""
        self.joints: dict[str, list[tuple[int, float, float]]] = {}
        """For each joint with position and velocity: index of message, rad, rad/s."""

    def take(self, index: int, message: Any) -> None:
        """Take positions and velocities by name."""
        name, position, velocity = message.name, message.position, message.velocity
        self.lengths.add((len(name), len(position), len(velocity), len(message.effort)))
        if len(name) == len(position) == len(velocity):
            for joint, angle, speed in zip(name, position, velocity, strict=True):
                self.joints.setdefault(str(joint), []).append((index, float(angle), float(speed)))
