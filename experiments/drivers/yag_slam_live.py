# SPDX-License-Identifier: Apache-2.0
"""yag-slam as a live ROS 2 node: `python yag_slam_live.py OUT.tum --mount X Y YAW`.

Subscribes to /scan and /odom; publishes /pose (of the base) for each scan used, and /map every few
seconds. Matching has a thread of its own; callbacks only store. A scan waits until odometry has
passed its end. Prints statistics as one line of JSON each second, and writes the final poses of the
graph at the end.
"""

from __future__ import annotations

import argparse
import json
import math
import queue
import signal
import statistics
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import LaserScan
from yag_slam_2d import (
    KARTO_FREE,
    KARTO_OCCUPIED,
    MAP_CELL_M,
    Mapper,
    OdometryTrack,
    Pose,
    Row,
    compose,
    invert,
    middle_s,
    seconds_of,
    write,
    write_map,
    yaw_of,
)

FRAME = "map"
DEPTH = 100
REMEMBERED = 500
"""Rows of odometry: 10 s at 50 Hz. A scan that lies longer is not taken any more."""
MAP_EVERY_S = 3.0
TELL_EVERY_S = 1.0
TIMEOUT_S = 1.0
"""For odometry."""
CELLS = {KARTO_OCCUPIED: 100, KARTO_FREE: 0}
"""Of an OccupancyGrid; all else is -1, unknown."""


class Slam(Node):
    """Stores what comes; `match` does the work."""

    def __init__(self, options: argparse.Namespace) -> None:
        super().__init__("yag_slam")
        self._options = options
        self._mount: Pose = tuple(options.mount)
        self.mapper = Mapper(self._mount, options.range_m)
        self._rows: list[Row] = []
        self._moved = threading.Condition()
        self._scans: queue.Queue[tuple[float, Any] | None] = queue.Queue()
        self._last: Pose | None = None
        self._told_s = self._mapped_s = time.monotonic()
        self.counts = {"scans": 0, "taken": 0, "maps": 0, "late": 0, "waiting": 0}
        self._ages_ms: list[float] = []
        self._in_vain = 0
        self._stamp: Any = None  # of the last scan in the map
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._pose = self.create_publisher(PoseStamped, "/pose", 10)
        self._map = self.create_publisher(OccupancyGrid, "/map", latched)
        self.create_subscription(Odometry, "/odom", self._on_odometry, DEPTH)
        self.create_subscription(LaserScan, "/scan", self._on_scan, DEPTH)

    def _on_odometry(self, message: Odometry) -> None:
        pose = message.pose.pose
        row = (pose.position.x, pose.position.y, yaw_of(pose.orientation))
        with self._moved:
            self._rows.append((seconds_of(message.header), *row))
            del self._rows[:-REMEMBERED]
            self._moved.notify()

    def _on_scan(self, message: LaserScan) -> None:
        self._scans.put((time.monotonic(), message))

    def end(self) -> None:
        """Let `match` return once it has taken what waits."""
        self._scans.put(None)

    def match(self) -> None:
        """Take scans until the end."""
        while (item := self._scans.get()) is not None:
            came_s, scan = item
            self.counts["scans"] += 1
            self.counts["waiting"] = max(self.counts["waiting"], self._scans.qsize())
            odometry = self._odometry_around(scan)
            if odometry is None:
                continue
            # When a run ends, odometry does before the last scans; it was late where it goes on.
            self.counts["late"] += self._in_vain
            self._in_vain = 0
            if self._is_wanted(odometry.at(middle_s(scan))):
                self._publish_pose(scan, self.mapper.add(scan, odometry))
                self._stamp = scan.header.stamp
                self.counts["taken"] += 1
                self._ages_ms.append(1000 * (time.monotonic() - came_s))
            self._now_and_then()

    def _odometry_around(self, scan: Any) -> OdometryTrack | None:
        """Wait for odometry behind the end of a scan; None where none comes, or all is younger.

        All is younger only at the start, when scans come before odometry does.
        """
        start_s = seconds_of(scan.header)
        end_s = 2 * middle_s(scan) - start_s
        with self._moved:
            self._moved.wait_for(lambda: self._rows and self._rows[-1][0] >= end_s, TIMEOUT_S)
            rows = list(self._rows)
        if not rows or rows[0][0] > start_s:
            return None
        if rows[-1][0] < end_s:
            self._in_vain += 1
            return None
        return OdometryTrack(rows)

    def _is_wanted(self, pose: Pose) -> bool:
        last = self._last
        is_far = last is None or math.dist(pose[:2], last[:2]) >= self._options.move_m
        if not is_far and last is not None:
            is_far = abs(pose[2] - last[2]) >= math.radians(self._options.turn_deg)
        if is_far:
            self._last = pose
        return is_far

    def _publish_pose(self, scan: Any, row: Row) -> None:
        x, y, yaw = compose(row[1:], invert(self._mount))
        message = PoseStamped()
        message.header.frame_id = FRAME
        message.header.stamp.sec = int(row[0])
        message.header.stamp.nanosec = int(row[0] % 1 * 1e9)
        message.pose.position.x, message.pose.position.y = x, y
        message.pose.orientation.z, message.pose.orientation.w = (
            math.sin(yaw / 2),
            math.cos(yaw / 2),
        )
        self._pose.publish(message)

    def _now_and_then(self) -> None:
        now_s = time.monotonic()
        if now_s - self._mapped_s > MAP_EVERY_S:
            self._publish_map()
            self._mapped_s = time.monotonic()
        if now_s - self._told_s > TELL_EVERY_S:
            self.tell()
            self._told_s = now_s

    def _publish_map(self) -> None:
        grid = self.mapper.grid()
        seen = np.array(grid.image)
        cells = np.full(seen.shape, -1, np.int8)
        for theirs, ours in CELLS.items():
            cells[seen == theirs] = ours
        message = OccupancyGrid()
        message.header.frame_id = FRAME
        message.header.stamp = self._stamp
        message.info.resolution = MAP_CELL_M
        message.info.height, message.info.width = map(int, seen.shape)
        message.info.origin.position.x = grid.offset.x
        message.info.origin.position.y = grid.offset.y
        message.info.origin.orientation.w = 1.0
        message.data.frombytes(cells.tobytes())
        self._map.publish(message)
        self.counts["maps"] += 1

    def tell(self) -> None:
        """Say how it keeps up: milliseconds from a scan's arrival to its pose."""
        ages = self._ages_ms or [0.0]
        words = {"age_ms": round(statistics.median(ages), 1), "oldest_ms": round(max(ages), 1)}
        print(json.dumps(self.counts | words), flush=True)


def main() -> None:
    """Run until it is interrupted."""
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("--mount", type=float, nargs=3, default=(0.0, 0.0, 0.0))
    parser.add_argument("--move-m", type=float, default=0.1)
    parser.add_argument("--turn-deg", type=float, default=5.0)
    parser.add_argument("--range-m", type=float, default=12.0)
    options = parser.parse_args()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Slam(options)
    worker = threading.Thread(target=node.match)
    worker.start()
    is_over = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: is_over.set())
    while not is_over.is_set():
        rclpy.spin_once(node, timeout_sec=0.1)
    node.end()
    worker.join()
    node.tell()
    write(options.out, node.mapper.rows())
    write_map(options.out, node.mapper.grid())


if __name__ == "__main__":
    main()
