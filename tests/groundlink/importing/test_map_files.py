# SPDX-License-Identifier: Apache-2.0
"""Maps of map_server: pixels as it reads them, walls as few boxes, and files that it loads."""

import re
from io import BytesIO
from pathlib import Path

import msgspec
import numpy as np
import pytest
from PIL import Image

from groundlink.core.errors import UserError
from groundlink.importing.map_files import cells_of, read_map, rectangles, solids_of, write
from groundlink.importing.map_specs import MapServerYaml, OccupancyMapFile
from groundlink.world.mesh_asset import load_mesh
from groundlink.world.occupancy import MapGrid, OccupancyMap
from groundlink.world.solids import Box, Mesh

YAML = {
    "image": "map.pgm",
    "resolution": 0.05,
    "origin": [-1.0, -2.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}
PIXELS = np.array([[0, 89, 90, 100, 101, 204, 205, 206, 254, 255]], np.uint8)


def described(**changes: object) -> MapServerYaml:
    return msgspec.convert(YAML | changes, MapServerYaml)


@pytest.mark.parametrize(
    ("changes", "cells"),
    [
        # 1 - 89/255 is 0.651, 1 - 205/255 is 0.19608, more than 0.196.
        ({}, [100, 100, -1, -1, -1, -1, -1, 0, 0, 0]),
        ({"negate": True}, [0, -1, -1, -1, -1, 100, 100, 100, 100, 100]),
        # (1 - 90/255 - 0.196) / 0.454 is 0.9934, that of 204 is 0.0088.
        ({"mode": "scale"}, [100, 100, 99, 91, 90, 1, 0, 0, 0, 0]),
        ({"mode": "raw"}, [0, 89, 90, 100, -1, -1, -1, -1, -1, -1]),
        ({"mode": "raw", "negate": 1}, [0, 89, 90, 100, -1, -1, -1, -1, -1, -1]),
        # Equal to a threshold counts: 51/255 is 0.2.
        (
            {"negate": 1, "occupied_thresh": 0.8, "free_thresh": 0.34901962},
            [0] * 2 + [-1] * 3 + [100],
        ),
    ],
)
def test_pixels_become_the_cells_of_map_server(changes: dict[str, object], cells: list) -> None:
    assert cells_of(PIXELS, described(**changes))[0, : len(cells)].tolist() == cells


def encoded(grays: np.ndarray, form: str, mode: str | None = None) -> bytes:
    file = BytesIO()
    image = Image.fromarray(grays)
    (image.convert(mode) if mode else image).save(file, form)
    return file.getvalue()


ROWS = np.array([[0, 254, 205], [254, 254, 254]], np.uint8)
CLEAR = Image.merge("LA", [Image.fromarray(ROWS), Image.new("L", (3, 2), 255)])
CLEAR.putpixel((0, 1), (254, 254))


def clear() -> bytes:
    file = BytesIO()
    CLEAR.save(file, "PNG")
    return file.getvalue()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("map.pgm", b"P5\n# made by hand\n3 2\n255\n" + ROWS.tobytes()),
        ("map.pgm", b"P2 3 2 255 0 254 205 254 254 254\n"),
        ("map.pgm", b"P5 3 2 65535\n" + (ROWS.astype(">u2") * 257).tobytes()),
        ("map.png", encoded(ROWS, "PNG")),
        ("map.png", encoded(ROWS, "PNG", "RGB")),
        ("map.png", encoded(ROWS.astype(np.uint16) * 257, "PNG")),
        ("map.bmp", encoded(ROWS, "BMP")),
    ],
)
def test_the_first_row_of_a_picture_is_the_northern_one(
    tmp_path: Path, name: str, content: bytes
) -> None:
    (tmp_path / name).write_bytes(content)
    found = read_map(described(image=name), tmp_path)
    assert found.cells.tolist() == [[0, 0, 0], [100, 0, -1]]
    assert found.grid == MapGrid(0.05, -1.0, -2.0, 0.0, 2, 3)


def test_what_is_transparent_is_unknown(tmp_path: Path) -> None:
    (tmp_path / "map.png").write_bytes(clear())
    found = read_map(described(image="map.png"), tmp_path)
    assert found.cells.tolist() == [[-1, 0, 0], [100, 0, -1]]
    raw = read_map(described(image="map.png", mode="raw"), tmp_path)
    assert raw.cells.tolist() == [[-1, -1, -1], [0, -1, -1]]


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("map.pgm", b"P5 3 2 255\n" + ROWS.tobytes()[:4], "not a"),
        ("map.pgm", b"P5 30000 30000 255\n", "more than 134 million"),
        ("map.pgm", b"P5 9000 9000 255\nxx", "which a file of"),
        ("map.png", b"no picture", "not a"),
        ("map.jpg", b"", "unknown format; expected one of .pgm, .png, .bmp"),
        ("missing.pgm", None, "no such file"),
    ],
)
def test_bad_pictures_are_one_line(
    tmp_path: Path, name: str, content: bytes | None, problem: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=re.escape(problem)) as caught:
        read_map(described(image=name), tmp_path)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def covered(mask: np.ndarray) -> np.ndarray:
    times = np.zeros(mask.shape, int)
    for r0, c0, r1, c1 in rectangles(mask):
        times[r0:r1, c0:c1] += 1
    return times


