# SPDX-License-Identifier: Apache-2.0
"""A vehicle's model as URDF text with masses, joints and collision shapes.

Wheels collide as spheres: cylinders shake on flat ground (bullet3#2851). A sphere is wider
than its wheel, so wheels touch the ground only and the chassis touches all else. Each wheel slides
along the base's z, held by a spring's force. It neither turns nor steers here: the contacts of a
sphere are the same, and half as many links take half the time. The running gear does both.
"""

from collections.abc import Sequence
from math import radians
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from groundlink.core.fields import Vector3
from groundlink.core.frames import matrix_from_quaternion, rpy_from_matrix
from groundlink.scenario.joints import Arm
from groundlink.scenario.running_gear import Wheel
from groundlink.scenario.vehicle import Chassis, Payload, VehicleModel
from groundlink.world.solids import Box, Cylinder, Mesh, Shape, Solid, Sphere
from services.physics.soil.wheel import DEEPEST

MAX_SPRING_FORCE_N = 1e7
MAX_SPRING_SPEED_MPS = 10.0
"""URDF requires limits for a sliding joint; these are beyond what a spring does."""

HULL_DIRECTIONS = 64
"""More points than twice that make a contact no better, only slower."""

Element = ElementTree.Element


def urdf(model: VehicleModel, payload: Sequence[Payload] = (), *, sinks: bool = False) -> str:
    """Return a URDF document of a model; it refers to its meshes' hulls by `hull_file`.

    Parameters
    ----------
    payload
        fixed to the base, whose frame stays at the center of mass of the chassis.
    sinks
        whether the body comes down to the ground beyond the travel of its springs, since wheels
        sink that stand on the ground here.
    """
    robot = Element("robot", name=model.name)
    base = _sub(robot, "link", name=model.base_frame)
    chassis = model.chassis
    _inertial(base, chassis.mass_kg, chassis_moments(chassis), chassis.center_m)
    if chassis.collides:
        _collision(base, Box(size_m=chassis.size_m), chassis.center_m)
    for part in model.collisions:
        _collision(base, part.shape, part.position_m, _rpy(part))
    for arm in model.arms:
        _arm(robot, model, arm)
    for wheel in model.wheels:
        _wheel(robot, model, wheel, DEEPEST * wheel.radius_m if sinks else 0.0)
    for i, load in enumerate(payload):
        _fix(robot, model.base_frame, f"payload_{i}", load)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode")


def chassis_moments(chassis: Chassis) -> Vector3:
    """Return the principal moments of a chassis, kg m^2: its own, or those of its box."""
    if chassis.inertia_kgm2:
        return chassis.inertia_kgm2
    return box_moments(chassis.mass_kg, chassis.size_m)


def box_moments(mass_kg: float, size_m: Vector3) -> Vector3:
    """Return the principal moments of a uniform box, kg m^2: m (b^2 + c^2) / 12."""
    x, y, z = (length**2 for length in size_m)
    m = mass_kg / 12
    return m * (y + z), m * (x + z), m * (x + y)


def hull_file(mesh: Mesh) -> str:
    """Return the name of the file with the hull of a mesh that collides."""
    return f"{mesh.asset}.obj"


def convex_hull(vertices: NDArray[np.float32]) -> str:
    """Return Wavefront OBJ text of points that span the convex hull of a mesh.

    The points are the vertices that are farthest in evenly spread directions.

    Parameters
    ----------
    vertices
        shape (V, 3), m.
    """
    # Points on a sphere along a spiral whose turns are a golden angle apart.
    steps = np.arange(HULL_DIRECTIONS) + 0.5
    height = 1 - 2 * steps / HULL_DIRECTIONS
    turn = np.pi * (1 + np.sqrt(5)) * steps
    level = np.sqrt(1 - height**2)
    directions = np.stack([level * np.cos(turn), level * np.sin(turn), height], axis=-1)
    # Also along the axes, so that the hull is as long, wide and high as the mesh.
    directions = np.concatenate([directions, np.eye(3), -np.eye(3)])
    farthest = np.unique(np.argmax(vertices.astype(np.float64) @ directions.T, axis=0))
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices[farthest].tolist()]
    # A fan of faces: Bullet reads no points from a file without faces.
    lines += [f"f 1 {i} {i + 1}" for i in range(2, len(farthest))]
    return "\n".join(lines) + "\n"


def suspension_joint(wheel: Wheel) -> str:
    """Return the name of the sliding joint that carries a wheel."""
    return f"{wheel.name}_suspension"


def _fix(robot: Element, base: str, name: str, load: Payload) -> None:
    """Add a load on a joint that does not move."""
    joint = _sub(robot, "joint", name=f"{name}_joint", type="fixed")
    _sub(joint, "parent", link=base)
    _sub(joint, "child", link=name)
    _sub(joint, "origin", xyz=_text(*load.at_m))
    size = load.size_m or (0.0, 0.0, 0.0)
    _inertial(_sub(robot, "link", name=name), load.mass_kg, box_moments(load.mass_kg, size))


