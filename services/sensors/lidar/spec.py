# SPDX-License-Identifier: Apache-2.0
"""Specification of a spinning LiDAR in a scenario. The defaults are those of an ideal one."""

import numpy as np

from groundlink.messages.base import POINT, PointCloud, packed
from groundlink.scenario.every_sensor import Address, Carrier
from groundlink.scenario.rotating_lidar import RotatingLidar


class Lidar(RotatingLidar, frozen=True, tag="lidar", kw_only=True):
    """A spinning 3D LiDAR."""

    elevations_deg: tuple[float, ...]
    """Elevation of each laser, from the lowest (ring 0) to the highest."""

    native: Address | None = None
    """Address for the native data packets of a VLP-16, sent in addition. Position packets go to
    port 8308 of the same host."""

    truth: bool = False
    """Publish the true position and the body of each point of a cloud on `<topic>/truth`."""

    @property
    def truth_topic(self) -> str | None:
        """ROS topic of the ground truth behind the clouds; None if it is not published."""
        return f"{self.topic}/truth" if self.truth else None

    def largest_message(self, carrier: Carrier) -> PointCloud:
        """Return a block in which every shot has all its returns."""
        most = self.largest_block_firings * len(self.elevations_deg) * self.returns_per_ray
        points = packed(np.empty(most, POINT).view(np.uint8))
        return PointCloud(0, carrier.frame_prefix + self.frame, points)

    def ros_topics(self) -> dict[str, str]:
        """Return the ROS topics of the clouds and, if published, of their ground truth."""
        return {"": self.topic} | ({"truth": self.truth_topic} if self.truth_topic else {})
