# SPDX-License-Identifier: Apache-2.0
"""ORB-SLAM3 on a bag: `python orb_slam3.py BAG OUT.tum --vocabulary FILE [--depth TOPIC] ...`.

Runs in ORB-SLAM3's environment; reads ROS messages only. Frames are fed at the recorded rate or
slower, since the mapping threads need time; none is dropped. The trajectory is that of the key
frames of the last map, in the camera's optical frame. OUT.json has statistics of the tracking.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyorbslam3
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

SETTINGS = Path(__file__).with_name("orb_slam3_settings.yaml")
"""As in ORB-SLAM3's own examples. The viewer is not started, but its settings have to be there."""

SHARE = 2.0
"""A frame takes at least so many times what tracking it took, for the map's threads need as much:
on a machine that is too slow for real time, time is stretched."""

NO_MAP = {
    pyorbslam3.TrackingState.SYSTEM_NOT_READY,
    pyorbslam3.TrackingState.NO_IMAGES_YET,
    pyorbslam3.TrackingState.NOT_INITIALIZED,
}

SETTLE_S = 2.0
"""For the map's threads, behind the last frame."""


def main() -> None:
    """Read, feed, write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("bag", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--vocabulary", type=Path, required=True)
    parser.add_argument("--image", default="/camera/image_raw/compressed")
    parser.add_argument("--info", default="/camera/camera_info")
    parser.add_argument("--depth", default="", help="16UC1, in millimeters, of the same pixels")
    parser.add_argument("--features", type=int, default=1200)
    parser.add_argument("--from-s", type=float, default=0.0, help="stamp of the first frame")
    parser.add_argument("--contrast", type=int, default=20, help="of corners at first (FAST)")
    options = parser.parse_args()
    camera, stamps = look(options)
    settings = options.out.with_suffix(".settings.yaml")
    settings.write_text(
        SETTINGS.read_text(encoding="utf-8").format(
            fx=camera.k[0],
            fy=camera.k[4],
            cx=camera.k[2],
            cy=camera.k[5],
            width=camera.width,
            height=camera.height,
            fps=round((len(stamps) - 1) / (stamps[-1] - stamps[0])),
            features=options.features,
            contrast=options.contrast,
            least=min(options.contrast, 7),
        ),
        encoding="utf-8",
    )
    sensor = pyorbslam3.Sensor.RGBD if options.depth else pyorbslam3.Sensor.MONOCULAR
    slam = pyorbslam3.Slam(str(options.vocabulary), str(settings), sensor)
    told = feed(options, slam, len(stamps))
    time.sleep(SETTLE_S)
    slam.shutdown()
    slam.save_keyframe_trajectory_tum(str(options.out))
    in_seconds(options.out)
    options.out.with_suffix(".json").write_text(json.dumps(told), encoding="utf-8")


def seconds_of(header: Any) -> float:
    """Return a header's stamp."""
    return float(header.stamp.sec + 1e-9 * header.stamp.nanosec)


def messages(options: argparse.Namespace, *topics: str) -> Iterator[tuple[str, Any]]:
    """Return the messages of some topics, in the order of their times."""
    with AnyReader([options.bag], default_typestore=get_typestore(Stores.ROS2_KILTED)) as bag:
        connections = [c for c in bag.connections if c.topic in topics]
        for connection, _, raw in bag.messages(connections):
            yield connection.topic, bag.deserialize(raw, connection.msgtype)


def look(options: argparse.Namespace) -> tuple[Any, list[float]]:
    """Return the camera's description, and the stamps of the frames that will be given."""
    found = [message for _, message in messages(options, options.info)]
    stamps = [s for message in found if (s := seconds_of(message.header)) >= options.from_s]
    if len(stamps) < 2:
        sys.exit(f"{options.bag}: {len(stamps)} messages on {options.info}; expected many")
    return found[0], stamps


def frames(options: argparse.Namespace) -> Iterator[tuple[float, Any, Any]]:
    """Return stamp, gray picture, and depth in meters or None, of each frame."""
    waiting: dict[float, dict[str, Any]] = {}
    wanted = {options.image, options.depth} - {""}
    for topic, message in messages(options, *wanted):
        stamp = seconds_of(message.header)
        if stamp < options.from_s:
            continue
        parts = waiting.setdefault(stamp, {})
        parts[topic] = picture(message)
        if parts.keys() == wanted:
            del waiting[stamp]
            yield stamp, parts[options.image], parts.get(options.depth)


def picture(message: Any) -> Any:
    """Return a picture as gray values, or a depth image in meters."""
    if hasattr(message, "format"):
        return cv2.imdecode(np.asarray(message.data), cv2.IMREAD_GRAYSCALE)
    shape = (message.height, message.width)
    data = np.asarray(message.data)
    if message.encoding == "16UC1":
        return data.view(np.uint16).reshape(shape).astype(np.float32) / 1000.0
    if message.encoding == "mono8":
        return data.reshape(shape)
    return cv2.cvtColor(data.reshape(*shape, 3), cv2.COLOR_RGB2GRAY)


def feed(options: argparse.Namespace, slam: Any, count: int) -> dict[str, float]:
    """Give all frames; return what became of them.

    Who is lost for good begins a new map: `map_begun_s` is when that was, after the first frame.
    `pace` is how fast frames were given, 1 for as fast as they were taken.
    """
    tracked, began_s = 0, time.monotonic()
    due_s = rested_s = began_s
    first = last = math.nan
    has_map, map_begun_s = False, math.inf
    for number, (stamp, gray, depth) in enumerate(frames(options)):
        if number:
            due_s = max(due_s + stamp - last, rested_s)
        else:
            first = stamp
        last = stamp
        time.sleep(max(due_s - time.monotonic(), 0.0))
        given_s = time.monotonic()
        if depth is None:
            result = slam.track_monocular(gray, stamp)
        else:
            result = slam.track_rgbd(gray, depth, stamp)
        rested_s = given_s + SHARE * (time.monotonic() - given_s)
        tracked += bool(result.ok)
        if result.ok and not has_map:
            map_begun_s = stamp - first
        has_map = result.state not in NO_MAP
        if number % 30 == 0:
            print(f"progress {number} of {count} frames, {tracked} tracked", flush=True)
    pace = (last - first) / (time.monotonic() - began_s)
    return {"frames": count, "tracked": tracked, "map_begun_s": map_begun_s, "pace": pace}


def in_seconds(tum: Path) -> None:
    """Write stamps in seconds where ORB-SLAM3 has written nanoseconds."""
    rows = [line.split() for line in tum.read_text(encoding="utf-8").splitlines()]
    scale = 1e-9 if rows and float(rows[-1][0]) > 1e8 else 1.0
    lines = [f"{float(row[0]) * scale:.9f} {' '.join(row[1:])}\n" for row in rows]
    tum.write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
