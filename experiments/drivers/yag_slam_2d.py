# SPDX-License-Identifier: Apache-2.0
"""yag-slam on a bag: `python yag_slam_2d.py BAG OUT.tum [--scan /scan] [--odometry /odom] ...`.

Runs in yag-slam's environment; reads ROS messages only. A scan is used if odometry has moved or
turned far enough since the last one. Odometry is interpolated to the middle of the scan, and each
ray is corrected by odometry (during a scan of 25 ms at 0.6 m/s the robot moves 1.5 cm). The
trajectory is that of the scanner's frame at the middle of the scan. Writes the map as PNG and YAML
beside OUT.
"""

from __future__ import annotations

import argparse
import bisect
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

Pose = tuple[float, float, float]
"""x and y in meters, yaw in radians."""
Row = tuple[float, float, float, float]
"""Seconds, x, y, yaw."""

MAP_CELL_M = 0.05
KARTO_OCCUPIED, KARTO_UNKNOWN, KARTO_FREE = 0, 200, 255
"""Of yag-slam's grid."""
OCCUPIED, UNKNOWN, FREE = 0, 205, 254
"""Of map_server's picture, whose first row is the northern one."""
TRINARY = {KARTO_OCCUPIED: OCCUPIED, KARTO_UNKNOWN: UNKNOWN, KARTO_FREE: FREE}


def main() -> None:
    """Read, feed, write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("bag", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--scan", default="/scan")
    parser.add_argument("--odometry", default="/odom")
    parser.add_argument("--move-m", type=float, default=0.1)
    parser.add_argument("--turn-deg", type=float, default=5.0)
    parser.add_argument("--range-m", type=float, default=12.0, help="of returns that are used")
    parser.add_argument("--odometry-alone", action="store_true", help="no SLAM, to compare")
    options = parser.parse_args()
    scans, odometry, scan_in_base = read(options)
    poses = [odometry.at(middle_s(scan)) for scan in scans]
    chosen = choose(poses, options.move_m, math.radians(options.turn_deg))
    if options.odometry_alone:
        rows = [(middle_s(scans[i]), *compose(poses[i], scan_in_base)) for i in chosen]
    else:
        rows = slam(options, [scans[i] for i in chosen], odometry, scan_in_base)
    write(options.out, rows)


class OdometryTrack:
    """x, y and yaw over time."""

    def __init__(self, rows: list[Row]) -> None:
        self.seconds = [row[0] for row in rows]
        table = np.array(rows)
        self._x, self._y, self._yaw = table[:, 1], table[:, 2], np.unwrap(table[:, 3])

    def at(self, seconds: float) -> Pose:
        """Return odom_from_base at a time, interpolated; at the ends it stands."""
        after = min(max(bisect.bisect(self.seconds, seconds), 1), len(self.seconds) - 1)
        before = after - 1
        span = self.seconds[after] - self.seconds[before]
        share = min(max((seconds - self.seconds[before]) / span, 0.0), 1.0)
        x, y, yaw = (
            float(line[before] + share * (line[after] - line[before]))
            for line in (self._x, self._y, self._yaw)
        )
        return x, y, yaw


def seconds_of(header: Any) -> float:
    """Return a header's stamp."""
    return float(header.stamp.sec + 1e-9 * header.stamp.nanosec)


def middle_s(scan: Any) -> float:
    """Return when the middle ray of a scan was measured."""
    half_s = 0.5 * scan.time_increment * (len(scan.ranges) - 1)
    return seconds_of(scan.header) + float(half_s)


def yaw_of(q: Any) -> float:
    """Return the turn about z."""
    return math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))


def read(options: argparse.Namespace) -> tuple[list[Any], OdometryTrack, Pose]:
    """Return all scans, the odometry, and base_from_scan as x, y, yaw."""
    scans: list[Any] = []
    rows: list[Row] = []
    mounts: dict[str, Pose] = {}
    with AnyReader([options.bag], default_typestore=get_typestore(Stores.ROS2_KILTED)) as bag:
        wanted = (options.scan, options.odometry, "/tf_static")
        connections = [c for c in bag.connections if c.topic in wanted]
        for connection, _, raw in bag.messages(connections):
            message: Any = bag.deserialize(raw, connection.msgtype)
            if connection.topic == options.scan:
                scans.append(message)
            elif connection.topic == options.odometry:
                pose = message.pose.pose
                at = (pose.position.x, pose.position.y, yaw_of(pose.orientation))
                rows.append((seconds_of(message.header), *at))
            else:
                for link in message.transforms:
                    t = link.transform
                    at = (t.translation.x, t.translation.y, yaw_of(t.rotation))
                    mounts[link.child_frame_id] = at
    if not scans or len(rows) < 2:
        sys.exit(f"{options.bag}: {len(scans)} scans on {options.scan}, {len(rows)} odometry")
    return scans, OdometryTrack(rows), mounts.get(scans[0].header.frame_id, (0.0, 0.0, 0.0))


def compose(a: Pose, b: Pose) -> Pose:
    """Return a_from_c of a_from_b and b_from_c, each x, y, yaw."""
    c, s = math.cos(a[2]), math.sin(a[2])
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2]


def invert(a: Pose) -> Pose:
    """Return b_from_a of a_from_b."""
    c, s = math.cos(a[2]), math.sin(a[2])
    return -c * a[0] - s * a[1], s * a[0] - c * a[1], -a[2]


