# SPDX-License-Identifier: Apache-2.0
"""The world and the vehicles as a foxglove.SceneUpdate, for the 3D panel.

Each solid becomes a primitive in the color of its material; meshes and terrain become triangles.
The ceiling is left out, so that rooms can be seen from above. Wheels do not turn, since the tf tree
has no frames for them.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from foxglove.messages import (
    Color,
    CubePrimitive,
    CylinderPrimitive,
    Duration,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    SpherePrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector3,
)
from msgspec.structs import replace

from groundlink.core.clock import NANOS
from groundlink.scenario import Scenario
from groundlink.scenario.joints import base_from_links
from groundlink.scenario.schema import Vehicle
from groundlink.scene.bodies import link_solids
from groundlink.scene.build import solids
from groundlink.world import actors
from groundlink.world.solids import Box, Cylinder, Material, Solid
from groundlink.world.solids import Mesh as MeshShape
from groundlink.world.terrain import BODY

from .meshes import ShadedMesh, mesh, rgba, terrain

WORLD = "world"
CEILING = "room_ceiling"


def scene(scenario: Scenario, stamp_nanos: int) -> SceneUpdate:
    """Return all visible things of a run, in the frames of its tf tree."""
    materials = scenario.world.materials
    still = [solid for solid in solids(scenario) if solid.name != CEILING]
    entities = [_entity(WORLD, WORLD, still, materials, stamp_nanos)]
    if ground := terrain(scenario):
        entities.append(_entity(BODY, WORLD, (), materials, stamp_nanos, [ground]))
    for vehicle in scenario.vehicles:
        frame = vehicle.frame_prefix + vehicle.model.base_frame
        entities.append(_entity(vehicle.name, frame, _body(vehicle), materials, stamp_nanos))
    for actor in scenario.world.actors:
        it = actors.form_solids(actor.form)
        entities.append(_entity(actor.name, actor.name, it, materials, stamp_nanos))
    # Removes entities of the scene before.
    now = Timestamp(sec=stamp_nanos // NANOS, nsec=stamp_nanos % NANOS)
    everything = SceneEntityDeletion(timestamp=now, type=SceneEntityDeletionType.All)
    return SceneUpdate(deletions=[everything], entities=entities)


def _body(vehicle: Vehicle) -> list[Solid]:
    """Return a vehicle with its wheels, in its base frame."""
    model = vehicle.model
    base, *others = link_solids(model)
    for wheel, parts in zip(model.wheels, others, strict=False):
        base += [replace(part, position_m=wheel.center_m) for part in parts]
    still = base_from_links(model.joints, [0.0] * len(model.joints))
    for ((x, y, z), _), parts in zip(still, others[len(model.wheels) :], strict=True):
        for part in parts:
            px, py, pz = part.position_m
            base.append(replace(part, position_m=(x + px, y + py, z + pz)))
    return base


def _entity(
    name: str,
    frame: str,
    parts: Iterable[Solid],
    materials: Mapping[str, Material],
    stamp_nanos: int,
    meshes: Sequence[ShadedMesh] = (),
) -> SceneEntity:
    cubes, cylinders, spheres = [], [], []
    triangles = [_triangles(drawn) for drawn in meshes]
    for solid in parts:
        if isinstance(solid.shape, MeshShape):
            triangles.append(_triangles(mesh([solid], materials)))
            continue
        x, y, z = solid.position_m
        qx, qy, qz, qw = solid.orientation
        pose = Pose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))
        red, green, blue, _ = (part / 255 for part in rgba(materials[solid.material].color))
        color = Color(r=red, g=green, b=blue, a=1.0)
        if isinstance(solid.shape, Box):
            size = Vector3(
                x=solid.shape.size_m[0], y=solid.shape.size_m[1], z=solid.shape.size_m[2]
            )
            cubes.append(CubePrimitive(pose=pose, size=size, color=color))
        elif isinstance(solid.shape, Cylinder):
            across = 2 * solid.shape.radius_m
            size = Vector3(x=across, y=across, z=solid.shape.length_m)
            cylinders.append(
                CylinderPrimitive(
                    pose=pose, size=size, bottom_scale=1.0, top_scale=1.0, color=color
                )
            )
        else:
            across = 2 * solid.shape.radius_m
            size = Vector3(x=across, y=across, z=across)
            spheres.append(SpherePrimitive(pose=pose, size=size, color=color))
    return SceneEntity(
        timestamp=Timestamp(sec=stamp_nanos // NANOS, nsec=stamp_nanos % NANOS),
        frame_id=frame,
        id=name,
        lifetime=Duration(sec=0, nsec=0),
        frame_locked=True,
        cubes=cubes,
        cylinders=cylinders,
        spheres=spheres,
        triangles=triangles,
    )


def _triangles(drawn: ShadedMesh) -> TriangleListPrimitive:
    # A vertex of several faces is sent once: a quarter of the bytes.
    corners = np.hstack([drawn.vertices, drawn.colors / np.float32(255)])
    points, indices = np.unique(corners, axis=0, return_inverse=True)
    return TriangleListPrimitive(
        pose=Pose(
            position=Vector3(x=0.0, y=0.0, z=0.0),
            orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
        ),
        points=[Point3(x=x, y=y, z=z) for x, y, z in points[:, :3].tolist()],
        colors=[Color(r=r, g=g, b=b, a=a) for r, g, b, a in points[:, 3:].tolist()],
        indices=indices.reshape(-1).tolist(),
    )
