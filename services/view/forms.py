# SPDX-License-Identifier: Apache-2.0
"""How each message of the bus is drawn in Rerun.

Rule: one table, one small function a message; a message that cannot be drawn is counted and never
an error. Pixels are not touched: a compressed image goes to the viewer as it is. Images and ranges
are in `forms_imagery`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import rerun as rr

from groundlink.core.clock import NANOS
from groundlink.core.frames import Floats, transform
from groundlink.messages import imagery, navigation
from groundlink.messages.base import Command, Imu, Message, PointCloud, WheelEncoders, floats
from groundlink.messages.ground_truth import TruePoints
from groundlink.messages.relayed import Relayed
from groundlink.ros.incoming import READERS
from groundlink.ros.types import STORE
from groundlink.scenario.sensors import Encoders, Lidar

from . import forms_imagery, forms_relayed
from .canvas import WORLD, Canvas, Seen, Trail
from .colors import Colours, of_bodies, of_cells, of_points
from .plots import XYZ, XYZ_COLOURS
from .point_placement import Reals, points_in_world

ASKED = (255, 170, 60)
"""Colour of what a vehicle is asked for."""

TOLD = (255, 120, 200)
"""Colour of what comes from a vehicle's own stack; the truth is drawn in another."""

MAP_OPACITY = 0.6

POINT_RADIUS = -1.1
"""In points of the screen, which Rerun says by a negative radius."""


def command(canvas: Canvas, seen: Seen, path: str, message: Command) -> None:
    """Plot what the vehicle is asked for beside what it does."""
    at = canvas.sim_nanos(message.stamp_nanos)
    name = seen.spec.name
    canvas.plots.add(f"{name}/speed/commanded", at, [message.linear_mps[0]], ["commanded"], [ASKED])
    canvas.plots.add(
        f"{name}/turning/commanded", at, [message.angular_radps[2]], ["commanded"], [ASKED]
    )


def imu(canvas: Canvas, seen: Seen, path: str, message: Imu) -> None:
    """Plot acceleration and angular velocity."""
    at = canvas.sim_nanos(message.stamp_nanos)
    for what, values in (
        ("acceleration", message.linear_acceleration_mps2),
        ("angular_velocity", message.angular_velocity_radps),
    ):
        canvas.plots.add(f"{path}/{what}", at, values, XYZ, XYZ_COLOURS)


def wheel_encoders(canvas: Canvas, seen: Seen, path: str, message: WheelEncoders) -> None:
    """Plot the speed of each wheel's tread by the ticks since the message before."""
    before, canvas.last[path] = canvas.last.get(path), message
    spec = seen.sensor(path)
    if not isinstance(before, WheelEncoders) or before.names != message.names:
        return
    seconds = (message.stamp_nanos - before.stamp_nanos) / NANOS
    if seconds <= 0:
        return
    per_tick = {}
    if isinstance(spec, Encoders):
        for wheel in seen.spec.model.wheels:
            tread = 2 * math.pi * wheel.radius_m / spec.ticks_per_wheel_revolution
            per_tick[wheel.name] = -tread if wheel.name in spec.reversed_wheels else tread
    speeds = [
        (now - then) * per_tick.get(name, 1.0) / seconds
        for name, now, then in zip(message.names, message.ticks, before.ticks, strict=False)
    ]
    names = [name.removesuffix("_wheel") for name in message.names]
    canvas.plots.add(path, canvas.sim_nanos(message.stamp_nanos), speeds, names)


def point_cloud(canvas: Canvas, seen: Seen, path: str, message: PointCloud) -> None:
    """Draw a revolution in the world, each point where the LiDAR was at its instant."""
    records = message.records()
    spec = seen.sensor(path)
    rings = len(spec.elevations_deg) if isinstance(spec, Lidar) else 16
    colours = of_points(records, canvas.colouring, rings)
    _points(canvas, seen, path, message, records["time"], colours)


