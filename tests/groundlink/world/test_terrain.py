# SPDX-License-Identifier: Apache-2.0
"""Terrain: heights on the very triangles that Bullet has, from the store and in the world."""

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.frames import IDENTITY_QUATERNION
from groundlink.world import assets
from groundlink.world.assets import MissingAsset
from groundlink.world.solids import Solid, Sphere
from groundlink.world.terrain import Ground, Terrain, encode_grid, load_ground
from services.physics.dynamics.backend import FREE, Surface
from services.physics.dynamics.bullet import BulletBackend

ROWS, COLUMNS, CELL_M = 5, 7, 0.5
HEIGHTS = np.random.default_rng(7).uniform(0, 3, (ROWS, COLUMNS)).astype(np.float32)
SURFACE = np.arange((ROWS - 1) * (COLUMNS - 1), dtype=np.uint8).reshape(ROWS - 1, -1) % 3
AT_M = (10.0, -20.0, 1.5)


def terrain() -> Terrain:
    return Terrain(
        heights=assets.put(encode_grid(HEIGHTS)),
        surface=assets.put(encode_grid(SURFACE)),
        cell_m=CELL_M,
        at_m=AT_M,
        low_m=(8.5, -21.0, 1.5),
        high_m=(11.5, -19.0, 4.5),
        materials=("grass", "rock", "water"),
    )


def places(count: int) -> np.ndarray:
    """Return random points of the map, x and y in the world, away from its very edge."""
    half = np.array([COLUMNS - 1, ROWS - 1]) * CELL_M / 2 - 1e-4
    return np.random.default_rng(1).uniform(-half, half, (count, 2)) + AT_M[:2]


def test_heights_are_those_that_bullet_has_between_the_vertices() -> None:
    here = load_ground(terrain())
    backend = BulletBackend()
    ball = Solid("ball", Sphere(radius_m=0.1), "")
    body = backend.add_body([ball], Surface(1.0, 0.0, FREE))
    field = backend.add_heightfield(body, here.heights, CELL_M, 1.0)
    middle = (float(here.heights.min()) + float(here.heights.max())) / 2
    backend.set_pose(field, ((AT_M[0], AT_M[1], middle), IDENTITY_QUATERNION))
    for x, y in places(500).tolist():
        hit = backend.ray((x, y, 50.0), (x, y, -50.0))
        assert hit is not None
        assert here.height_at(x, y) == pytest.approx(hit[1][2], abs=1e-5)
    backend.close()


def test_heights_and_materials_of_vertices_and_cells_are_their_own() -> None:
    here = load_ground(terrain())
    row, column = np.indices(HEIGHTS.shape)
    x, y = here.x0_m + column * CELL_M, here.y0_m + row * CELL_M
    assert here.height_at(x, y) == pytest.approx(HEIGHTS + AT_M[2], abs=1e-6)
    cells = SURFACE.shape
    middle = x[: cells[0], : cells[1]] + CELL_M / 2, y[: cells[0], : cells[1]] + CELL_M / 2
    assert (here.material_at(*middle) == SURFACE).all()


def test_beside_the_map_there_is_no_height() -> None:
    here = load_ground(terrain())
    assert np.isnan(here.height_at([8.49, 10.0, np.nan], [-20.0, -18.99, -20.0])).all()
    assert np.isfinite(here.height_at([8.5, 11.5], [-21.0, -19.0])).all()
    assert here.material_at(1e9, -20.0) == here.material_at(11.4, -20.0)


def test_arrays_are_read_only_and_mapped_where_nothing_is_added() -> None:
    flat = replace(terrain(), at_m=(0.0, 0.0, 0.0), surface=None)
    for made in (load_ground(terrain()), load_ground(flat)):
        assert made.heights.dtype == np.float32
        assert made.heights.flags.c_contiguous
        assert made.surface.flags.c_contiguous
        for array in (made.heights, made.surface):
            with pytest.raises(ValueError, match="read-only"):
                array[0, 0] = 1
    assert not load_ground(flat).heights.flags.owndata
    assert not load_ground(flat).surface.any()
    assert load_ground(flat) is load_ground(flat)


@pytest.mark.parametrize(
    ("field", "content", "problem"),
    [
        ("heights", None, "are not in"),
        ("heights", encode_grid(SURFACE), "are no map"),
        ("heights", encode_grid(HEIGHTS.ravel()), "are no map"),
        ("heights", encode_grid(HEIGHTS[:1]), "are no map of 2 x 2"),
        ("heights", b"\x93NUMPY\x01\x00v\x00{'descr'", "are no map"),
        ("heights", encode_grid(HEIGHTS)[:-1], "are no map"),
        ("surface", encode_grid(SURFACE[1:]), "does not fit"),
        ("surface", encode_grid(SURFACE + np.uint8(1)), "does not fit"),
    ],
)
def test_what_is_no_terrain_is_one_line(field: str, content: bytes | None, problem: str) -> None:
    digest = "0" * 64 if content is None else assets.put(content)
    with pytest.raises(MissingAsset, match=problem):
        load_ground(replace(terrain(), **{field: digest}))


def test_a_map_is_the_same_bytes_however_it_lies_in_memory() -> None:
    across = np.asfortranarray(HEIGHTS)
    assert encode_grid(across) == encode_grid(HEIGHTS)
    assert isinstance(load_ground(terrain()), Ground)
