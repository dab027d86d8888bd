# SPDX-License-Identifier: Apache-2.0
"""Sensor readings for figures: IMU samples, trajectories, and one point cloud.

Memory does not grow with the run: every n-th message is kept, and one cloud of each LiDAR.
"""

from dataclasses import dataclass, field
from math import cos, hypot, radians, sin, sqrt
from typing import Any

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from groundlink.core.frames import transform
from groundlink.core.quaternions import heading_rad
from groundlink.messages.base import Imu, PointCloud
from groundlink.messages.imagery import LaserScan
from groundlink.messages.navigation import NavSatFix, Odometry
from groundlink.ros.cloud_layouts import LAYOUTS
from groundlink.ros.points import layout_of
from groundlink.ros.types import nanos
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.schema import Datum
from groundlink.scenario.sensor_kinds import sensor_kinds

Floats = NDArray[np.float64]

MAX_SAMPLES = 4000
"""Of a sensor, in a plot."""

MAX_CLOUD_POINTS = 60_000

_SEMI_MAJOR_M, _ECCENTRICITY_SQUARED = 6_378_137.0, 6.694379990141e-3
"""WGS 84's."""

_FLOAT32 = 7
"""sensor_msgs/PointField's."""


@dataclass
class ImuSamples:
    """Samples of an IMU."""

    topic: str
    rows: list[tuple[float, ...]] = field(default_factory=list)
    """Time (s of the run), angular velocity (rad/s), specific force (m/s2), in the sensor."""

    def add(self, seconds: float, imu: Any) -> None:
        """Take a sensor_msgs/Imu."""
        turn, force = imu.angular_velocity, imu.linear_acceleration
        self.rows.append((seconds, turn.x, turn.y, turn.z, force.x, force.y, force.z))


