# SPDX-License-Identifier: Apache-2.0
"""Spinning LiDAR model: turn states of the world into one cloud per revolution or block.

The scanner decides what is measured and when; this module converts returns into points. A point is
in the sensor's frame at the instant of its ray, as published by a driver without motion
compensation.
"""

from collections.abc import Iterator

import numpy as np

from groundlink.messages.base import POINT, PointCloud, State, packed
from groundlink.messages.ground_truth import TRUE_POINT, TruePoints
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.labels.cloud_labels import CloudLabels
from services.sensors.rays.kernels import kernels
from services.sensors.rays.scene import Reals
from services.sensors.runtime.model import LeftOut, Made, StreamMessage
from services.sensors.scanning.mirror_sweep import MirrorSweep
from services.sensors.scanning.prism_sweep import PrismSweep
from services.sensors.scanning.scanner import Scan, Scanner
from services.sensors.scanning.sweep import Sweep

from .spec import Lidar


class LidarModel:
    """LiDAR of a vehicle (a `SkippingModel`).

    Attributes
    ----------
    scanner : Scanner

    Raises
    ------
    KernelsMissingError
        when the compiled loops are not installed; a `UserError`.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Lidar) -> None:
        self._frame, self._layout = vehicle.frame_prefix + spec.frame, spec.cloud_layout
        self.scanner = Scanner(
            *(scenario, vehicle, spec, _sweep(spec)), truth=spec.truth, labels=bool(spec.labels)
        )
        self._labels = (
            CloudLabels(scenario, vehicle, self.scanner.replica, spec.mount, spec.labels)
            if spec.labels
            else None
        )
        self.restart, self.behind = self.scanner.restart, self.scanner.behind
        self.settled_tick = self.scanner.settled_tick
        self._seconds: Reals = self.scanner.blocks.since_start(self.scanner.sweep.seconds)

    def readings(self, state: State) -> list[Made]:
        """Take the state of the next tick and return the readings that it completes, oldest first.

        Ground truth and labels follow each cloud if they are enabled.

        Raises
        ------
        BadBusMessage
            when the state lacks a vehicle or a link of the scenario; the model is then restarted.
        """
        found: list[Made] = []
        for scan in self.scanner.take(state):
            if isinstance(scan, LeftOut):
                found.append(scan)
            else:
                found += self._clouds(scan, state.epoch_nanos + scan.nanos)
        return found

    def _clouds(self, scan: Scan, stamp_nanos: int) -> Iterator[PointCloud | StreamMessage]:
        """Yield a cloud and, if enabled, its ground truth and labels in the same order.

        Points are ordered by firing, then by the firing order of the lasers; two returns of a ray
        are adjacent. A point is range times direction, from the laser's origin.
        """
        sweep, returns = self.scanner.sweep, scan.returns
        points = np.empty(np.count_nonzero(returns.returned), POINT)
        true_points = np.empty(len(points), TRUE_POINT)
        of_truth = (None,) * 3 if scan.truth is None else (*scan.truth, true_points)
        of_rays = scan.directions_in_sensor, sweep.heights_m, sweep.rings, self._seconds
        of_hits = returns.range_m, returns.returned, returns.intensity
        stride = returns.range_m.strides[1] // returns.range_m.itemsize
        kernels().groundlink_points(
            *(*sweep.seconds.shape, scan.firings.start, scan.firings.stop),
            *(len(returns.range_m), stride),
            *(array.ctypes.data for array in (*of_rays, *of_hits, points)),
            *(None if array is None else array.ctypes.data for array in of_truth),
        )
        yield PointCloud(stamp_nanos, self._frame, packed(points), self._layout)
        if scan.truth is not None:
            truth = TruePoints(stamp_nanos, self._frame, packed(true_points))
            yield StreamMessage("truth", truth)
        if self._labels is not None and scan.poses is not None:
            header = stamp_nanos, self._frame
            yield from self._labels.of_cloud(*header, points, returns, scan.poses)


def _sweep(spec: Lidar) -> Sweep:
    """Return the sweep of a data sheet: of its mirror, its prisms, or a turning head."""
    if spec.mirror:
        return MirrorSweep(spec, spec.mirror)
    return PrismSweep(spec, spec.prisms) if spec.prisms else Sweep(spec)
