# SPDX-License-Identifier: Apache-2.0
"""Draw each message of the bus in Rerun: one function a message, and the table of them.

A message that cannot be drawn is counted and is no error. Compressed images go to Rerun unchanged.
`draw_imagery` has images and ranges.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import rerun as rr

from groundlink.core.clock import NANOS
from groundlink.core.frames import Floats, transform
from groundlink.messages import imagery, navigation
from groundlink.messages.base import (
    BusMessage,
    Command,
    Imu,
    PointCloud,
    Relayed,
    WheelEncoders,
    floats,
)
from groundlink.messages.ground_truth import Detections2D, Detections3D, LabeledPoints, TruePoints
from groundlink.ros.cdr import READERS
from groundlink.ros.types import STORE
from groundlink.scenario.rotating_lidar import RotatingLidar
from groundlink.scenario.sensor_kinds import load_reference, sensor_kinds
from groundlink.scenario.wheel_encoders import IncrementalEncoders

from . import draw_imagery, draw_ros_messages
from .colors import Colors, of_bodies, of_cells, of_points
from .drawing import WORLD, Drawing, Track, Trail
from .plots import XYZ, XYZ_COLORS
from .point_placement import Reals, points_in_world

ASKED = (255, 170, 60)
"""Color of commands."""

ESTIMATE = (255, 120, 200)
"""Color of poses from a vehicle's own stack."""

MAP_OPACITY = 0.6

POINT_RADIUS = -1.1
"""In points of the screen, which Rerun expresses by a negative radius."""


def command(drawing: Drawing, track: Track, path: str, message: Command) -> None:
    """Plot the commanded beside the true velocity."""
    at = drawing.sim_nanos(message.stamp_nanos)
    name = track.spec.name
    drawing.plots.add(
        f"{name}/speed/commanded", at, [message.linear_mps[0]], ["commanded"], [ASKED]
    )
    drawing.plots.add(
        f"{name}/turning/commanded", at, [message.angular_radps[2]], ["commanded"], [ASKED]
    )


def imu(drawing: Drawing, track: Track, path: str, message: Imu) -> None:
    """Plot acceleration and angular velocity."""
    at = drawing.sim_nanos(message.stamp_nanos)
    for what, values in (
        ("acceleration", message.linear_acceleration_mps2),
        ("angular_velocity", message.angular_velocity_radps),
    ):
        drawing.plots.add(f"{path}/{what}", at, values, XYZ, XYZ_COLORS)


def wheel_encoders(drawing: Drawing, track: Track, path: str, message: WheelEncoders) -> None:
    """Plot each wheel's circumferential speed, from the ticks since the last message."""
    before, drawing.last[path] = drawing.last.get(path), message
    spec = track.sensor(path)
    if not isinstance(before, WheelEncoders) or before.names != message.names:
        return
    seconds = (message.stamp_nanos - before.stamp_nanos) / NANOS
    if seconds <= 0:
        return
    per_tick = {}
    if isinstance(spec, IncrementalEncoders):
        for wheel in track.spec.model.wheels:
            tread = 2 * math.pi * wheel.radius_m / spec.ticks_per_wheel_revolution
            per_tick[wheel.name] = -tread if wheel.name in spec.reversed_wheels else tread
    speeds = [
        (now - then) * per_tick.get(name, 1.0) / seconds
        for name, now, then in zip(message.names, message.ticks, before.ticks, strict=False)
    ]
    names = [name.removesuffix("_wheel") for name in message.names]
    drawing.plots.add(path, drawing.sim_nanos(message.stamp_nanos), speeds, names)


def point_cloud(drawing: Drawing, track: Track, path: str, message: PointCloud) -> None:
    """Draw a revolution in the world, each point with the LiDAR's pose at its instant."""
    records = message.records()
    spec = track.sensor(path)
    rings = len(spec.elevations_deg) if isinstance(spec, RotatingLidar) else 16
    colors = of_points(records, drawing.coloring, rings)
    _points(drawing, track, path, message, records["time"], colors)


def true_points(drawing: Drawing, track: Track, path: str, message: TruePoints) -> None:
    """Draw the true points of a revolution, all of one instant, in the colors of bodies."""
    bodies = message.records()["body"]
    at_once = np.zeros(len(bodies), np.float32)
    _points(drawing, track, path, message, at_once, of_bodies(bodies))


