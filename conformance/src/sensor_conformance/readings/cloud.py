# SPDX-License-Identifier: Apache-2.0
"""Point clouds."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .base import Floats, Samples, TopicReadings

KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Data types of sensor_msgs/PointField as those of numpy, without byte order."""

BINS = 360
"""Elements of an azimuth profile: one a degree."""


@dataclass(frozen=True)
class CloudField:
    """A field of the points."""

    name: str
    offset: int
    kind: int
    """Number of sensor_msgs/PointField."""
    count: int

    @property
    def size(self) -> int:
        """Bytes."""
        return np.dtype(KINDS[self.kind]).itemsize * max(self.count, 1) if self.kind in KINDS else 0


@dataclass(frozen=True)
class CloudLayout:
    """How a message arranges its points."""

    fields: tuple[CloudField, ...]
    height: int
    width: int
    point_step: int
    row_step: int
    length: int
    """Bytes of `data`."""
    is_bigendian: bool
    is_dense: bool

    @property
    def is_sound(self) -> bool:
        """Whether points can be read."""
        return (
            self.point_step > 0
            and self.length == self.row_step * self.height
            and self.row_step >= self.point_step * self.width
            and all(one.kind in KINDS for one in self.fields)
            and all(one.offset + one.size <= self.point_step for one in self.fields)
        )


class CloudReadings(TopicReadings):
    """Readings of sensor_msgs/PointCloud2: some whole clouds, and an azimuth profile of each."""

    types = ("sensor_msgs/msg/PointCloud2",)

    def prepare(self) -> None:
        """Create the lists."""
        self.layouts: list[CloudLayout] = []
        """One a message."""
        self.clouds: Samples[NDArray[Any]] = Samples()
        """Points as structured arrays."""
        self._profiles: list[Floats] = []

    def take(self, index: int, message: Any) -> None:
        """Take layout and profile; keep some clouds."""
        fields = tuple(
            CloudField(str(one.name), int(one.offset), int(one.datatype), int(one.count))
            for one in message.fields
        )
        data = np.asarray(message.data, np.uint8).reshape(-1)
        layout = CloudLayout(
            fields,
            int(message.height),
            int(message.width),
            int(message.point_step),
            int(message.row_step),
            len(data),
            bool(message.is_bigendian),
            bool(message.is_dense),
        )
        self.layouts.append(layout)
        if not layout.is_sound or not layout.width * layout.height:
            self._profiles.append(np.full(BINS, np.nan))
            return
        points = _points(layout, data)
        self._profiles.append(_profile(points))
        if self.clouds.wants(index):
            self.clouds.keep(index, points.copy())

    def finish(self) -> None:
        """Make the arrays."""
        self.profiles: Floats = np.array(self._profiles, np.float64).reshape(-1, BINS)
        """Median range by azimuth in meters: bin i looks i degrees counterclockwise from -x."""

    @property
    def field_names(self) -> set[str]:
        """Names of the fields of the first message."""
        return {one.name for one in self.layouts[0].fields} if self.layouts else set()


def positions(points: NDArray[Any]) -> Floats:
    """Return x, y, z of points in rows."""
    return np.stack([points[axis].astype(np.float64) for axis in "xyz"], axis=-1)


def _points(layout: CloudLayout, data: NDArray[np.uint8]) -> NDArray[Any]:
    order = ">" if layout.is_bigendian else "<"
    fields = [one for one in layout.fields if one.name]
    kind = np.dtype(
        {
            "names": [one.name for one in fields],
            "formats": [
                order + KINDS[one.kind]
                if one.count <= 1
                else f"({one.count},){order}{KINDS[one.kind]}"
                for one in fields
            ],
            "offsets": [one.offset for one in fields],
            "itemsize": layout.point_step,
        }
    )
    rows = data.reshape(layout.height, layout.row_step)
    used = np.ascontiguousarray(rows[:, : layout.width * layout.point_step])
    return used.reshape(-1).view(kind)


def _profile(points: NDArray[Any]) -> Floats:
    """Return the median range of points near the sensor's horizon for each degree of azimuth."""
    profile = np.full(BINS, np.nan)
    if not {"x", "y", "z"} <= set(points.dtype.names or ()):
        return profile
    x, y, z = positions(points).T
    flat = np.hypot(x, y)
    with np.errstate(invalid="ignore"):
        seen = np.isfinite(flat) & (flat > 0.3) & (np.abs(z) < 0.12 * flat)
    if np.count_nonzero(seen) < BINS:
        return profile
    bins = ((np.arctan2(y[seen], x[seen]) + np.pi) / (2 * np.pi) * BINS).astype(int) % BINS
    order = np.lexsort((flat[seen], bins))
    bins, ranges = bins[order], flat[seen][order]
    edges = np.searchsorted(bins, np.arange(BINS + 1))
    filled = edges[1:] > edges[:-1]
    profile[filled] = ranges[((edges[1:] + edges[:-1]) // 2)[filled]]
    return profile
