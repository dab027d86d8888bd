# SPDX-License-Identifier: Apache-2.0
"""Terrain and meshes in a viewer: few triangles, in place, in their colors."""

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from PIL import Image

from groundlink.importing import terrain as imported
from groundlink.importing.terrain_specs import HillsTerrain, MaterialRule
from groundlink.loader import load
from groundlink.scenario import Scenario
from groundlink.world import assets
from groundlink.world.mesh_asset import MeshPart, encode_mesh, load_mesh
from groundlink.world.solids import Material, Mesh, Solid
from groundlink.world.terrain import load_ground
from services.view import meshes, simplified_surfaces
from services.view.foxglove_scene import scene

LAB = Path(__file__).parents[3] / "scenarios" / "indoor_lab.yaml"

HILLS = HillsTerrain(
    size_m=(3000.0, 2000.0),
    cell_m=2.0,
    height_m=40.0,
    longest_m=400.0,
    material="green",
    where=(MaterialRule(material="rock", height_m=(30.0, 1e9)),),
)


def outdoors() -> Scenario:
    lab = load(LAB)
    rover = replace(lab.vehicles[0], placement=replace(lab.vehicles[0].placement, x_m=500.0))
    materials = lab.world.materials | {
        "green": Material(color=(0.1, 0.5, 0.1)),
        "rock": Material(color=(0.4, 0.4, 0.4)),
    }
    world = replace(lab.world, materials=materials, terrain=imported.build(HILLS, Path(), print))
    return replace(lab, world=world, vehicles=(rover,))


def test_terrain_is_coarse_afar_and_exact_where_vehicles_start() -> None:
    scenario = outdoors()
    assert scenario.world.terrain is not None
    here = load_ground(scenario.world.terrain)
    corners, colors = simplified_surfaces.terrain_faces(scenario, scenario.world.terrain)
    assert len(corners) == len(colors) < 120_000
    points = corners.reshape(-1, 3)
    assert points[:, 2] == pytest.approx(here.height_at(points[:, 0], points[:, 1]), abs=1e-4)
    assert np.ptp(points, axis=0)[:2] == pytest.approx((3000.0, 2000.0))
    near = corners[(np.abs(corners.mean(axis=1)[:, :2] - (500.0, 0.0)) < 70.0).all(axis=1)]
    assert np.ptp(near, axis=1)[:, :2].max() == pytest.approx(2.0)
    # Its faces look upwards, and are green below.
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert across[:, 2].min() > 0
    low = corners[:, :, 2].max(axis=1) < 25
    assert (colors[low] == (0.1, 0.5, 0.1)).all()
    assert (colors == (0.4, 0.4, 0.4)).all(axis=1).any()
    assert len(meshes.world(scenario)["terrain"].vertices) == 3 * len(corners)
    told = scene(scenario, 0).encode()
    assert b"terrain" in told
    assert len(told) < 10_000_000


def wavy(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a sheet of 2 x 2 m with a wave, of 2 side^2 triangles."""
    x, y = np.meshgrid(np.linspace(-1, 1, side + 1), np.linspace(-1, 1, side + 1))
    vertices = np.stack([x, y, 0.1 * np.sin(3 * x)], axis=-1).reshape(-1, 3)
    number = np.arange((side + 1) ** 2).reshape(side + 1, -1)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    faces = np.stack([np.stack([a, b, c], axis=-1), np.stack([d, c, b], axis=-1)], axis=2)
    return vertices.astype(np.float32), faces.reshape(-1, 3).astype(np.uint32)


@pytest.mark.parametrize("side", [10, 300])
def test_a_large_mesh_has_fewer_faces_and_keeps_its_form(side: int) -> None:
    vertices, faces = wavy(side)
    sheet = load_mesh(assets.put(encode_mesh(vertices, faces)))
    corners, kept = simplified_surfaces.coarse(sheet)
    assert len(corners) == len(kept)
    assert side != 10 or len(kept) == 200
    assert len(corners) <= simplified_surfaces.MOST_FACES
    if side == 300:
        assert len(corners) > simplified_surfaces.MOST_FACES / 8
    points = corners.reshape(-1, 3)
    assert points[:, 2] == pytest.approx(0.1 * np.sin(3 * points[:, 0]), abs=2e-3)
    assert np.ptp(points, axis=0)[:2] == pytest.approx((2.0, 2.0), abs=0.05)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(across, axis=1).sum() / 2 == pytest.approx(4.0, rel=0.08)


def test_faces_have_the_color_of_their_paint() -> None:
    vertices, faces = wavy(10)
    picture = np.zeros((4, 4, 3), np.uint8)
    picture[:2] = (255, 0, 0)  # the upper half
    file = BytesIO()
    Image.fromarray(picture).save(file, "PNG")
    uv = (vertices[:, :2] + 1) / 2
    parts = (
        MeshPart(first=0, count=150, color=(1.0, 1.0, 1.0), picture=file.getvalue()),
        MeshPart(first=150, count=40, color=(0.2, 0.3, 0.4)),
        MeshPart(first=190, count=10),
    )
    asset = assets.put(encode_mesh(vertices, faces, uv, parts))
    shape = Mesh(asset=asset, low_m=(-1.0, -1.0, -1.0), high_m=(1.0, 1.0, 1.0))
    colors = simplified_surfaces.face_colors(load_mesh(asset), Material(color=(0.0, 0.0, 1.0)))
    north = vertices[faces].mean(axis=1)[:, 1] > 0
    assert (colors[:150][north[:150]] == (1, 0, 0)).all()
    assert (colors[:150][~north[:150]] == 0).all()
    assert (colors[150:190] == (0.2, 0.3, 0.4)).all()
    assert (colors[190:] == (0, 0, 1)).all()
    drawn = meshes.mesh([Solid("it", shape, "m", (5.0, 0.0, 0.0))], {"m": Material()})
    assert len(drawn.vertices) == 2 * 3 * 200  # both sides
    assert drawn.vertices[:, 0].min() == pytest.approx(4.0)
    assert (drawn.colors[:3] == (0, 0, 0, 255)).all()