def labeled_points(drawing: Drawing, track: Track, path: str, message: LabeledPoints) -> None:
    """Draw a revolution in the world, in the colors of objects."""
    records = message.records()
    colors = of_bodies(records["instance"].astype(np.uint32))
    _points(drawing, track, path, message, records["time"], colors)


def _points(
    drawing: Drawing,
    track: Track,
    path: str,
    message: PointCloud | TruePoints | LabeledPoints,
    seconds: Reals,
    colors: Colors,
) -> None:
    placing = track.link_from(message.frame)
    records = message.records()
    placed = None
    if placing is not None:
        place, link_from_sensor = placing
        packed = np.stack([records[axis] for axis in XYZ], axis=-1)
        placed = points_in_world(
            packed, seconds, message.stamp_nanos, track.links[place], link_from_sensor
        )
    if placed is None:
        drawing.not_drawn += 1
        return
    if (whole := drawing.revolution(track, path, placed, colors)) is not None:
        points, colors = whole
        drawn = rr.Points3D(points, colors=colors, radii=POINT_RADIUS)
        drawing.log(path, message.stamp_nanos, drawn)


def pose_stamped(
    drawing: Drawing, track: Track, path: str, message: navigation.PoseStamped
) -> None:
    """Draw the stack's estimate of the pose as a line beside the ground truth."""
    _draw_estimate(drawing, track, path, message, message.position_m, message.orientation)


def odometry(drawing: Drawing, track: Track, path: str, message: navigation.Odometry) -> None:
    """Draw odometry as a pose and plot its speed."""
    if path.endswith("/ground_truth"):
        return  # states say the same, and more often
    _draw_estimate(drawing, track, path, message, message.position_m, message.orientation)
    at = drawing.sim_nanos(message.stamp_nanos)
    drawing.plots.add(
        f"{track.spec.name}/speed/odometry", at, [message.linear_mps[0]], ["odometry"]
    )


def _draw_estimate(
    drawing: Drawing, track: Track, path: str, message: Any, position: Any, orientation: Any
) -> None:
    stamp: int = message.stamp_nanos
    if message.frame != WORLD and not _lay(drawing, track, stamp, position, orientation):
        drawing.not_drawn += 1
        return
    drawing.in_frame(path, WORLD if message.frame == WORLD else track.stack_frame)
    trail = drawing.trails.setdefault(path, Trail())
    if trail.add(position):
        line = rr.LineStrips3D([trail.points], colors=[ESTIMATE], radii=[-2.5])
        drawing.log(path, stamp, line)


def _lay(drawing: Drawing, track: Track, stamp: int, position: Any, orientation: Any) -> bool:
    """Align the stack's frame so that its first pose is the true pose of that instant."""
    if track.world_from_stack is None:
        states = track.links[0].span(stamp, stamp)
        if states is None:
            return False
        true = states[1][0]
        stack_from_base = transform(position, orientation)
        world_from_base = transform(true[:3], true[3:])
        track.world_from_stack = world_from_base @ np.linalg.inv(stack_from_base)
        _show_frame(drawing, track, track.world_from_stack)
        for path, waiting in list(drawing.last.items()):
            mine = path.startswith(f"{track.spec.name}/")
            if mine and isinstance(waiting, navigation.OccupancyGrid):
                occupancy_grid(drawing, track, path, waiting)
    return True


def _show_frame(drawing: Drawing, track: Track, world_from_stack: Floats) -> None:
    frame = rr.Transform3D(
        translation=world_from_stack[:3, 3],
        mat3x3=world_from_stack[:3, :3],
        parent_frame=WORLD,
        child_frame=track.stack_frame,
    )
    drawing.recording.log(f"tf/{track.stack_frame}", frame, static=True)


def occupancy_grid(
    drawing: Drawing, track: Track, path: str, message: navigation.OccupancyGrid
) -> None:
    """Draw a map as an image in the plane of its frame."""
    if not message.width or not message.height:
        return
    if message.frame != WORLD and track.world_from_stack is None:
        drawing.last[path] = message  # where the stack's frame lies is known with its first pose
        return
    drawing.in_frame(path, WORLD if message.frame == WORLD else track.stack_frame)
    cells = np.frombuffer(message.cells, np.int8).reshape(message.height, message.width)
    plane = rr.GridMap(
        data=of_cells(cells[::-1]).tobytes(),  # a picture's first row is at its top
        format=rr.components.ImageFormat(
            width=message.width, height=message.height, color_model="RGBA", channel_datatype="U8"
        ),
        cell_size=message.resolution_m,
        translation=message.origin_position_m,
        quaternion=rr.Quaternion(xyzw=message.origin_orientation),
        opacity=MAP_OPACITY,
    )
    drawing.log(path, message.stamp_nanos, plane)


