# SPDX-License-Identifier: Apache-2.0
"""A vehicle's model as URDF text.

Rule: what the text says is all that a physics engine or a viewer needs; springs, motors and contact
filters are no part of URDF and come from the model.

Wheels collide as spheres: cylinders shake on flat ground (bullet3 issue 2851). A sphere sticks out
sideways, so wheels are to meet the ground only and the chassis meets the rest. Each hangs on a
knuckle, a light link that slides along the base's z, which a spring force holds up.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from xml.etree import ElementTree

import numpy as np

from groundlink.frames import matrix_from_quaternion
from groundlink.scenario.vehicle import VehicleModel, Wheel
from groundlink.world.solids import Box, Cylinder, Material, Shape, Solid, Sphere, Vector3

KNUCKLE_SHARE = 0.1
"""Of a wheel's mass, what slides but does not turn."""

KNUCKLE_RADIUS_M = 0.05
"""Of the ball whose inertia a knuckle has."""

MAX_SPRING_FORCE_N = 1e5
MAX_SPRING_SPEED_MPS = 10.0
"""URDF demands limits for a sliding joint; these are beyond what a spring does."""

Element = ElementTree.Element


def urdf(model: VehicleModel, materials: Mapping[str, Material]) -> str:
    """Return a URDF document of `model`; `materials` give its visuals their colours."""
    robot = Element("robot", name=model.name)
    names = sorted({v.material for v in model.visuals} | {w.material for w in model.wheels})
    for name in names:
        material = _sub(robot, "material", name=name)
        _sub(material, "color", rgba=_text(*materials[name].color, 1.0))
    base = _sub(robot, "link", name=model.base_frame)
    chassis = model.chassis
    box = Box(size_m=chassis.size_m)
    _inertial(base, chassis.mass_kg, _box_inertia(chassis.mass_kg, box), chassis.center_m)
    _geometry(base, "collision", box, chassis.center_m)
    for part in model.collisions:
        _geometry(base, "collision", part.shape, part.position_m, _rpy(part))
    for part in model.visuals:
        visual = _geometry(base, "visual", part.shape, part.position_m, _rpy(part))
        _sub(visual, "material", name=part.material)
    for wheel in model.wheels:
        _wheel(robot, model, wheel)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode")


def knuckle_joint(wheel: Wheel) -> str:
    """Return the name of the sliding joint that carries a wheel."""
    return f"{wheel.name}_suspension"


def rim_mass(wheel: Wheel) -> float:
    """Return a wheel's moment of inertia over its radius squared, kg: half of what turns."""
    return (1 - KNUCKLE_SHARE) * wheel.mass_kg / 2


def _wheel(robot: Element, model: VehicleModel, wheel: Wheel) -> None:
    """Add a wheel's knuckle and the wheel itself, with their joints."""
    name = f"{wheel.name}_knuckle"
    knuckle = _sub(robot, "link", name=name)
    mass = KNUCKLE_SHARE * wheel.mass_kg
    ball = 0.4 * mass * KNUCKLE_RADIUS_M**2
    _inertial(knuckle, mass, (ball, ball, ball))
    slide = _joint(robot, knuckle_joint(wheel), "prismatic", model.base_frame, name, (0, 0, 1))
    _sub(slide, "origin", xyz=_text(*wheel.center_m))
    travel = model.suspension.travel_m
    _sub(
        slide,
        "limit",
        lower=_text(-travel),
        upper=_text(travel),
        effort=_text(MAX_SPRING_FORCE_N),
        velocity=_text(MAX_SPRING_SPEED_MPS),
    )

    link = _sub(robot, "link", name=f"{wheel.name}_link")
    mass = wheel.mass_kg - mass
    across = mass * (3 * wheel.radius_m**2 + wheel.width_m**2) / 12
    _inertial(link, mass, (across, rim_mass(wheel) * wheel.radius_m**2, across))
    _geometry(link, "collision", Sphere(radius_m=wheel.radius_m))
    cylinder = Cylinder(radius_m=wheel.radius_m, length_m=wheel.width_m)
    visual = _geometry(link, "visual", cylinder, rpy=(pi / 2, 0, 0))
    _sub(visual, "material", name=wheel.material)
    axle = _joint(robot, wheel.name, "continuous", name, f"{wheel.name}_link", (0, 1, 0))
    _sub(
        axle,
        "limit",
        effort=_text(model.drive.max_wheel_torque_nm),
        velocity=_text(model.drive.max_wheel_speed_radps),
    )


def _joint(robot: Element, name: str, kind: str, parent: str, child: str, axis: Vector3) -> Element:
    joint = _sub(robot, "joint", name=name, type=kind)
    _sub(joint, "parent", link=parent)
    _sub(joint, "child", link=child)
    _sub(joint, "axis", xyz=_text(*axis))
    return joint


def _inertial(link: Element, mass: float, moments: Vector3, at: Vector3 = (0.0, 0.0, 0.0)) -> None:
    inertial = _sub(link, "inertial")
    _sub(inertial, "origin", xyz=_text(*at))
    _sub(inertial, "mass", value=_text(mass))
    ixx, iyy, izz = map(_text, moments)
    _sub(inertial, "inertia", ixx=ixx, iyy=iyy, izz=izz, ixy="0", ixz="0", iyz="0")


def _geometry(
    link: Element,
    role: str,
    shape: Shape,
    at: Vector3 = (0.0, 0.0, 0.0),
    rpy: Vector3 = (0.0, 0.0, 0.0),
) -> Element:
    element = _sub(link, role)
    _sub(element, "origin", xyz=_text(*at), rpy=_text(*rpy))
    geometry = _sub(element, "geometry")
    if isinstance(shape, Box):
        _sub(geometry, "box", size=_text(*shape.size_m))
    elif isinstance(shape, Cylinder):
        _sub(geometry, "cylinder", radius=_text(shape.radius_m), length=_text(shape.length_m))
    else:
        _sub(geometry, "sphere", radius=_text(shape.radius_m))
    return element


def _box_inertia(mass: float, box: Box) -> Vector3:
    """Return the principal moments of a uniform box: m (b^2 + c^2) / 12."""
    x, y, z = (length**2 for length in box.size_m)
    return mass * (y + z) / 12, mass * (x + z) / 12, mass * (x + y) / 12


def _rpy(solid: Solid) -> Vector3:
    """Return roll, pitch, yaw about the fixed axes of a solid's orientation."""
    m = matrix_from_quaternion(solid.orientation)
    roll, yaw = np.arctan2(m[2, 1], m[2, 2]), np.arctan2(m[1, 0], m[0, 0])
    return float(roll), float(np.arcsin(np.clip(-m[2, 0], -1, 1))), float(yaw)


def _sub(parent: Element, tag: str, **attributes: str) -> Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _text(*numbers: float) -> str:
    return " ".join(repr(float(number)) for number in numbers)
