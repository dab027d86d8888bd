# SPDX-License-Identifier: Apache-2.0
"""Layouts of clouds in sensor_msgs/PointCloud2: fields as the drivers of devices have them.

Bus messages always have `POINT` records. Conversions are exact inverses of each other: points that
were converted and read again are converted to the same bytes.

Sources: velodyne_pointcloud (`OrganizedCloudXYZIRT`), ouster-ros (`os_point.h`), Hesai's
HesaiLidar_ROS_2.0 (`source_driver_ros2.hpp`), livox_ros_driver2 (`lddc.cpp`, `xfer_format` 0).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import NANOS
from groundlink.messages.base import POINT, CloudLayout

Points = NDArray[np.void]
Column = NDArray[Any]

_AS_ON_THE_BUS = ("x", "y", "z", "intensity")


class Unchanged:
    """Layout of the bus, which is that of velodyne_pointcloud; a stand-in for `DriverLayout`."""

    record = POINT

    def of(self, points: Points, stamp_nanos: int) -> Points:
        """Return the points."""
        return points

    def points(self, records: Points, stamp_nanos: int) -> Points:
        """Return the points."""
        return records


@dataclass(frozen=True)
class DriverLayout:
    """Layout with x, y, z and intensity as on the bus."""

    record: np.dtype[np.void]
    ring: str
    """Field with the number of the laser."""

    time: str
    """Field with the time of the ray."""

    times: Callable[[Column, int], Column]
    """Convert nanoseconds (int64) after a stamp, and the stamp, to this field."""

    nanos: Callable[[Column, int], Column]
    """Inverse of `times`."""

    others: Mapping[str, Callable[[Points], Column]] = field(default_factory=dict)
    """Further fields by their name, computed from `POINT` records; fields without a row are 0."""

    def of(self, points: Points, stamp_nanos: int) -> Points:
        """Convert `POINT` records, shape (N,), of a cloud with this stamp."""
        made = np.zeros(points.shape, self.record)
        for name in _AS_ON_THE_BUS:
            made[name] = points[name]
        made[self.ring] = points["ring"]
        after = np.rint(points["time"].astype(np.float64) * NANOS).astype(np.int64)
        made[self.time] = self.times(after, stamp_nanos)
        for name, column in self.others.items():
            made[name] = column(points)
        return made

    def points(self, records: Points, stamp_nanos: int) -> Points:
        """Convert records back to `POINT` records."""
        made = np.zeros(records.shape, POINT)
        for name in _AS_ON_THE_BUS:
            made[name] = records[name]
        made["ring"] = records[self.ring]
        made["time"] = self.nanos(records[self.time], stamp_nanos) / NANOS
        return made


def _seconds(after: Column, stamp_nanos: int) -> Column:
    """Return seconds since 1970, rounded once."""
    whole, rest = divmod(stamp_nanos, NANOS)
    seconds: Column = whole + (rest + after) / NANOS
    return seconds


def _after_seconds(seconds: Column, stamp_nanos: int) -> Column:
    """Return nanoseconds after a stamp, of which the seconds are those nearest."""
    whole, rest = divmod(stamp_nanos, NANOS)
    nanos: Column = np.rint((seconds - whole) * NANOS).astype(np.int64) - rest
    return nanos


def _reflectivity(points: Points) -> Column:
    return np.asarray(np.rint(points["intensity"]).clip(0, 2**16 - 1))


def _range_mm(points: Points) -> Column:
    square = sum(points[axis].astype(np.float64) ** 2 for axis in "xyz")
    return np.asarray(np.rint(1000 * np.sqrt(square)).clip(0, 2**32 - 1))


_XYZ = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]

LAYOUTS: dict[CloudLayout, Unchanged | DriverLayout] = {
    "velodyne": Unchanged(),
    "ouster": DriverLayout(
        np.dtype(
            {
                "names": [
                    *("x", "y", "z", "intensity", "t", "reflectivity", "ring", "ambient", "range")
                ],
                "formats": ["<f4", "<f4", "<f4", "<f4", "<u4", "<u2", "<u2", "<u2", "<u4"],
                "offsets": [0, 4, 8, 16, 20, 24, 26, 28, 32],
                "itemsize": 48,
            }
        ),
        "ring",
        "t",
        times=lambda after, stamp_nanos: after,
        nanos=lambda column, stamp_nanos: column.astype(np.int64),
        others={"reflectivity": _reflectivity, "range": _range_mm},
    ),
    "hesai": DriverLayout(
        np.dtype([*_XYZ, ("intensity", "<f4"), ("ring", "<u2"), ("timestamp", "<f8")]),
        "ring",
        "timestamp",
        times=_seconds,
        nanos=_after_seconds,
    ),
    "livox": DriverLayout(
        np.dtype(
            [*_XYZ, ("intensity", "<f4"), ("tag", "u1"), ("line", "u1"), ("timestamp", "<f8")]
        ),
        "line",
        "timestamp",
        times=lambda after, stamp_nanos: stamp_nanos + after,
        nanos=lambda column, stamp_nanos: column.astype(np.int64) - stamp_nanos,
    ),
}
"""Layouts by name."""
