# SPDX-License-Identifier: Apache-2.0
"""URDF shapes as solids, and URDF colors as materials.

URDF has no reflectivity; it is derived from the color.
"""

from collections.abc import Iterable

import numpy as np

from groundlink.core.frames import matrix_from_quaternion, quaternion_from_rpy, rpy_from_matrix
from groundlink.world.bounds import bounds, half_extents
from groundlink.world.mesh_asset import load_mesh
from groundlink.world.solids import Box, Cylinder, Material, Mesh, Shape, Solid, Sphere

from .bodies import Placed
from .elements import XmlElement
from .meshes import UrdfMeshes

MAX_SIZE_M = 20.0
"""Maximum size of a vehicle part; larger sizes are taken for millimeters."""

DEFAULT_RGBA = (0.7, 0.7, 0.7, 1.0)
MIN_REFLECTIVITY, MAX_REFLECTIVITY = 0.05, 0.9
"""Diffuse reflectance of black rubber and of white paint."""


def solids(
    placed: Iterable[Placed], name: str, meshes: UrdfMeshes
) -> tuple[list[Solid], dict[str, Material]]:
    """Return shapes as solids named `name`, `name_2` and so on, and their materials."""
    made, materials = [], {}
    for number, (pose, geometry) in enumerate(placed, 1):
        material, materials[material] = _material(geometry.color or DEFAULT_RGBA)
        made.append(
            Solid(
                name if number == 1 else f"{name}_{number}",
                _in_meters(geometry.element, _shape(geometry.element, meshes)),
                material,
                (float(pose[0, 3]), float(pose[1, 3]), float(pose[2, 3])),
                quaternion_from_rpy(*rpy_from_matrix(pose[:3, :3])),
            )
        )
    return made, materials


def _shape(element: XmlElement, meshes: UrdfMeshes) -> Shape:
    match element.tag:
        case "box":
            x, y, z = element.positive("size", 3)
            return Box(size_m=(x, y, z))
        case "cylinder":
            (radius_m,), (length_m,) = element.positive("radius"), element.positive("length")
            return Cylinder(radius_m=radius_m, length_m=length_m)
        case "sphere":
            return Sphere(radius_m=element.positive("radius")[0])
    return meshes.get(element)


def _in_meters(element: XmlElement, shape: Shape) -> Shape:
    """Return a shape; refuse one that is too large for a vehicle part."""
    size_m = 2 * half_extents(shape)
    if max(size_m) > MAX_SIZE_M:
        large = " x ".join(f"{length:.4g}" for length in size_m)
        mend = ' or set scale="0.001 0.001 0.001"' if element.tag == "mesh" else ""
        raise element.mistake(
            f"it is {large} m large; a URDF is in meters, this looks like millimeters: "
            f"divide them by 1000{mend}"
        )
    return shape


def _material(rgba: tuple[float, ...]) -> tuple[str, Material]:
    """Return the name and the material of an sRGB color."""
    coded = [round(part * 255) for part in rgba[:3]]
    # IEC 61966-2-1.
    red, green, blue = (
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
        for c in (part / 255 for part in coded)
    )
    light = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    reflectivity = min(max(light, MIN_REFLECTIVITY), MAX_REFLECTIVITY)
    name = "urdf_{:02x}{:02x}{:02x}".format(*coded)
    return name, Material(reflectivity=reflectivity, color=(red, green, blue), friction=0.5)


def wheel_size(parts: Iterable[Solid]) -> tuple[float, float, float]:
    """Return radius, width and y of the middle of solids that rotate about their frame's y axis."""
    radius, low, high = 0.0, np.inf, -np.inf
    for part in parts:
        corners = bounds(part)
        turn = matrix_from_quaternion(part.orientation)
        match part.shape:
            case Cylinder(radius_m=own, length_m=length) if abs(turn[1, 2]) > 0.99:
                y, half = part.position_m[1], length / 2
                corners = np.array([-own, y - half, -own]), np.array([own, y + half, own])
            case Mesh(asset=asset):
                points = load_mesh(asset).vertices @ turn.T + part.position_m
                reach = float(np.hypot(points[:, 0], points[:, 2]).max())
                y_low, y_high = points[:, 1].min(), points[:, 1].max()
                corners = np.array([-reach, y_low, -reach]), np.array([reach, y_high, reach])
        radius = max(radius, *(corners[1] - corners[0])[[0, 2]] / 2)
        low, high = min(low, corners[0][1]), max(high, corners[1][1])
    return float(radius), float(high - low), float(high + low) / 2
