# SPDX-License-Identifier: Apache-2.0
"""What is drawn of the world: closed, shaded, in its colors, and open towards who looks in."""

import numpy as np

from groundlink.scene.bodies import link_solids
from groundlink.world.solids import Box, Material, Solid
from services.view import meshes

from .scenes import SCENARIO

CUBE = Solid(name="cube", shape=Box(size_m=(1, 1, 1)), material="red", position_m=(2, 0, 0))


def test_normals_point_out_and_colors_are_those_of_the_material() -> None:
    mesh = meshes.mesh([CUBE], {"red": Material(color=(1.0, 0.0, 0.2))})
    assert mesh.vertices.shape == mesh.normals.shape == (36, 3)
    outward = np.einsum("ij,ij->i", mesh.vertices - CUBE.position_m, mesh.normals)
    assert np.allclose(outward, 0.5)
    assert (mesh.colors == (255, 0, 124, 255)).all()


def test_of_a_room_only_the_inside_is_drawn() -> None:
    """No triangle of the shell turns its front to somebody far above: the ceiling is open."""
    room = meshes.world(SCENARIO)["room"]
    above = np.array([0.0, 0.0, 50.0])
    facing_up = np.einsum("ij,ij->i", above - room.vertices, room.normals) > 0
    heights = room.vertices[facing_up][:, 2]
    assert (heights < 3.0 + 1e-6).all()
    level = room.vertices[facing_up & (np.abs(room.normals[:, 2]) > 0.99)]
    assert np.allclose(level[:, 2], 0.0, atol=0.05) or (level[:, 2] < 2.2).all()
    assert len(level)


def test_every_thing_is_there_under_its_name() -> None:
    world = meshes.world(SCENARIO)
    assert {"room", "clutter", "table_0", "chair_9", "cabinet_12", "shelf_16"} <= set(world)
    assert sum(name.startswith("table_") for name in world) == 8
    assert all(len(mesh.vertices) and len(mesh.vertices) % 3 == 0 for mesh in world.values())


def test_links_are_those_of_the_state() -> None:
    model = SCENARIO.vehicles[0].model
    assert len(link_solids(model)) == len(model.link_names())
    wheel = meshes.mesh(link_solids(model)[1], SCENARIO.world.materials)
    size = np.ptp(wheel.vertices, axis=0)
    # A tire 0.1143 m wide, whose hub sticks out to 0.126 m.
    assert np.allclose(size, [2 * 0.1651, 0.126, 2 * 0.1651], rtol=0.01)
