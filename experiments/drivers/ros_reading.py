# SPDX-License-Identifier: Apache-2.0
"""Bag reading and trajectory writing for drivers: clouds, mounts from /tf_static, TUM files.

Runs in the environment of a program, with numpy and rosbags only.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader

Floats = NDArray[np.float64]

FLOAT32 = 7
"""sensor_msgs/PointField's."""

SWEEPS_HELP = (
    "correct each sweep by the last motion, take it as it is with its pose amid it, or know that "
    "all of it was measured at its stamp (default %(default)s)"
)


class Cloud(NamedTuple):
    """A sensor_msgs/PointCloud2 in numbers."""

    stamp_s: float
    points_m: Floats
    """Shape (N, 3), in the sensor's frame."""

    times_s: Floats
    """Shape (N,), from the stamp."""


def clouds(bag: Path, topic: str) -> Iterator[Cloud]:
    """Yield the clouds of a topic that have fields x, y, z and time, as 32-bit floats."""
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        if not connections:
            raise SystemExit(f"{bag}: no topic {topic}")
        for connection, _, raw in reader.messages(connections):
            yield cloud_of(reader.deserialize(raw, connection.msgtype), f"{bag}: {topic}")


def cloud_of(message: Any, source: str) -> Cloud:
    """Return a sensor_msgs/PointCloud2 in numbers; `source` is named if it lacks a field."""
    wanted = {f.name: f for f in message.fields if f.name in ("x", "y", "z", "time")}
    if len(wanted) < 4 or any(f.datatype != FLOAT32 for f in wanted.values()):
        raise SystemExit(f"{source}: expected fields x, y, z, time of 32-bit floats")
    record = np.dtype(
        {
            "names": list(wanted),
            "formats": ["<f4"] * len(wanted),
            "offsets": [field.offset for field in wanted.values()],
            "itemsize": message.point_step,
        }
    )
    points = np.frombuffer(message.data, record)
    xyz = np.stack([points[name] for name in "xyz"], axis=1).astype(np.float64)
    return Cloud(seconds(message.header.stamp), xyz, points["time"].astype(np.float64))


def seconds(stamp: Any) -> float:
    """Return a builtin_interfaces/Time as seconds."""
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def mount(bag: Path, *, of: str, on: str) -> tuple[Floats, Floats]:
    """Return where a frame is in another one, both fixed to one parent, by /tf_static.

    Returns
    -------
    tuple
        rotation, shape (3, 3), and translation, shape (3,), that take points in `of` into `on`.
    """
    found: dict[str, tuple[str, Floats, Floats]] = {}
    with AnyReader([bag]) as reader:
        for connection, _, raw in reader.messages(
            [c for c in reader.connections if c.topic == "/tf_static"]
        ):
            message: Any = reader.deserialize(raw, connection.msgtype)
            for entry in message.transforms:
                t, q = entry.transform.translation, entry.transform.rotation
                rotation = _matrix(np.array([q.x, q.y, q.z, q.w]))
                place = (entry.header.frame_id, rotation, np.array([t.x, t.y, t.z]))
                found[entry.child_frame_id] = place
    for frame in (of, on):
        if frame not in found:
            raise SystemExit(f"{bag}: /tf_static: no transform of frame {frame}")
    (parent, turned, moved), (other, base_turned, base_moved) = found[of], found[on]
    if parent != other:
        raise SystemExit(
            f"{bag}: /tf_static: {of} is fixed to {parent}, {on} to {other}; expected one parent"
        )
    return base_turned.T @ turned, base_turned.T @ (moved - base_moved)


def write_tum(path: Path, stamps_s: Iterable[float], poses: Iterable[Floats]) -> None:
    """Write poses, each of shape (4, 4), as lines `stamp x y z qx qy qz qw`."""
    lines = []
    for stamp, pose in zip(stamps_s, poses, strict=True):
        numbers = [*pose[:3, 3], *quaternion(pose[:3, :3])]
        lines.append(f"{stamp:.9f} " + " ".join(f"{number:.9f}" for number in numbers))
    path.write_text("\n".join(lines) + "\n")


def quaternion(rotation: Floats) -> Floats:
    """Return the quaternion, xyzw, of a rotation matrix.

    The eigenvector to the largest eigenvalue of K (I. Y. Bar-Itzhack, "New Method for Extracting
    the Quaternion from a Rotation Matrix", 2000): no case is a special one.
    """
    r = rotation
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)],
        ]
    )
    _, vectors = np.linalg.eigh(k, UPLO="L")
    found: Floats = vectors[:, 3]
    return found if found[3] >= 0 else -found


def _matrix(xyzw: Floats) -> Floats:
    x, y, z, w = xyzw / np.linalg.norm(xyzw)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
