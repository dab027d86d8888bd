# SPDX-License-Identifier: Apache-2.0
"""Clouds have the fields that drivers of devices give them, and become the same bytes again."""

from typing import Any

import numpy as np
import pytest

from groundlink.messages.base import POINT, CloudLayout, PointCloud, decode, encode, packed
from groundlink.ros.cdr import from_cdr, to_cdr
from groundlink.ros.cloud_layouts import LAYOUTS
from groundlink.ros.codec import Moment
from groundlink.ros.types import STORE

STAMP_NANOS = 1_700_000_000_123_456_789
U1, U2, U4, F4, F8 = 2, 4, 6, 7, 8
"""UINT8, UINT16, UINT32, FLOAT32 and FLOAT64 of sensor_msgs/PointField."""

XYZ = [("x", 0, F4), ("y", 4, F4), ("z", 8, F4)]
DRIVERS: dict[CloudLayout, tuple[int, list[tuple[str, int, int]]]] = {
    # As of velodyne_pointcloud; pinned here, since it is the default.
    "velodyne": (22, [*XYZ, ("intensity", 12, F4), ("ring", 16, U2), ("time", 18, F4)]),
    # ouster-ros, os_point.h: PCL_ADD_POINT4D takes 16 bytes, the whole is a multiple of 16.
    "ouster": (
        48,
        [
            *(*XYZ, ("intensity", 16, F4), ("t", 20, U4), ("reflectivity", 24, U2)),
            *(("ring", 26, U2), ("ambient", 28, U2), ("range", 32, U4)),
        ],
    ),
    # HesaiLidar_ROS_2.0, source_driver_ros2.hpp.
    "hesai": (26, [*XYZ, ("intensity", 12, F4), ("ring", 16, U2), ("timestamp", 18, F8)]),
    # livox_ros_driver2, lddc.cpp, InitPointcloud2MsgHeader; `LivoxPointXyzrtlt` is packed.
    "livox": (
        26,
        [
            *(*XYZ, ("intensity", 12, F4), ("tag", 16, U1), ("line", 17, U1)),
            ("timestamp", 18, F8),
        ],
    ),
}
POINTS = np.array(
    [(1.0, -2.0, 2.0, 80.4, 3, 0.0), (-4.0, 0.5, 0.25, 255.0, 5, 0.012_345_678)], POINT
)


def cdr(layout: CloudLayout, points: np.ndarray = POINTS, stamp_nanos: int = STAMP_NANOS) -> bytes:
    return bytes(to_cdr(PointCloud(stamp_nanos, "lidar_link", packed(points), layout)))


def ros(layout: CloudLayout) -> Any:
    return STORE.deserialize_cdr(cdr(layout), "sensor_msgs/msg/PointCloud2")


def test_every_layout_is_compared() -> None:
    assert DRIVERS.keys() == LAYOUTS.keys()


@pytest.mark.parametrize("layout", DRIVERS)
def test_fields_are_those_of_the_driver(layout: CloudLayout) -> None:
    step, fields = DRIVERS[layout]
    cloud = ros(layout)
    assert (cloud.point_step, cloud.row_step, len(cloud.data)) == (step, 2 * step, 2 * step)
    assert (cloud.height, cloud.width, cloud.is_dense, cloud.is_bigendian) == (1, 2, True, False)
    assert [(one.name, one.offset, one.datatype) for one in cloud.fields] == fields
    assert {one.count for one in cloud.fields} == {1}


def columns(layout: CloudLayout) -> dict[str, list[float]]:
    """Return the values of a cloud's fields, read by the fields of its own message."""
    cloud = ros(layout)
    kinds = {U1: "u1", U2: "<u2", U4: "<u4", F4: "<f4", F8: "<f8"}
    record = np.dtype(
        {
            "names": [one.name for one in cloud.fields],
            "formats": [kinds[one.datatype] for one in cloud.fields],
            "offsets": [one.offset for one in cloud.fields],
            "itemsize": cloud.point_step,
        }
    )
    rows = np.frombuffer(cloud.data.tobytes(), record)
    return {name: rows[name].tolist() for name in record.names or ()}


def test_values_are_in_the_units_of_the_drivers() -> None:
    for layout in DRIVERS:
        found = columns(layout)
        for name in ("x", "y", "z", "intensity"):
            assert found[name] == POINTS[name].tolist()
        assert found.get("ring", found.get("line")) == [3, 5]
    ouster, hesai, livox = columns("ouster"), columns("hesai"), columns("livox")
    assert ouster["t"] == [0, 12_345_678]
    assert (ouster["reflectivity"], ouster["ambient"]) == ([80, 255], [0, 0])
    assert ouster["range"] == [3000, round(1000 * np.sqrt(16.3125))]
    # float64 has steps of 0.24 us of seconds since 1970, and of 256 ns of nanoseconds.
    exact = [STAMP_NANOS, STAMP_NANOS + 12_345_678]
    assert 1e9 * (np.array(hesai["timestamp"]) - 1_700_000_000) == pytest.approx(
        np.array(exact) - 1_700_000_000 * 10**9, abs=150
    )
    assert livox["timestamp"] == [float(one) for one in exact]
    assert livox["tag"] == [0, 0]


@pytest.mark.parametrize("layout", DRIVERS)
@pytest.mark.parametrize("stamp_nanos", [0, 999_999_999, STAMP_NANOS])
def test_read_clouds_become_the_same_bytes(layout: CloudLayout, stamp_nanos: int) -> None:
    source = np.random.default_rng(1)
    points = np.zeros(5_000, POINT)
    for axis in "xyz":
        points[axis] = source.normal(0, 40, len(points))
    points["intensity"] = source.uniform(0, 255, len(points))
    points["ring"] = source.integers(0, 128, len(points))
    points["time"] = source.uniform(0, 0.2, len(points))
    written = cdr(layout, points, stamp_nanos)
    cloud = from_cdr(written, PointCloud, Moment(0, 0))
    assert (cloud.layout, cloud.stamp_nanos, cloud.frame) == (layout, stamp_nanos, "lidar_link")
    assert np.abs(cloud.records()["time"] - points["time"]).max() < 2e-7
    assert bytes(to_cdr(cloud)) == written


def test_the_default_adds_nothing_on_the_bus() -> None:
    cloud = PointCloud(1, "lidar_link", packed(POINTS))
    assert cloud.layout == "velodyne"
    assert b"layout" not in encode(cloud)
    assert (
        decode(encode(PointCloud(1, "f", packed(POINTS), "ouster")), PointCloud).layout == "ouster"
    )
