# SPDX-License-Identifier: Apache-2.0
"""Meshes in the store come back as they were, and what is none is one line."""

import numpy as np
import pytest

from groundlink.core.frames import quaternion_from_rpy
from groundlink.world import assets
from groundlink.world.assets import MissingAsset
from groundlink.world.bounds import bounds, intersect, middle
from groundlink.world.mesh_asset import MeshPart, encode_mesh, load_mesh
from groundlink.world.solids import Box, Mesh, Solid
from groundlink.world.triangles import merged

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], np.float32) + np.float32(1)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.uint32)
UV = np.linspace(0, 1, 8, dtype=np.float32).reshape(4, 2)
PARTS = (
    MeshPart(first=0, count=1, color=(0.1, 0.2, 0.3)),
    MeshPart(first=1, count=3, picture=b"PNG", normals=b"JPEG"),
)


def tetrahedron() -> Mesh:
    asset = assets.put(encode_mesh(VERTICES, FACES))
    return Mesh(asset=asset, low_m=(1.0, 1.0, 1.0), high_m=(2.0, 3.0, 4.0))


def test_a_surface_comes_back_as_it_was() -> None:
    content = encode_mesh(VERTICES, FACES, UV, PARTS)
    assert content == encode_mesh(VERTICES.copy(order="F"), FACES, UV, PARTS)
    found = load_mesh(assets.put(content))
    assert (found.vertices == VERTICES).all()
    assert (found.faces == FACES).all()
    assert found.uv is not None
    assert (found.uv == UV).all()
    told = [(p.first, p.count, p.color, p.picture, p.normals) for p in found.parts]
    assert told == [(0, 1, (0.1, 0.2, 0.3), None, None), (1, 3, None, b"PNG", b"JPEG")]
    for array in (found.vertices, found.faces, found.uv):
        assert array.flags.aligned
        assert not array.flags.writeable


def test_without_paint_all_faces_are_one_part() -> None:
    found = load_mesh(tetrahedron().asset)
    assert found.uv is None
    assert [(p.first, p.count, p.color) for p in found.parts] == [(0, 4, None)]


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no mesh",
        encode_mesh(VERTICES, FACES)[:-1],
        encode_mesh(VERTICES[:3], FACES),
        encode_mesh(VERTICES, FACES, UV[:3]),
        encode_mesh(VERTICES, FACES, None, PARTS[:1]),
    ],
)
def test_invalid_mesh_gives_one_line(content: bytes) -> None:
    with pytest.raises(MissingAsset, match="are no mesh"):
        load_mesh(assets.put(content))


def test_a_mesh_is_a_shape_among_others() -> None:
    turn = quaternion_from_rpy(0.0, 0.0, np.pi / 2)
    solid = Solid("it", tetrahedron(), "m", (10.0, 0.0, 0.0), turn)
    mesh = merged([Solid("box", Box(size_m=(1.0, 1.0, 1.0)), "m"), solid], first_label=3)
    own = mesh.labels == 4
    assert own.sum() == 4
    placed = mesh.vertices[mesh.faces[own]].reshape(-1, 3)
    low, high = bounds(solid)
    assert low == pytest.approx([7.0, 1.0, 1.0], abs=1e-6)
    assert high == pytest.approx([9.0, 2.0, 4.0], abs=1e-6)
    assert placed.min(axis=0) == pytest.approx(low, abs=1e-5)
    assert placed.max(axis=0) == pytest.approx(high, abs=1e-5)
    assert middle(solid) == pytest.approx([8.0, 1.5, 2.5], abs=1e-6)


@pytest.mark.parametrize(("at", "meet"), [((8.0, 1.5, 2.5), True), ((10.0, 0.0, 0.0), False)])
def test_a_mesh_is_met_where_it_is_and_not_at_its_origin(
    at: tuple[float, float, float], meet: bool
) -> None:
    turn = quaternion_from_rpy(0.0, 0.0, np.pi / 2)
    solid = Solid("it", tetrahedron(), "m", (10.0, 0.0, 0.0), turn)
    assert intersect(solid, Solid("box", Box(size_m=(0.5, 0.5, 0.5)), "m", at)) is meet