@dataclass
class EstimatedTrajectory:
    """Trajectory of a vehicle, estimated by a sensor."""

    topic: str
    datum: Datum | None = None
    """Datum of GNSS fixes; None for odometry."""

    mount_m: tuple[float, float] = (0.0, 0.0)
    """base_from_antenna, x and y."""

    rows: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Time (s of the run), x, y (m), heading (rad); of a fix the heading is 0."""

    def add(self, seconds: float, message: Any) -> None:
        """Take a nav_msgs/Odometry, or a sensor_msgs/NavSatFix that has a fix."""
        if self.datum is not None:
            if message.status.status >= 0:
                x, y = east_north(self.datum, message.latitude, message.longitude)
                self.rows.append((seconds, x, y, 0.0))
            return
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        self.rows.append((seconds, place.x, place.y, heading(turn)))

    def beside(self, truth: Floats) -> Floats:
        """Return time, x, y (m, world) and the distance to the truth (m), shape (N, 4).

        Odometry is aligned with the truth at its first pose. A fix is compared with the antenna.

        Parameters
        ----------
        truth
            `Motion.track`, not empty.
        """
        rows = np.array(self.rows, np.float64).reshape(-1, 4)
        at = truth_at(truth, rows[:, 0])
        places = rows[:, 1:3]
        if self.datum is None:
            turn = at[0, 2] - rows[0, 3]
            places = (places - places[0]) @ _rotation(turn).T + at[0, :2]
            expected = at[:, :2]
        else:
            c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
            x, y = self.mount_m
            expected = at[:, :2] + np.stack([c * x - s * y, s * x + c * y], axis=1)
        apart = np.linalg.norm(places - expected, axis=1)
        return np.column_stack([rows[:, 0], places, apart])


@dataclass
class CloudSample:
    """One point cloud or scan: the first one at or after an instant."""

    topic: str
    from_seconds: float
    base_from_sensor: Floats
    """Shape (4, 4)."""

    seconds: float | None = None
    """Stamp of the one that was taken, in seconds of the run."""

    points: Floats = field(default_factory=lambda: np.empty((0, 3)))
    """In the sensor's frame, meters, shape (N, 3)."""

    times: Floats = field(default_factory=lambda: np.empty(0))
    """Seconds of the run, shape (N,)."""

    def is_due(self, seconds: float) -> bool:
        """Return whether a message of this instant is to be added."""
        return self.seconds is None and seconds >= self.from_seconds

    def add(self, seconds: float, message: Any) -> None:
        """Take a sensor_msgs/PointCloud2 or LaserScan that is due."""
        points, after = _of_scan(message) if hasattr(message, "ranges") else _of_cloud(message)
        step = -(-len(points) // MAX_CLOUD_POINTS) or 1
        self.seconds = seconds
        self.points, self.times = points[::step], seconds + after[::step]

    def in_world(self, truth: Floats) -> Floats:
        """Return the points in the vehicle's level frame laid on the map, shape (N, 3).

        Each by the true place and heading at its own instant; z is above the base.
        """
        turned = self.base_from_sensor[:3, :3]
        in_base = self.points @ turned.T + self.base_from_sensor[:3, 3]
        at = truth_at(truth, self.times)
        c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
        x = at[:, 0] + c * in_base[:, 0] - s * in_base[:, 1]
        y = at[:, 1] + s * in_base[:, 0] + c * in_base[:, 1]
        return np.column_stack([x, y, in_base[:, 2]])


Readings = ImuSamples | EstimatedTrajectory | CloudSample


def readings_of(sensor: SensorSpec, datum: Datum | None, middle_s: float) -> Readings | None:
    """Return the collector of a sensor's readings; None for messages without a plot."""
    kind = sensor_kinds().get(sensor.kind)
    message = kind.streams[""] if kind else None
    if message is Imu:
        return ImuSamples(sensor.topic)
    if message is Odometry:
        return EstimatedTrajectory(sensor.topic)
    if message is NavSatFix and datum is not None:
        x, y, _ = sensor.mount.xyz_m
        return EstimatedTrajectory(sensor.topic, datum, (x, y))
    if (message is PointCloud or message is LaserScan) and sensor.mount.joint is UNSET:
        mount = transform(sensor.mount.xyz_m, sensor.mount.quaternion())
        return CloudSample(sensor.topic, middle_s, mount)
    return None


def heading(turn: Any) -> float:
    """Return the yaw of a geometry_msgs/Quaternion."""
    return heading_rad((turn.x, turn.y, turn.z, turn.w))


def truth_at(truth: Floats, seconds: Floats) -> Floats:
    """Return x, y (m) and heading (rad) of a `Motion.track` at some times, shape (N, 3)."""
    columns = (truth[:, 1], truth[:, 2], np.unwrap(truth[:, 5]))
    return np.stack([np.interp(seconds, truth[:, 0], column) for column in columns], axis=1)


def east_north(datum: Datum, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Return meters east and north of a datum, by the radii of WGS 84 there.

    Within 400 m of the datum this is off by less than 3 cm, up to latitudes of 60 degrees.
    """
    at = radians(datum.latitude_deg)
    root = sqrt(1 - _ECCENTRICITY_SQUARED * sin(at) ** 2)
    across = _SEMI_MAJOR_M / root + datum.altitude_m
    along = _SEMI_MAJOR_M * (1 - _ECCENTRICITY_SQUARED) / root**3 + datum.altitude_m
    east = radians(longitude_deg - datum.longitude_deg) * across * cos(at)
    return east, radians(latitude_deg - datum.latitude_deg) * along


def _rotation(angle: float) -> Floats:
    return np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])


def _of_cloud(cloud: Any) -> tuple[Floats, Floats]:
    """Return the points of a sensor_msgs/PointCloud2, and seconds after its stamp."""
    if name := layout_of(cloud):
        layout = LAYOUTS[name]
        records = np.frombuffer(cloud.data.tobytes(), layout.record)
        known = layout.points(records, nanos(cloud.header.stamp))
        return _positions(known), known["time"].astype(np.float64)
    offsets = {each.name: each.offset for each in cloud.fields if each.datatype == _FLOAT32}
    names = [name for name in ("x", "y", "z", "time") if name in offsets]
    kind = np.dtype(
        {
            "names": names,
            "formats": ["<f4"] * len(names),
            "offsets": [offsets[name] for name in names],
            "itemsize": cloud.point_step,
        }
    )
    rows = np.frombuffer(cloud.data.tobytes(), kind)
    after = rows["time"].astype(np.float64) if "time" in names else np.zeros(len(rows))
    return _positions(rows), after


def _positions(rows: NDArray[np.void]) -> Floats:
    return np.stack([rows[name].astype(np.float64) for name in "xyz"], axis=1)


def _of_scan(scan: Any) -> tuple[Floats, Floats]:
    """Return the points of a sensor_msgs/LaserScan, and seconds after its stamp."""
    ranges = np.asarray(scan.ranges, np.float64)
    numbers = np.flatnonzero(np.isfinite(ranges))
    angles, met = scan.angle_min + numbers * scan.angle_increment, ranges[numbers]
    points = np.stack([met * np.cos(angles), met * np.sin(angles), np.zeros(len(met))], axis=1)
    return points, numbers * scan.time_increment


def reach_m(points: Floats, center_m: tuple[float, float]) -> float:
    """Return the horizontal distance within which 90 % of the points lie."""
    if not len(points):
        return 0.0
    away = [hypot(x - center_m[0], y - center_m[1]) for x, y in points[:, :2].tolist()]
    return float(np.quantile(away, 0.9))
