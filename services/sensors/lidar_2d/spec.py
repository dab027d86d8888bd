# SPDX-License-Identifier: Apache-2.0
"""Specification of a planar laser scanner in a scenario."""

from collections.abc import Iterator

import numpy as np

from groundlink.messages.base import packed
from groundlink.messages.imagery import LaserScan
from groundlink.scenario.every_sensor import Carrier
from groundlink.scenario.rotating_lidar import RotatingLidar


class Lidar2d(RotatingLidar, frozen=True, tag="lidar_2d", kw_only=True):
    """A planar scanner: one rotating laser."""

    def _problems(self) -> Iterator[str]:
        yield from super()._problems()
        if self.elevations_deg != (0.0,):
            yield "`elevations_deg` is for LiDARs of kind `lidar`; leave it out"
        if self.azimuth_resolution_deg:
            yield "`azimuth_resolution_deg` is for LiDARs of kind `lidar`; leave it out"
        if self.returns == "dual":
            yield "`returns` is `dual`, but a scan holds one range a ray; choose one of them"

    def largest_message(self, carrier: Carrier) -> LaserScan:
        """Return a block; it holds a range for each ray, with or without a return."""
        rays = packed(np.empty(self.largest_block_firings, np.float32))
        frame = carrier.frame_prefix + self.frame
        return LaserScan(0, frame, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, rays, rays)
