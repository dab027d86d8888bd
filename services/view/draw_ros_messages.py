# SPDX-License-Identifier: Apache-2.0
"""Draw paths and point clouds of a vehicle's own stack in Rerun.

Their fields are found by name, as other ROS tools do. A cloud without float32 fields x, y and z is
not drawn. Frames of the stack are placed by `drawing`.
"""

from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from groundlink.ros.types import xyz

from .drawing import WORLD, Drawing, Track

PLANNED = (130, 230, 110)
"""Color of a stack's plans and derived data."""

PATH_RADIUS = -2.0
POINT_RADIUS = -1.3
"""In points of the screen, which Rerun expresses by a negative radius."""

_FLOAT32 = 7
"""sensor_msgs/PointField."""


def path(drawing: Drawing, track: Track, entity: str, stamp_nanos: int, message: Any) -> None:
    """Draw a nav_msgs/Path as a line; an empty one removes the last."""
    if _place(drawing, track, entity, message.header.frame_id):
        line = [xyz(row.pose.position) for row in message.poses]
        strips = [line] if len(line) > 1 else []
        drawn = rr.LineStrips3D(strips, colors=[PLANNED], radii=[PATH_RADIUS])
        drawing.log(entity, stamp_nanos, drawn)


def point_cloud(
    drawing: Drawing, track: Track, entity: str, stamp_nanos: int, message: Any
) -> None:
    """Draw the points of a sensor_msgs/PointCloud2."""
    points = _points(message)
    if points is None:
        drawing.not_drawn += 1
    elif _place(drawing, track, entity, message.header.frame_id):
        drawn = rr.Points3D(points, colors=[PLANNED], radii=POINT_RADIUS)
        drawing.log(entity, stamp_nanos, drawn)


def _place(drawing: Drawing, track: Track, entity: str, frame: str) -> bool:
    """Set the frame of an entity; return whether the frame is known."""
    if frame != WORLD and track.link_from(frame) is None:
        if track.world_from_stack is None:
            drawing.not_drawn += 1
            return False
        frame = track.stack_frame
    drawing.in_frame(entity, frame)
    return True


def _points(message: Any) -> NDArray[np.float32] | None:
    """Return the finite points of a cloud, shape (N, 3), meters in its frame; None without any."""
    offsets = {f.name: f.offset for f in message.fields if f.datatype == _FLOAT32}
    count, step = message.width * message.height, message.point_step
    if message.is_bigendian or not {"x", "y", "z"} <= offsets.keys():
        return None
    if count * step != len(message.data) or max(offsets[axis] for axis in "xyz") + 4 > step:
        return None
    record = np.dtype(
        {
            "names": ["x", "y", "z"],
            "formats": ["<f4"] * 3,
            "offsets": [offsets[axis] for axis in "xyz"],
            "itemsize": step,
        }
    )
    records = np.frombuffer(message.data, record)
    points: NDArray[np.float32] = np.stack([records[axis] for axis in "xyz"], axis=-1)
    finite: NDArray[np.float32] = points[np.isfinite(points).all(axis=-1)]
    return finite
