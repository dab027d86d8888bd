# SPDX-License-Identifier: Apache-2.0
"""Solids as meshes: outward normals, textures that fit, things that have names."""

from itertools import pairwise
from typing import get_args

import numpy as np
import pytest

from groundlink.world.solids import Box, Cylinder, Material, Shape, Solid, Sphere, Texture
from groundlink.world.triangles import merged
from services.sensors.rendering.gl.culling import Boxes, from_near_to_far, seen
from services.sensors.rendering.gl.stage import boxes_around, cut
from services.sensors.rendering.look.labels import Labels
from services.sensors.rendering.look.mesh import SkinnedMesh
from services.sensors.rendering.look.patterns import TEXELS
from services.sensors.rendering.look.shapes import STRETCH, meshes
from services.sensors.rendering.look.textures import BRIGHTEST, REPEATS, period_m, texture

TURNED = (0.0, 0.0, 0.3826834, 0.9238795)
SHAPES: dict[str, Shape] = {
    "box": Box(size_m=(2.0, 0.5, 1.0)),
    "cylinder": Cylinder(radius_m=0.5, length_m=1.5),
    "sphere": Sphere(radius_m=0.7),
}


def mesh(shape: Shape, **material: float) -> SkinnedMesh:
    solid = Solid("thing", shape, "stuff", (1.0, 2.0, 3.0), TURNED)
    (made,) = meshes([solid], [7], {"stuff": Material(**material)}, {})  # type: ignore[arg-type]
    return made


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_a_mesh_has_the_triangles_that_rays_meet(shape: Shape) -> None:
    made = mesh(shape)
    solid = Solid("thing", shape, "stuff", (1.0, 2.0, 3.0), TURNED)
    triangles = merged([solid])
    corners = made.vertices["position"][made.faces]
    assert np.array_equal(corners, triangles.vertices[triangles.faces])
    assert (made.vertices["label"] == 7).all()
    # Normals are unit vectors, near to those of the faces, and look outwards.
    normals = made.vertices["normal"][made.faces]
    assert np.linalg.norm(normals, axis=-1) == pytest.approx(1.0, abs=1e-5)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    assert np.einsum("fci,fi->fc", normals, flat).min() > 0.95


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_textures_keep_their_size(shape: Shape) -> None:
    """An edge of a triangle is about as long in the texture as on the surface, but at poles."""
    made = mesh(shape, texture_size_m=0.4)
    corners = made.vertices["position"][made.faces].astype(float)
    uv_m = period_m(Material(texture_size_m=0.4)) * made.vertices["uv"][made.faces].astype(float)
    sides = [np.linalg.norm(a - np.roll(a, 1, axis=1), axis=-1) for a in (corners, uv_m)]
    ratio = sides[1] / sides[0]
    if isinstance(shape, Sphere):
        middle = np.abs(corners[..., 2].mean(axis=1) - 3.0) < 0.2
        ratio = ratio[middle]
    round_m = 0.06 if isinstance(shape, Sphere) else 0.01
    assert ratio == pytest.approx(1.0, rel=STRETCH + round_m)


def test_things_of_one_material_differ_a_little() -> None:
    solids = [Solid(f"box_{i}", Box(size_m=(1, 1, 1)), "stuff") for i in range(20)]
    (made,) = meshes(solids, range(20), {"stuff": Material(color=(0.5, 0.5, 0.5))}, {})
    tints = {float(tint) for tint in made.vertices["tint"][:, 0]}
    assert len(tints) > 15
    assert 0.43 < min(tints) < max(tints) < 0.57
    corners = {tuple(np.round(uv % 1, 3)) for uv in made.vertices["uv"]}
    assert len(corners) > 4 * 15


def test_walls_show_parts_of_a_texture_side_by_side() -> None:
    """As long as there is room: what begins at 0.1 of it ends where the next begins."""
    solids = [Solid(f"wall_{i}", Box(size_m=(9.0, 0.1, 2.4)), "stuff") for i in range(4)]
    whole_m = period_m(Material(texture_size_m=3.0))
    (made,) = meshes(solids, range(4), {"stuff": Material(texture_size_m=3.0)}, {})
    v = [made.vertices["uv"][made.vertices["label"] == i, 1] for i in range(4)]
    high_m = [whole_m * (part.max() - part.min()) for part in v]
    assert high_m == pytest.approx([2.4 + 0.1 + 0.1] * 4, rel=STRETCH)
    for below, above in pairwise(v):
        assert above.min() == pytest.approx(below.max() % 1, abs=1e-6)


def test_things_have_their_texture_each_in_its_own_measure() -> None:
    """Two cuts of it that overlap fit nowhere, as they are stretched in other ways or mirrored."""
    solids = [Solid(f"wall_{i}", Box(size_m=(9.0, 0.1, 2.4)), "stuff") for i in range(12)]
    (made,) = meshes(solids, range(12), {"stuff": Material(texture_size_m=3.0)}, {})
    ratios = set()
    for number in range(12):
        corners = made.vertices[made.faces][made.vertices["label"][made.faces[:, 0]] == number]
        front = corners[(corners["normal"][:, 0, 1] > 0.5)][0]
        one, other = (front["uv"][i] - front["uv"][0] for i in (1, 2))
        places = [front["position"][i] - front["position"][0] for i in (1, 2)]
        uv_from_place = np.linalg.solve(np.array(places)[:, [0, 2]], np.array([one, other]))
        ratios.add(round(float(uv_from_place[0, 0] / uv_from_place[1, 1]), 3))
    assert len(ratios) == 12
    assert min(ratios) < -0.7 < 0.7 < max(ratios)


