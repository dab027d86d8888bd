# SPDX-License-Identifier: Apache-2.0
"""Vehicle models from URDF files.

Fields of the vehicle file override the URDF. URDF has no suspension: each wheel gets a spring that
fits its load.

A vehicle file names the URDF, the joints that carry wheels, and the drive; other fields are
optional::

    urdf: robot.urdf
    wheels: {left_wheel_joint: {}, right_wheel_joint: {}, caster_joint: {caster: true}}
    drive: {kind: differential, max_wheel_torque_nm: 2.0, max_wheel_speed_radps: 20.0}
"""

import re
from collections.abc import Mapping, Sequence
from math import pi
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from groundlink.core.frames import Floats, rpy_from_matrix
from groundlink.importing.file_errors import Warn, ignore_warning
from groundlink.loader.document import DataPath, Document, ScenarioError, SourceLine
from groundlink.world.bounds import bounds
from groundlink.world.solids import Material, Solid

from .bodies import Body, MovingBody, WheelBody, bodies
from .meshes import UrdfMeshes
from .robot import Robot, read_urdf
from .shapes import solids, wheel_size

LEAST_WHEEL_SHARE = 0.08
"""Minimum mass of a wheel as a share of its load: lighter wheels are unstable with steps of 2.5 ms.
Missing mass is taken from the base."""

SPRING_HZ, DAMPING_RATIO = 4.3, 0.84
"""Natural frequency and damping of the base on its springs, as for the shipped rover."""

TRAVEL_SHARE = 0.35
"""Suspension travel to each side, as a share of the wheel's radius."""

Plain = dict[str, Any]


def refuse_bare_urdf(document: Document, path: DataPath) -> None:
    """Refuse a bare URDF name as a vehicle.

    Raises
    ------
    ScenarioError
        with the mistake in the URDF, or with the fields to add.
    """
    given = document.at(path)
    if not isinstance(given, str) or not given.endswith((".urdf", ".xacro")):
        return
    robot = read_urdf(_file(document, path))
    _, whole, _, moving = bodies(robot, (), ())
    moved = (visual for part in moving.values() for visual in part.visuals)
    solids((*whole.visuals, *moved, *whole.collisions), robot.name, UrdfMeshes(ignore_warning))
    wheels = ", ".join(f"{joint}: {{}}" for joint in _turning(robot) or ["JOINT"])
    raise ScenarioError(
        f"{document.mark(path)}: `{path[-1]}`: a URDF does not say how it is driven; write "
        f"`{path[-1]}: {{urdf: {given}, wheels: {{{wheels}}}, drive: {{kind: ...}}}}`"
    )


def expand(document: Document, path: DataPath, warn: Warn) -> None:
    """Expand a vehicle with a URDF into a model; leave other vehicles unchanged.

    `warn` receives warnings about its meshes.

    Raises
    ------
    ScenarioError
        with the mistake in the URDF or in the vehicle's fields.
    """
    given = document.at(path)
    if not isinstance(given, dict) or "urdf" not in given:
        return
    robot = read_urdf(_file(document, (*path, "urdf")))
    own = _wheels(document, (*path, "wheels"), robot)
    casters = [joint for joint, fields in own.items() if fields.get("caster") is True]
    base_frame, base, turning, moving = bodies(robot, list(own), casters)
    model = _model(robot, base_frame, base, turning, meshes := UrdfMeshes(warn))
    model["joints"] = _joints(moving, model["materials"], meshes)
    for index, moved in enumerate(moving.values()):
        document.marks[*path, "joints", index] = moved.joint.element.mark
    for index, (joint, wheel) in enumerate(zip(own, model["wheels"], strict=True)):
        wheel.update(own[joint])
        at, origin = (*path, "wheels", index), turning[joint].joint.element.mark
        document.marks[at] = origin
        for field in own[joint]:
            document.marks[*at, field] = document.mark((*path, "wheels", joint, field))
    for part in ("chassis", "mounts", "materials"):
        if isinstance(given.get(part), dict):
            given[part] = model[part] | given[part]
    place: dict[DataPath, SourceLine] = {(*path, key): base.element.mark for key in model}
    document.marks = place | document.marks
    model.update({key: value for key, value in given.items() if key not in ("urdf", "wheels")})
    given.clear()
    given.update(model)


def _file(document: Document, path: DataPath) -> Path:
    """Return the URDF file that a vehicle names: beside the file that names it, or anywhere."""
    mark, name = document.mark(path), document.at(path)
    file = mark.file.parent / str(name)
    if not file.is_file():
        raise ScenarioError(
            f"{mark}: `{path[-1]}`: no such file: `{file}`; expected a path relative to this file"
        )
    return file


def _wheels(document: Document, path: DataPath, robot: Robot) -> dict[str, Plain]:
    """Return the vehicle's fields for its wheels, by joint name."""
    wheels = document.at(path)
    if isinstance(wheels, dict) and wheels:
        fields = {joint: {} if own is None else own for joint, own in wheels.items()}
        if all(isinstance(own, dict) for own in fields.values()):
            return fields
    turning = _turning(robot)
    such = f", of its continuous ones {', '.join(turning)}" if turning else ""
    raise ScenarioError(
        f"{document.mark(path)}: `wheels`: expected the URDF's joints that carry wheels, as in "
        f"`wheels: {{JOINT: {{friction: 0.8}}, OTHER: {{caster: true}}, ...}}`{such}"
    )