def _arm(robot: Element, model: VehicleModel, arm: Arm) -> None:
    """Add an arm on its joint, which is named like the arm."""
    parent, origin = model.base_frame, (0.0, 0.0, 0.0)
    for other in model.arms:
        if other.name == arm.parent:
            parent, origin = f"{other.name}_link", other.pivot_m
    joint = _sub(robot, "joint", name=arm.name, type="revolute")
    _sub(joint, "parent", link=parent)
    _sub(joint, "child", link=f"{arm.name}_link")
    _sub(joint, "axis", xyz="0 1 0")
    _sub(joint, "origin", xyz=_between(origin, arm.pivot_m))
    _sub(
        joint,
        "limit",
        lower=_text(radians(arm.lower_deg)),
        upper=_text(radians(arm.upper_deg)),
        effort=_text(MAX_SPRING_FORCE_N),
        velocity=_text(MAX_SPRING_SPEED_MPS),
    )
    link = _sub(robot, "link", name=f"{arm.name}_link")
    x, y, z = (c - p for c, p in zip(arm.mass_center_m, arm.pivot_m, strict=True))
    _inertial(link, arm.mass_kg, box_moments(arm.mass_kg, arm.size_m), (x, y, z))


def _wheel(robot: Element, model: VehicleModel, wheel: Wheel, sinking_m: float) -> None:
    """Add a wheel on its sliding joint."""
    name = f"{wheel.name}_link"
    slide = _sub(robot, "joint", name=suspension_joint(wheel), type="prismatic")
    carrier, origin = model.base_frame, (0.0, 0.0, 0.0)
    for arm in model.arms:
        if wheel.name in arm.wheels:
            carrier, origin = f"{arm.name}_link", arm.pivot_m
    _sub(slide, "parent", link=carrier)
    _sub(slide, "child", link=name)
    _sub(slide, "axis", xyz="0 0 1")
    _sub(slide, "origin", xyz=_between(origin, wheel.center_m))
    travel = (wheel.suspension or model.suspension).travel_m
    _sub(
        slide,
        "limit",
        lower=_text(-travel),
        upper=_text(travel + sinking_m),
        effort=_text(MAX_SPRING_FORCE_N),
        velocity=_text(MAX_SPRING_SPEED_MPS),
    )
    link = _sub(robot, "link", name=name)
    across = wheel.mass_kg * (3 * wheel.radius_m**2 + wheel.width_m**2) / 12
    _inertial(link, wheel.mass_kg, (across, wheel.axle_inertia_kgm2, across))
    _collision(link, Sphere(radius_m=wheel.radius_m))


def _inertial(link: Element, mass: float, moments: Vector3, at: Vector3 = (0.0, 0.0, 0.0)) -> None:
    inertial = _sub(link, "inertial")
    _sub(inertial, "origin", xyz=_text(*at))
    _sub(inertial, "mass", value=_text(mass))
    # Bullet rejects a moment above the sum of the others, and sets all of them to zero.
    most = (1 - 1e-9) * sum(moments)
    ixx, iyy, izz = (_text(min(moment, most - moment)) for moment in moments)
    _sub(inertial, "inertia", ixx=ixx, iyy=iyy, izz=izz, ixy="0", ixz="0", iyz="0")


def _collision(
    link: Element, shape: Shape, at: Vector3 = (0.0, 0.0, 0.0), rpy: Vector3 = (0.0, 0.0, 0.0)
) -> None:
    element = _sub(link, "collision")
    _sub(element, "origin", xyz=_text(*at), rpy=_text(*rpy))
    geometry = _sub(element, "geometry")
    if isinstance(shape, Box):
        _sub(geometry, "box", size=_text(*shape.size_m))
    elif isinstance(shape, Cylinder):
        _sub(geometry, "cylinder", radius=_text(shape.radius_m), length=_text(shape.length_m))
    elif isinstance(shape, Sphere):
        _sub(geometry, "sphere", radius=_text(shape.radius_m))
    else:
        _sub(geometry, "mesh", filename=hull_file(shape))


def _rpy(solid: Solid) -> Vector3:
    """Return roll, pitch, yaw about the fixed axes of a solid's orientation."""
    return rpy_from_matrix(matrix_from_quaternion(solid.orientation))


def _sub(parent: Element, tag: str, **attributes: str) -> Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _between(origin: Vector3, place: Vector3) -> str:
    return _text(*(b - a for a, b in zip(origin, place, strict=True)))


def _text(*numbers: float) -> str:
    return " ".join(repr(float(number)) for number in numbers)
