# SPDX-License-Identifier: Apache-2.0
"""Spawn pose of a vehicle: on its wheels, upright on flat ground, tilted on a slope.

On terrain the vehicle takes the tilt of the plane fitted to the ground under its wheels. It is then
raised until no part is below the ground. Physics, pictures and spawn checks use the same pose.
"""

from math import atan, cos, radians, sin

import numpy as np

from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.frames import Floats, matrix_from_quaternion, quaternion_from_rpy
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.bounds import bounds
from groundlink.world.solids import Box, Solid
from groundlink.world.terrain import Ground

SAMPLES = 9
"""Number of sample points along each side of a solid."""

Pose = tuple[Vector3, Quaternion]


def collision_solids(model: VehicleModel) -> list[Solid]:
    """Return the collision solids of a vehicle without its wheels, in the base frame."""
    chassis = Solid("chassis", Box(size_m=model.chassis.size_m), "", model.chassis.center_m)
    return [*([chassis] if model.chassis.collides else []), *model.collisions]


def spawn_pose(vehicle: Vehicle, ground: Ground | None) -> Pose:
    """Return world_from_base of a vehicle at its spawn place.

    Parameters
    ----------
    ground
        the world's terrain; None: flat ground at z = 0.
    """
    model, place = vehicle.model, vehicle.placement
    if ground is None:
        half = radians(place.yaw_deg) / 2
        upright = (place.x_m, place.y_m, place.z_m + model.base_height_m)
        return upright, (0.0, 0.0, sin(half), cos(half))
    centers = np.array([wheel.center_m for wheel in model.wheels])
    radii = np.array([wheel.radius_m for wheel in model.wheels])
    yaw = radians(place.yaw_deg)
    along, across = np.array([cos(yaw), sin(yaw)]), np.array([-sin(yaw), cos(yaw)])
    at = centers[:, :1] * along + centers[:, 1:2] * across + (place.x_m, place.y_m)
    standing = np.array([model.stands_on(wheel) for wheel in model.wheels])
    # z = height + slope_x x + slope_y y, with x forward and y to the left.
    plane = np.column_stack([np.ones(len(centers)), centers[:, :2]])[standing]
    under = _height(ground, at[standing])
    height, slope_x, slope_y = np.linalg.lstsq(plane, under)[0].tolist()
    pitch = -atan(slope_x)
    turn = quaternion_from_rpy(atan(slope_y * cos(pitch)), pitch, yaw)
    rotation = matrix_from_quaternion(turn)
    origin = np.array([place.x_m, place.y_m, height]) + rotation[:, 2] * model.base_height_m
    lowest = [_bottom(solid) for solid in collision_solids(model)]
    points = np.concatenate([*lowest, np.empty((0, 3))]) @ rotation.T + origin
    hubs = centers @ rotation.T + origin
    grid = np.linspace(-1, 1, SAMPLES)
    disc = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    disc = disc[(disc**2).sum(axis=1) <= 1]
    rims = hubs[:, None, :2] + disc * radii[:, None, None]
    rim_z = hubs[:, 2:] - np.sqrt(1 - (disc**2).sum(axis=1)) * radii[:, None]
    in_ground = np.concatenate(
        [_height(ground, points) - points[:, 2], (_height(ground, rims) - rim_z).ravel()]
    )
    x, y, z = origin.tolist()
    return (x, y, z + max(0.0, float(in_ground.max())) + place.z_m), turn


def _height(ground: Ground, points: Floats) -> Floats:
    """Return the ground's z at points, shape (..., 2 or more), clamped to the edge of the map."""
    rows, columns = ground.heights.shape
    x = np.clip(points[..., 0], ground.x0_m, ground.x0_m + (columns - 1) * ground.cell_m)
    y = np.clip(points[..., 1], ground.y0_m, ground.y0_m + (rows - 1) * ground.cell_m)
    return ground.height_at(x, y)


def _bottom(solid: Solid) -> Floats:
    """Return points of the lower side of the box around a solid, shape (N, 3)."""
    low, high = bounds(solid)
    x, y = (np.linspace(low[axis], high[axis], SAMPLES) for axis in (0, 1))
    return np.stack(np.meshgrid(x, y, low[2]), axis=-1).reshape(-1, 3)