def true_points(canvas: Canvas, seen: Seen, path: str, message: TruePoints) -> None:
    """Draw the truth behind a revolution, which is of one instant, in the colours of bodies."""
    bodies = message.records()["body"]
    at_once = np.zeros(len(bodies), np.float32)
    _points(canvas, seen, path, message, at_once, of_bodies(bodies))


def _points(
    canvas: Canvas,
    seen: Seen,
    path: str,
    message: PointCloud | TruePoints,
    seconds: Reals,
    colours: Colours,
) -> None:
    base_from_sensor = seen.base_from(message.frame)
    records = message.records()
    placed = None
    if base_from_sensor is not None:
        packed = np.stack([records[axis] for axis in XYZ], axis=-1)
        placed = points_in_world(packed, seconds, message.stamp_nanos, seen.base, base_from_sensor)
    if placed is None:
        canvas.not_drawn += 1
        return
    if (whole := canvas.revolution(seen, path, placed, colours)) is not None:
        points, colours = whole
        drawn = rr.Points3D(points, colors=colours, radii=POINT_RADIUS)
        canvas.log(path, message.stamp_nanos, drawn)


def pose_stamped(canvas: Canvas, seen: Seen, path: str, message: navigation.PoseStamped) -> None:
    """Draw where the vehicle's stack believes it to be as a line beside the truth."""
    _told(canvas, seen, path, message, message.position_m, message.orientation)


def odometry(canvas: Canvas, seen: Seen, path: str, message: navigation.Odometry) -> None:
    """Draw it as a pose, and plot its speed."""
    if path.endswith("/ground_truth"):
        return  # states say the same, and more often
    _told(canvas, seen, path, message, message.position_m, message.orientation)
    at = canvas.sim_nanos(message.stamp_nanos)
    canvas.plots.add(f"{seen.spec.name}/speed/odometry", at, [message.linear_mps[0]], ["odometry"])


def _told(
    canvas: Canvas, seen: Seen, path: str, message: Any, position: Any, orientation: Any
) -> None:
    stamp: int = message.stamp_nanos
    if message.frame != WORLD and not _lay(canvas, seen, stamp, position, orientation):
        canvas.not_drawn += 1
        return
    canvas.in_frame(path, WORLD if message.frame == WORLD else seen.stack_frame)
    trail = canvas.trails.setdefault(path, Trail())
    if trail.add(position):
        line = rr.LineStrips3D([trail.points], colors=[TOLD], radii=[-2.5])
        canvas.log(path, stamp, line)


def _lay(canvas: Canvas, seen: Seen, stamp: int, position: Any, orientation: Any) -> bool:
    """Lay the stack's frame so that its first pose is the true one of that instant."""
    if seen.world_from_stack is None:
        states = seen.base.span(stamp, stamp)
        if states is None:
            return False
        true = states[1][0]
        stack_from_base = transform(position, orientation)
        world_from_base = transform(true[:3], true[3:])
        seen.world_from_stack = world_from_base @ np.linalg.inv(stack_from_base)
        _show_frame(canvas, seen, seen.world_from_stack)
        for path, waiting in list(canvas.last.items()):
            mine = path.startswith(f"{seen.spec.name}/")
            if mine and isinstance(waiting, navigation.OccupancyGrid):
                occupancy_grid(canvas, seen, path, waiting)
    return True


def _show_frame(canvas: Canvas, seen: Seen, world_from_stack: Floats) -> None:
    frame = rr.Transform3D(
        translation=world_from_stack[:3, 3],
        mat3x3=world_from_stack[:3, :3],
        parent_frame=WORLD,
        child_frame=seen.stack_frame,
    )
    canvas.recording.log(f"tf/{seen.stack_frame}", frame, static=True)


