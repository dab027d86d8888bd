# SPDX-License-Identifier: Apache-2.0
"""What is plotted of sensors is where it was, beside the truth."""

from math import degrees, pi
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from groundlink.core.frames import quaternion_from_rpy, transform
from groundlink.loader import load
from groundlink.messages.base import POINT, CloudLayout, PointCloud, packed
from groundlink.messages.imagery import LaserScan
from groundlink.report.analysis.sensors import (
    CloudSample,
    EstimatedTrajectory,
    east_north,
    reach_m,
    readings_of,
)
from groundlink.ros.cdr import CODECS, to_cdr
from groundlink.ros.cloud_layouts import LAYOUTS
from groundlink.ros.types import STORE
from groundlink.scenario.schema import Datum
from services.sensors.gnss.geodesy import Geodetic, TangentPlane, geodetic_from_ecef

DATUM = Datum(latitude_deg=58.59, longitude_deg=25.55, altitude_m=60.0)


def track(*rows: tuple[float, ...]) -> Any:
    """Return a truth of time, x, y and heading."""
    return np.array([(t, x, y, 0.0, 0.0, yaw) for t, x, y, yaw in rows])


def ros(message: Any) -> Any:
    return STORE.deserialize_cdr(to_cdr(message), CODECS[type(message)].ros_type)


def odometry(x: float, y: float, yaw: float) -> Any:
    qx, qy, qz, qw = quaternion_from_rpy(0.0, 0.0, yaw)
    pose = SimpleNamespace(
        position=SimpleNamespace(x=x, y=y), orientation=SimpleNamespace(x=qx, y=qy, z=qz, w=qw)
    )
    return SimpleNamespace(pose=SimpleNamespace(pose=pose))


def test_odometry_is_laid_on_the_truth_at_its_first_pose() -> None:
    truth = track((0, 5, 7, pi / 2), (1, 5, 8, pi / 2), (2, 5, 9, pi / 2))
    told = EstimatedTrajectory("/odom")
    for seconds, x in ((0, 0.0), (1, 1.0), (2, 1.8)):
        told.add(float(seconds), odometry(x, 0.0, 0.0))
    rows = told.beside(truth)
    np.testing.assert_allclose(rows[:, 1:3], [(5, 7), (5, 8), (5, 8.8)], atol=1e-12)
    np.testing.assert_allclose(rows[:, 3], (0, 0, 0.2), atol=1e-12)


@pytest.mark.parametrize("far_m", [1.0, 50.0, 400.0])
@pytest.mark.parametrize("bearing", range(0, 360, 45))
def test_a_fix_is_in_the_world_as_the_geodesy_has_it(far_m: float, bearing: int) -> None:
    place = TangentPlane(Geodetic.of_degrees(58.59, 25.55, 60.0))
    east, north = far_m * np.cos(np.radians(bearing)), far_m * np.sin(np.radians(bearing))
    at = geodetic_from_ecef(place.ecef((float(east), float(north), 0.0)))
    found = east_north(DATUM, degrees(at.latitude_rad), degrees(at.longitude_rad))
    assert found == pytest.approx((east, north), abs=0.03)


def test_a_fix_is_compared_with_the_antenna_and_no_fix_with_nothing() -> None:
    told = EstimatedTrajectory("/gnss/fix", DATUM, (1.0, 0.0))
    status = SimpleNamespace(status=0)
    told.add(0.0, SimpleNamespace(status=SimpleNamespace(status=-1), latitude=0.0, longitude=0.0))
    told.add(1.0, SimpleNamespace(status=status, latitude=58.59, longitude=25.55))
    rows = told.beside(track((0, 0, -1, pi / 2), (2, 0, -1, pi / 2)))
    assert rows.shape == (1, 4)
    assert rows[0, 3] == pytest.approx(0.0, abs=1e-9)  # the antenna is a meter ahead: at 0, 0


@pytest.mark.parametrize("layout", LAYOUTS)
def test_points_of_a_cloud_are_laid_each_at_its_own_instant(layout: CloudLayout) -> None:
    records = np.zeros(2, POINT)
    records["x"], records["time"] = (2.0, 2.0), (0.0, 0.1)
    message = PointCloud(0, "lidar_link", packed(records.view(np.uint8)), layout)
    cloud = CloudSample("/points", 0.5, transform((0.0, 0.0, 0.4), (0.0, 0.0, 0.0, 1.0)))
    assert not cloud.is_due(0.4)
    assert cloud.is_due(0.6)
    cloud.add(0.6, ros(message))
    assert not cloud.is_due(0.7)
    truth = track((0, 0, 0, 0), (0.6, 0, 0, 0), (0.7, 1, 0, pi / 2))
    np.testing.assert_allclose(cloud.in_world(truth), [(2, 0, 0.4), (1, 2, 0.4)], atol=1e-6)


def test_a_scan_has_its_angles() -> None:
    scan = LaserScan(
        *(0, "scan", -pi / 2, pi / 2, 0.01, 0.1, 0.1, 30.0),
        *(packed(np.array([1.0, np.inf, 3.0], np.float32)), memoryview(b"")),
    )
    cloud = CloudSample("/scan", 0.0, np.eye(4))
    cloud.add(0.0, ros(scan))
    np.testing.assert_allclose(cloud.points, [(0, -1, 0), (0, 3, 0)], atol=1e-6)
    np.testing.assert_allclose(cloud.times, (0.0, 0.02), atol=1e-6)


def test_what_has_a_plot() -> None:
    scenario = load("yard")
    sensors = scenario.vehicles[0].sensors
    kinds = {s.name: type(readings_of(s, scenario.world.datum, 1.0)).__name__ for s in sensors}
    assert kinds["imu"] == "ImuSamples"
    assert kinds["gnss"] == kinds["odometry"] == "EstimatedTrajectory"
    assert kinds["encoders"] == kinds["sonar"] == "NoneType"


def test_how_far_a_cloud_reaches() -> None:
    points = np.array([(float(i), 0.0, 0.0) for i in range(11)])
    assert reach_m(points, (0.0, 0.0)) == pytest.approx(9.0)
    assert reach_m(points[:0], (0.0, 0.0)) == 0.0