def transforms(drawing: Drawing, track: Track, path: str, message: navigation.Transforms) -> None:
    """Place frames of the stack; the scenario's frames keep their true poses."""
    for t in message.transforms:
        if track.link_from(t.child) is None:
            drawing.move(t.child, t.parent, (*t.translation_m, *t.rotation), t.stamp_nanos)


def joint_state(drawing: Drawing, track: Track, path: str, message: navigation.JointState) -> None:
    """Plot the joints' positions and speeds."""
    if path.endswith("/ground_truth/wheels"):
        return  # encoders show nearly the same
    at = drawing.sim_nanos(message.stamp_nanos)
    for what in ("positions", "velocities"):
        values = floats(getattr(message, what)).tolist()
        if values:
            drawing.plots.add(f"{path}/{what}", at, values, message.names)


def nav_sat_fix(drawing: Drawing, track: Track, path: str, message: navigation.NavSatFix) -> None:
    """Draw the fix and the path of fixes on a map."""
    if message.status < 0:
        return
    fix = (message.latitude_deg, message.longitude_deg)
    here = rr.GeoPoints(lat_lon=[fix], radii=[-6.0], colors=[(255, 90, 60)])
    drawing.log(path, message.stamp_nanos, here)
    trail = drawing.trails.setdefault(path, Trail(3e-7))  # of a degree: 3 cm
    if trail.add(fix) and len(trail.points) > 1:
        way = rr.GeoLineStrings(lat_lon=[trail.points], radii=[-2.0], colors=[(255, 170, 60)])
        drawing.log(f"{path}/way", message.stamp_nanos, way)


RELAYED_FORMS = {
    "nav_msgs/msg/Path": draw_ros_messages.path,
    "sensor_msgs/msg/PointCloud2": draw_ros_messages.point_cloud,
}


def relayed(drawing: Drawing, track: Track, path: str, message: Relayed) -> None:
    """Draw a relayed ROS message by its type, or as the bus message of the same type."""
    if draw := RELAYED_FORMS.get(message.ros_type):
        found = STORE.deserialize_cdr(bytes(message.cdr), message.ros_type)
        draw(drawing, track, path, message.stamp_nanos, found)
        return
    read = READERS.get(message.ros_type)
    known = read(message.cdr, message.stamp_nanos) if read is not None else None
    if isinstance(known, navigation.PoseStamped | navigation.Odometry | navigation.OccupancyGrid):
        FORMS[type(known)](drawing, track, path, known)
    else:
        drawing.not_drawn += 1


Form = Callable[[Drawing, Track, str, Any], None]

FORMS: dict[type[BusMessage], Form] = {
    Command: command,
    Imu: imu,
    PointCloud: point_cloud,
    TruePoints: true_points,
    WheelEncoders: wheel_encoders,
    LabeledPoints: labeled_points,
    Detections2D: draw_imagery.boxes_in_picture,
    Detections3D: draw_imagery.boxes_in_space,
    imagery.Image: draw_imagery.image,
    imagery.CompressedImage: draw_imagery.compressed_image,
    imagery.CameraInfo: draw_imagery.camera_info,
    imagery.LaserScan: draw_imagery.laser_scan,
    imagery.Range: draw_imagery.range_reading,
    imagery.RadarDetections: draw_imagery.radar_detections,
    navigation.PoseStamped: pose_stamped,
    navigation.Odometry: odometry,
    navigation.OccupancyGrid: occupancy_grid,
    navigation.Transforms: transforms,
    navigation.JointState: joint_state,
    navigation.NavSatFix: nav_sat_fix,
    Relayed: relayed,
}
"""Functions by message type. States, clock and health are not messages of a vehicle."""

FORMS |= {
    message: load_reference(support.drawing)
    for kind in sensor_kinds().values()
    for message, support in kind.messages.items()
    if support.drawing
}