def _turning(robot: Robot) -> list[str]:
    """Return the names of the joints that may carry wheels."""
    return [joint.name for joint in robot.joints.values() if joint.kind == "continuous"]


def _model(
    robot: Robot,
    base_frame: str,
    base: Body,
    turning: Mapping[str, WheelBody],
    meshes: UrdfMeshes,
) -> Plain:
    """Return the model of a URDF as plain data."""
    visuals, materials = solids(base.visuals, base_frame, meshes)
    collisions, _ = solids(base.collisions, base_frame, meshes)
    mass_kg = base.inertial.mass_kg
    load_kg = (mass_kg + sum(w.body.inertial.mass_kg for w in turning.values())) / len(turning)
    wheels = []
    for joint, wheel in turning.items():
        made, own_materials = _wheel(joint, wheel, meshes, least_kg=LEAST_WHEEL_SHARE * load_kg)
        mass_kg -= made["mass_kg"] - wheel.body.inertial.mass_kg
        materials |= own_materials
        wheels.append(made)
    return {
        "name": robot.name,
        "base_frame": base_frame,
        "chassis": {
            "mass_kg": mass_kg,
            "size_m": _size(base.inertial.center_m, collisions or visuals),
            "center_m": base.inertial.center_m.tolist(),
            "inertia_kgm2": np.diag(base.inertial.inertia_kgm2).tolist(),
            "collides": False,
        },
        "suspension": _spring(load_kg, min(wheel["radius_m"] for wheel in wheels)),
        "wheels": wheels,
        "mounts": {
            link: {
                "xyz_m": pose[:3, 3].tolist(),
                "rpy_deg": np.degrees(rpy_from_matrix(pose[:3, :3])).tolist(),
            }
            for link, pose in base.body_from_link.items()
        },
        "collisions": msgspec.to_builtins(collisions),
        "visuals": msgspec.to_builtins(visuals),
        "materials": msgspec.to_builtins(materials),
    }


def _joints(moving: Mapping[str, MovingBody], materials: Plain, meshes: UrdfMeshes) -> list[Plain]:
    """Return the joints moved by servos; add the materials of their visuals."""
    joints = []
    for name, part in moving.items():
        visuals, own_materials = solids(part.visuals, name, meshes)
        materials |= msgspec.to_builtins(own_materials)
        motion = part.joint.motion
        joints.append(
            {
                "name": _name(name, "joint"),
                "kind": "prismatic" if part.joint.kind == "prismatic" else "revolute",
                "parent": _name(part.parent, "joint") if part.parent else None,
                "at_m": part.at_m.tolist(),
                "axis": part.axis.tolist(),
                **msgspec.to_builtins(motion),
                "visuals": msgspec.to_builtins(visuals),
            }
        )
    return joints


def _wheel(
    joint: str, wheel: WheelBody, meshes: UrdfMeshes, *, least_kg: float
) -> tuple[Plain, dict[str, Material]]:
    """Return a wheel and the materials of its visuals."""
    visuals, materials = solids(wheel.body.visuals, joint, meshes)
    touching, touching_materials = solids(wheel.body.collisions, joint, meshes)
    if not (round_parts := touching or visuals):
        raise wheel.body.element.mistake(
            f"the wheel on `{joint}` has no shape; give it a <collision> or a <visual>"
        )
    radius_m, width_m, middle_y_m = wheel_size(round_parts)
    offset = np.array([0.0, middle_y_m, 0.0])
    inertial = wheel.body.inertial
    made = {
        "name": _name(joint, "wheel"),
        "center_m": (wheel.center_m + offset).tolist(),
        "radius_m": radius_m,
        "width_m": width_m,
        "material": next(iter(materials | touching_materials)),
        "mass_kg": max(inertial.mass_kg, least_kg),
        "visuals": [
            {**msgspec.to_builtins(visual), "position_m": (visual.position_m - offset).tolist()}
            for visual in visuals
        ],
    }
    if inertial.mass_kg > 0:
        made["inertia_kgm2"] = float(inertial.inertia_kgm2[1, 1])
    return made, materials or touching_materials


def _spring(load_kg: float, radius_m: float) -> Plain:
    """Return a suspension spring for a wheel load."""
    stiffness_npm = load_kg * (2 * pi * SPRING_HZ) ** 2
    return {
        "travel_m": TRAVEL_SHARE * radius_m,
        "stiffness_npm": stiffness_npm,
        "damping_nspm": 2 * DAMPING_RATIO * (stiffness_npm * load_kg) ** 0.5,
    }


def _size(center_m: Floats, parts: Sequence[Solid]) -> list[float]:
    """Return the size of the box around a center that has the parts' outline and underside."""
    if not parts:
        return [0.1, 0.1, 0.1]
    lows, highs = zip(*map(bounds, parts), strict=True)
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    depth = max(center_m[2] - low[2], 0.01)
    return [float(high[0] - low[0]), float(high[1] - low[1]), float(2 * depth)]


def _name(joint: str, kind: str) -> str:
    """Return a joint's name in lower case, with `_` for characters that names exclude."""
    plain = re.sub(r"[^a-z0-9_]", "_", joint.lower())
    return plain if plain[0].isalpha() else f"{kind}{plain}"