def choose(poses: Sequence[Pose], move_m: float, turn: float) -> list[int]:
    """Return the numbers of the scans that are taken."""
    chosen = [0]
    for i, pose in enumerate(poses):
        last = poses[chosen[-1]]
        if math.dist(pose[:2], last[:2]) >= move_m or abs(pose[2] - last[2]) >= turn:
            chosen.append(i)
    return chosen


def straightened(
    scan: Any, odometry: OdometryTrack, scan_in_base: Pose, limit_m: float
) -> list[float]:
    """Return ranges as a scanner would measure them that stands where this one was in the middle.

    The points are put where they were measured from, and sorted into the same directions again.
    """
    ranges = np.asarray(scan.ranges, np.float64)
    count = len(ranges)
    angles = scan.angle_min + scan.angle_increment * np.arange(count)
    start_s = seconds_of(scan.header)
    middle = invert(compose(odometry.at(middle_s(scan)), scan_in_base))
    ends = [
        compose(middle, compose(odometry.at(start_s + k * scan.time_increment), scan_in_base))
        for k in (0, count - 1)
    ]
    share = np.linspace(0.0, 1.0, count)
    x, y, yaw = ((1 - share) * a + share * b for a, b in zip(*ends, strict=True))
    fine = np.isfinite(ranges) & (ranges >= scan.range_min) & (ranges <= limit_m)
    px = (x + ranges * np.cos(angles + yaw))[fine]
    py = (y + ranges * np.sin(angles + yaw))[fine]
    found = np.full(count, 1e3)
    at = np.round((np.arctan2(py, px) - scan.angle_min) / scan.angle_increment).astype(int)
    inside = (at >= 0) & (at < count)
    np.minimum.at(found, at[inside], np.hypot(px, py)[inside])
    ranges_found: list[float] = found.tolist()
    return ranges_found


def counterclockwise(
    ranges: list[float], first: float, step: float
) -> tuple[list[float], float, float, float]:
    """Return ranges with their first angle, last angle and step as yag-slam wants them: growing.

    A scanner that turns clockwise has a negative step.
    """
    last = float(first + step * (len(ranges) - 1))
    if step > 0:
        return ranges, float(first), last, float(step)
    return ranges[::-1], last, float(first), -float(step)


class Mapper:
    """A graph of scans that grows; poses are of the scanner in the frame of the map."""

    def __init__(self, scan_in_base: Pose, range_m: float) -> None:
        from yag_slam.graph_slam import GraphSlam
        from yag_slam.scan_matching import Scan2DMatcherCpp

        self._scan_in_base, self._range_m = scan_in_base, range_m
        matcher = {"range_threshold": range_m, "search_size": 0.3, "smear_deviation": 0.03}
        self._graph = GraphSlam(
            Scan2DMatcherCpp(matcher),
            Scan2DMatcherCpp({"range_threshold": range_m}, loop=True),
            scan_buffer_len=15,
        )
        self._times_s: list[float] = []

    def add(self, scan: Any, odometry: OdometryTrack) -> Row:
        """Take a scan; return its seconds and its pose as it is known by now."""
        from yag_slam.models import LocalizedRangeScan

        pose = compose(odometry.at(middle_s(scan)), self._scan_in_base)
        ranges = straightened(scan, odometry, self._scan_in_base, self._range_m)
        found = LocalizedRangeScan(
            *counterclockwise(ranges, scan.angle_min, scan.angle_increment),
            float(scan.range_min),
            float(scan.range_max),
            self._range_m,
            *pose,
        )
        self._graph.process_scan(found)
        self._times_s.append(middle_s(scan))
        corrected = found.corrected_pose
        return self._times_s[-1], corrected.x, corrected.y, corrected.euler[-1]

    def grid(self) -> Any:
        """Return the map of all scans, as yag-slam has it."""
        return self._graph.make_occupancy_grid(MAP_CELL_M, self._range_m)

    def rows(self) -> list[Row]:
        """Return all poses, after the graph was relaxed once more."""
        self._graph.run_opt()
        poses = [vertex.obj.corrected_pose for vertex in self._graph.graph.vertices]
        return [(t, p.x, p.y, p.euler[-1]) for t, p in zip(self._times_s, poses, strict=True)]


def slam(
    options: argparse.Namespace, scans: Sequence[Any], odometry: OdometryTrack, scan_in_base: Pose
) -> list[Row]:
    """Return seconds, x, y, yaw of the scanner for each scan, as the graph has it at the end."""
    mapper = Mapper(scan_in_base, options.range_m)
    for number, scan in enumerate(scans):
        mapper.add(scan, odometry)
        if number % 20 == 0:
            print(f"progress {number} of {len(scans)} scans", flush=True)
    rows = mapper.rows()
    write_map(options.out, mapper.grid())
    return rows


def write_map(out: Path, grid: Any) -> None:
    """Write the occupancy grid as map_server reads it."""
    import cv2

    cells = np.array(grid.image)
    image = np.full(cells.shape, UNKNOWN, np.uint8)
    for theirs, ours in TRINARY.items():
        image[cells == theirs] = ours
    cv2.imwrite(str(out.with_suffix(".png")), image[::-1])
    out.with_suffix(".yaml").write_text(
        f"image: {out.stem}.png\nresolution: {MAP_CELL_M}\n"
        f"origin: [{grid.offset.x:.4f}, {grid.offset.y:.4f}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n",
        encoding="utf-8",
    )


def write(out: Path, rows: Sequence[Row]) -> None:
    """Write a TUM file."""
    lines = [
        f"{t:.9f} {x:.6f} {y:.6f} 0 0 0 {math.sin(yaw / 2):.9f} {math.cos(yaw / 2):.9f}\n"
        for t, x, y, yaw in rows
    ]
    out.write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