@pytest.mark.parametrize("seed", range(20))
def test_rectangles_cover_each_cell_once(seed: int) -> None:
    draw = np.random.default_rng(seed)
    mask = draw.random(draw.integers(1, 25, 2)) < draw.uniform(0.1, 0.95)
    assert (covered(mask) == mask).all()


def room(size: int = 400) -> np.ndarray:
    """Return the walls of a flat with four rooms, as noisy as SLAM has them."""
    draw = np.random.default_rng(3)
    walls = np.zeros((size, size), bool)
    for at in (20, size // 2, size - 20):
        for along in range(20, size - 19):
            if not (at == size // 2 and 80 < along < 110):
                off, thick = draw.choice([0, 0, 0, 0, 0, 0, 0, 1]), draw.choice([2, 2, 2, 3])
                walls[at + off : at + off + thick, along] = True
                walls[along, at + off : at + off + thick] = True
    return walls


def test_a_room_of_400_by_400_cells_needs_hundreds_of_boxes() -> None:
    walls = room()
    assert walls.sum() > 4000
    assert len(rectangles(walls)) < 900
    plain = np.zeros((400, 400), bool)
    plain[10:390, 10:390] = True
    plain[12:388, 12:388] = False
    assert len(rectangles(plain)) == 4


def built(cells: np.ndarray, **changes: object) -> list:
    spec = OccupancyMapFile(file="map.yaml", **changes)  # type: ignore[arg-type]
    found = OccupancyMap(MapGrid(0.5, 10.0, 20.0, np.pi / 2, *cells.shape), cells.astype(np.int8))
    return solids_of(found, spec, 0.65)


def test_a_map_becomes_a_floor_and_walls_in_its_frame() -> None:
    """The map's x is the world's y, its y the world's -x."""
    cells = np.array([[0, 0, 100, 100], [0, 0, -1, -1]])
    floor, wall = built(cells, wall_height_m=2.0, wall_material="brick")
    assert (wall.name, wall.material, wall.shape) == (
        "map_wall_0",
        "brick",
        Box(size_m=(1.0, 0.5, 2.0)),
    )
    assert wall.position_m == pytest.approx((9.75, 21.5, 1.0))
    assert wall.orientation == pytest.approx((0, 0, np.sqrt(0.5), np.sqrt(0.5)))
    assert isinstance(floor.shape, Mesh)
    assert (floor.drivable, floor.position_m, floor.orientation) == (
        True,
        (10.0, 20.0, 0.0),
        wall.orientation,
    )
    mesh = load_mesh(floor.shape.asset)
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()
    assert normals[:, 2].sum() / 2 == pytest.approx(6 * 0.25)


def test_a_cell_is_a_wall_from_the_maps_threshold_on() -> None:
    assert len(built(np.array([[0, 64, 65, 100, -1]]))) == 2
    assert len(built(np.array([[0, 64, 64, 0, -1]]))) == 1


def test_maps_of_which_no_world_can_be_made_are_refused() -> None:
    with pytest.raises(UserError, match="all cells of the map are unknown"):
        built(np.full((3, 3), -1))
    noise = np.indices((150, 150)).sum(axis=0) % 2 * 100
    with pytest.raises(UserError, match="need 11250 boxes; expected at most 10000"):
        built(noise)


def test_a_written_map_is_read_again(tmp_path: Path) -> None:
    cells = np.random.default_rng(0).choice([-1, 0, 100], (7, 11)).astype(np.int8)
    grid = MapGrid(0.05, -1.35, 2.0, 0.25, 7, 11)
    picture = write(OccupancyMap(grid, cells), tmp_path / "it.yaml")
    assert picture == tmp_path / "it.pgm"
    assert picture.read_bytes().startswith(b"P5\n11 7\n255\n")
    text = (tmp_path / "it.yaml").read_text()
    assert text == (
        "image: it.pgm\nresolution: 0.05\norigin: [-1.35, 2.0, 0.25]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\nmode: trinary\n"
    )
    read = read_map(msgspec.yaml.decode(text, type=MapServerYaml), tmp_path)
    assert (read.cells == cells).all()
    assert read.grid == grid