@pytest.mark.parametrize("name", get_args(Texture))
def test_no_two_places_of_a_texture_look_alike(name: Texture) -> None:
    """What is a repetition of its pattern away differs by what lies over it."""
    factors = (texture(name) / 255.0) ** 2 * BRIGHTEST
    cells = factors.reshape(-1, 32, factors.shape[1] // 32, 32).mean(axis=(1, 3))
    fine = factors - cells.repeat(32, axis=0).repeat(32, axis=1)
    for away in range(TEXELS, REPEATS * TEXELS, TEXELS):
        alike = np.corrcoef(fine.ravel(), np.roll(fine, away, axis=1).ravel())[0, 1]
        assert alike < 0.9


JOINTED = ("tiles", "printed", "bricks", "roof_tiles")
"""Textures with edges in them, one of which may be the picture's."""


@pytest.mark.parametrize("name", get_args(Texture))
def test_a_texture_repeats_without_a_seam(name: Texture) -> None:
    picture = texture(name)
    assert picture.shape == (REPEATS * TEXELS, REPEATS * TEXELS)
    factors = (picture / 255.0) ** 2 * BRIGHTEST
    assert factors.mean() == pytest.approx(1.0, abs=0.15)
    assert factors.std() > 0.03, "nothing to track"
    # From afar 16 x 16 texels are one, and there is still something to see.
    afar = factors.reshape(-1, 16, factors.shape[1] // 16, 16).mean(axis=(1, 3))
    assert afar.std() > 0.01
    # From the last row to the first is no more of a step than from one row to the next.
    for axis in (0, 1):
        steps = np.abs(np.diff(factors, axis=axis, append=factors.take([0], axis))).mean(1 - axis)
        assert steps[-1] < 4 * np.median(steps) + 0.01 or name in JOINTED


def test_cutting_loses_nothing() -> None:
    solids = [Solid(f"b{i}", Box(size_m=(1, 1, 1)), "stuff", (3.0 * i, 0.0, 0.0)) for i in range(9)]
    (whole,) = meshes(solids, range(9), {"stuff": Material()}, {})
    pieces = list(cut(whole, 6.0))
    assert len(pieces) > 3

    def triangles(made: SkinnedMesh) -> list[bytes]:
        return [corners.tobytes() for corners in made.vertices[made.faces]]

    assert sorted(t for piece in pieces for t in triangles(piece)) == sorted(triangles(whole))
    around = boxes_around(pieces)
    for piece, middle, half in zip(pieces, around.middles, around.halves, strict=True):
        assert (np.abs(piece.vertices["position"] - middle) <= half + 1e-6).all()


def test_boxes_in_view_are_seen_and_those_behind_are_not() -> None:
    generator = np.random.default_rng(3)
    boxes = Boxes(generator.uniform(-20, 20, (500, 3)), generator.uniform(0.1, 2, (500, 3)))
    # A view along x with 90 degrees, in clip space: w = x.
    clip = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, -0.2], [1, 0, 0, 0]], float)
    shown = seen(boxes, clip)
    points = (
        boxes.middles[:, None] + generator.uniform(-1, 1, (500, 200, 3)) * boxes.halves[:, None]
    )
    x, y, z = np.moveaxis(points, -1, 0)
    visible = ((x > 0.1) & (np.abs(y) < x) & (np.abs(z) < x)).any(axis=1)
    assert visible.sum() > 40
    assert shown[visible].all()
    assert shown.sum() < 1.5 * visible.sum()
    order = from_near_to_far(boxes, shown, np.zeros(3))
    assert sorted(order) == np.flatnonzero(shown).tolist()
    away = np.linalg.norm(np.maximum(np.abs(boxes.middles) - boxes.halves, 0), axis=1)[order]
    assert (np.diff(away) >= 0).all()


def test_things_have_names_and_classes() -> None:
    labels = Labels({"north_west_post"}, {})
    names = [
        *("room_floor", "wall_north_left", "wall_north_right", "table_0_leg_1", "table_0_top"),
        *("table_1_top", "clutter_3", "clutter_4", "north_west_post"),
    ]
    assert labels.of_solids(names) == [0, 1, 1, 2, 2, 3, 4, 5, 6]
    assert labels.of_mover("rover") == labels.of_mover("rover") == 7
    assert labels.instances[2:] == [
        *("table_0", "table_1", "clutter_3", "clutter_4", "north_west_post", "rover")
    ]
    assert labels.classes == [
        *("floor", "wall", "table", "table", "clutter", "clutter", "north_west_post", "vehicle")
    ]


def test_actors_are_things_of_their_kind() -> None:
    labels = Labels((), {"visitor": "person"})
    assert [labels.of_mover(name) for name in ("rover", "visitor", "rover")] == [0, 1, 0]
    assert labels.classes == ["vehicle", "person"]