def occupancy_grid(
    canvas: Canvas, seen: Seen, path: str, message: navigation.OccupancyGrid
) -> None:
    """Draw a map as a picture on the plane of its frame."""
    if not message.width or not message.height:
        return
    if message.frame != WORLD and seen.world_from_stack is None:
        canvas.last[path] = message  # where the stack's frame lies is known with its first pose
        return
    canvas.in_frame(path, WORLD if message.frame == WORLD else seen.stack_frame)
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
    canvas.log(path, message.stamp_nanos, plane)


def transforms(canvas: Canvas, seen: Seen, path: str, message: navigation.Transforms) -> None:
    """Place the frames that others tell of; those of the scenario stay where they truly are."""
    for t in message.transforms:
        if seen.base_from(t.child) is None:
            canvas.move(t.child, t.parent, (*t.translation_m, *t.rotation), t.stamp_nanos)


def joint_state(canvas: Canvas, seen: Seen, path: str, message: navigation.JointState) -> None:
    """Plot the joints' positions and speeds."""
    if path.endswith("/ground_truth/wheels"):
        return  # encoders show nearly the same
    at = canvas.sim_nanos(message.stamp_nanos)
    for what in ("positions", "velocities"):
        values = floats(getattr(message, what)).tolist()
        if values:
            canvas.plots.add(f"{path}/{what}", at, values, message.names)


def nav_sat_fix(canvas: Canvas, seen: Seen, path: str, message: navigation.NavSatFix) -> None:
    """Draw the fix on a map, and the way there."""
    if message.status < 0:
        return
    fix = (message.latitude_deg, message.longitude_deg)
    here = rr.GeoPoints(lat_lon=[fix], radii=[-6.0], colors=[(255, 90, 60)])
    canvas.log(path, message.stamp_nanos, here)
    trail = canvas.trails.setdefault(path, Trail(3e-7))  # of a degree: 3 cm
    if trail.add(fix) and len(trail.points) > 1:
        way = rr.GeoLineStrings(lat_lon=[trail.points], radii=[-2.0], colors=[(255, 170, 60)])
        canvas.log(f"{path}/way", message.stamp_nanos, way)


RELAYED_FORMS = {
    "nav_msgs/msg/Path": forms_relayed.path,
    "sensor_msgs/msg/PointCloud2": forms_relayed.point_cloud,
}


def relayed(canvas: Canvas, seen: Seen, path: str, message: Relayed) -> None:
    """Draw what ROS tells as it came: by its own type, or as what the bus has for it."""
    if draw := RELAYED_FORMS.get(message.ros_type):
        found = STORE.deserialize_cdr(bytes(message.cdr), message.ros_type)
        draw(canvas, seen, path, message.stamp_nanos, found)
        return
    read = READERS.get(message.ros_type)
    known = read(message.cdr, message.stamp_nanos) if read is not None else None
    if isinstance(known, navigation.PoseStamped | navigation.Odometry | navigation.OccupancyGrid):
        FORMS[type(known)](canvas, seen, path, known)
    else:
        canvas.not_drawn += 1


Form = Callable[[Canvas, Seen, str, Any], None]

FORMS: dict[type[Message], Form] = {
    Command: command,
    Imu: imu,
    PointCloud: point_cloud,
    TruePoints: true_points,
    WheelEncoders: wheel_encoders,
    imagery.Image: forms_imagery.image,
    imagery.CompressedImage: forms_imagery.compressed_image,
    imagery.CameraInfo: forms_imagery.camera_info,
    imagery.LaserScan: forms_imagery.laser_scan,
    imagery.Range: forms_imagery.range_reading,
    navigation.PoseStamped: pose_stamped,
    navigation.Odometry: odometry,
    navigation.OccupancyGrid: occupancy_grid,
    navigation.Transforms: transforms,
    navigation.JointState: joint_state,
    navigation.NavSatFix: nav_sat_fix,
    Relayed: relayed,
}
"""Every message of a vehicle that is drawn. States, clock and health are not a vehicle's."""
