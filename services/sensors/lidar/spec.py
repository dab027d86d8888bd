# SPDX-License-Identifier: Apache-2.0
"""Specification of a spinning LiDAR in a scenario. The defaults are those of an ideal one."""

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np

from groundlink.messages.base import POINT, CloudLayout, PointCloud, packed
from groundlink.scenario.every_sensor import Address, Carrier
from groundlink.scenario.rotating_lidar import RotatingLidar, TurningMirror, TurningPrisms


class Lidar(RotatingLidar, frozen=True, tag="lidar", kw_only=True):
    """A spinning 3D LiDAR."""

    elevations_deg: tuple[float, ...]
    """Elevation of each laser, from the lowest (ring 0) to the highest."""

    native: Address | None = None
    """Address for the device's own data packets, sent in addition. Position packets of a VLP-16 go
    to port 8308 of the same host."""

    native_format: Literal[
        "vlp16",
        "hesai_xt32",
        "livox_mid360",
        "livox_avia",
        "livox_avia_spherical",
        "ouster_legacy",
        "ouster_rng19_rfl8_sig16_nir16",
    ] = "vlp16"
    """Format of the device's own packets. Data sheets set that of their device."""

    cloud_layout: CloudLayout = "velodyne"
    """Fields of the clouds in ROS, as the driver of a device has them. `velodyne`: x, y, z,
    intensity, ring, time. `ouster`: x, y, z, intensity, t, reflectivity, ring, ambient, range.
    `hesai`: x, y, z, intensity, ring, timestamp. `livox`: x, y, z, intensity, tag, line,
    timestamp."""

    mirror: TurningMirror | None = None
    """Mirror that scans without repeating itself, instead of a turning head. `elevations_deg` are
    then the offsets of the beams in their fan, in any order, `start_deg` and `rotation` those of
    the mirror, and a revolution is the period of the device's messages."""

    prisms: TurningPrisms | None = None
    """Prisms that scan ahead without repeating themselves, instead of a turning head.
    `elevations_deg` are then the offsets of the beams in their fan, in any order, `start_deg` and
    `rotation` have no meaning, and a revolution is the period of the device's messages."""

    truth: bool = False
    """Publish the true position and the body of each point of a cloud on `<topic>/truth`."""

    labels: tuple[Literal["points", "boxes_3d"], ...] = ()
    """Labels of each cloud under `<topic>/labels`. `points`: the cloud, with class and object of
    each point. `boxes_3d`: a box around each object with points, in the sensor's frame. Default:
    none.
    """

    def _problems(self) -> Iterator[str]:
        """Yield the inconsistencies between fields."""
        yield from super()._problems()
        if self.mirror and self.prisms:
            yield "`mirror` and `prisms` are both set; give the pattern of one of them"
        if (self.mirror or self.prisms) and (self.mixed_pixels or self.blooming):
            yield "`mixed_pixels` and `blooming` need a turning head; got `mirror` or `prisms`"
        if self.prisms and self.elevations_deg:
            index, wedge_rad = self.prisms.refractive_index, math.radians(self.prisms.wedge_deg)
            fan_rad = math.radians(max(map(abs, self.elevations_deg)))
            steepest = 2 * wedge_rad - math.asin(math.sin(wedge_rad) / index) + fan_rad
            if index * math.sin(min(steepest, math.pi / 2)) >= 1:
                yield (
                    f"`prisms`: no beam leaves wedges of {self.prisms.wedge_deg:g} degrees and "
                    f"refractive index {index:g} everywhere; expected less of either"
                )

    @property
    def truth_topic(self) -> str | None:
        """ROS topic of the ground truth behind the clouds; None if it is not published."""
        return f"{self.topic}/truth" if self.truth else None

    def largest_message(self, carrier: Carrier) -> PointCloud:
        """Return a block in which every shot has all its returns."""
        most = self.largest_block_firings * len(self.elevations_deg) * self.returns_per_ray
        points = packed(np.empty(most, POINT).view(np.uint8))
        return PointCloud(0, carrier.frame_prefix + self.frame, points, self.cloud_layout)

    def ros_topics(self) -> dict[str, str]:
        """Return the ROS topics of the clouds and, if published, of truth and labels."""
        topics = {"": self.topic} | ({"truth": self.truth_topic} if self.truth_topic else {})
        beside = ["label_info"] if self.labels else []
        beside += ["labeled_points", "instance_info"] if "points" in self.labels else []
        beside += ["boxes_3d"] if "boxes_3d" in self.labels else []
        names = {"labeled_points": "points"}
        return topics | {
            stream: f"{self.topic}/labels/{names.get(stream, stream)}" for stream in beside
        }
