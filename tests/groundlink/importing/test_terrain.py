# SPDX-License-Identifier: Apache-2.0
"""Terrain from files: the same ground whatever the format, and its materials in place."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groundlink.importing import terrain
from groundlink.importing.terrain import BadTerrain
from groundlink.importing.terrain_specs import (
    HeightmapFile,
    HillsTerrain,
    LevelArea,
    MaterialRule,
    Road,
    SurfaceMap,
)
from groundlink.world.terrain import Ground, load_ground

from .files import HEIGHTMAPS, HEIGHTS, esri, npy, png, sixteen_bits, tiff, write

GIVEN: dict[str, dict[str, Any]] = {
    "map.png": {"heights_m": (0.0, 100.0), "cell_m": 2.5},
    "map.npy": {"cell_m": 2.5},
}


def made(folder: Path, name: str, content: bytes, **given: Any) -> tuple[Ground, list[str]]:
    write(folder, name, content)
    told: list[str] = []
    spec = HeightmapFile(file=name, material="grass", **given)
    return load_ground(terrain.build(spec, folder, told.append)), told


@pytest.mark.parametrize("name", HEIGHTMAPS)
def test_every_format_is_the_same_ground(tmp_path: Path, name: str) -> None:
    here, told = made(tmp_path, name, HEIGHTMAPS[name], **GIVEN.get(name, {}))
    assert here.heights == pytest.approx(HEIGHTS, abs=1e-3)
    assert here.cell_m == 2.5
    assert (here.x0_m, here.y0_m) == (-10.0, -6.25)
    assert not told


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_adobe_deflate"])
def test_compressed_geotiffs_are_read(tmp_path: Path, compression: str) -> None:
    here, _ = made(tmp_path, "map.tif", tiff(compression=compression))
    assert (here.heights == HEIGHTS).all()


@pytest.mark.parametrize("of", [np.int16, np.uint16, np.int32])
def test_geotiffs_of_whole_meters_are_read(tmp_path: Path, of: type) -> None:
    here, _ = made(tmp_path, "map.tif", tiff(np.rint(HEIGHTS).astype(of)))
    assert (here.heights == np.rint(HEIGHTS)).all()


def test_the_map_is_as_large_and_where_it_is_said(tmp_path: Path) -> None:
    here, _ = made(tmp_path, "map.npy", npy(), size_m=(80.0, 50.0), at_m=(100.0, 200.0, -3.0))
    assert here.cell_m == 10.0
    assert (here.x0_m, here.y0_m) == (60.0, 175.0)
    assert here.heights == pytest.approx(HEIGHTS - 3.0, abs=1e-5)


def test_eight_bit_heights_are_warned_about(tmp_path: Path) -> None:
    gray = (sixteen_bits() >> 8).astype(np.uint8)
    here, told = made(tmp_path, "map.png", png(gray), heights_m=(0.0, 100.0), cell_m=1.0)
    assert here.heights == pytest.approx(HEIGHTS, abs=0.5)
    assert len(told) == 1
    assert "8 bits a height: the ground has steps of 0.392 m; save it with 16 bits" in told[0]


@pytest.mark.parametrize("form", [esri, tiff])
def test_places_without_data_are_filled_from_around_them(tmp_path: Path, form: Any) -> None:
    full = np.add.outer(np.arange(41.0), np.arange(40.0)).astype(np.float32)
    holed = full.copy()
    holed[10:20, 5:30] = holed[3, 3] = holed[39, 39] = -9999
    name = "map.asc" if form is esri else "map.tif"
    here, told = made(tmp_path, name, form(holed))
    assert "252 places without a height were filled" in told[0]
    assert abs(here.heights - full).max() < 20
    assert (here.heights[holed >= 0] == full[holed >= 0]).all()
    assert here.heights[3, 3] == pytest.approx(full[3, 3], abs=2)


@pytest.mark.parametrize(
    ("name", "given", "field", "problem"),
    [
        ("map.png", {"cell_m": 1.0}, "heights_m", "0 and 65535 of map.png stand for"),
        ("map.png", {"heights_m": (3.0, 2.0), "cell_m": 1.0}, "heights_m", "lower height first"),
        ("map.npy", {"heights_m": (0.0, 1.0), "cell_m": 1.0}, "heights_m", "in meters already"),
        ("map.npy", {}, "cell_m", "map.npy does not say it"),
        ("map.npy", {"cell_m": 1.0, "size_m": (8.0, 5.0)}, "size_m", "choose one"),
        ("map.npy", {"size_m": (8.0, 6.0)}, "size_m", "cells of 1 x 1.2 m"),
    ],
)
def test_fields_that_do_not_fit_the_file(
    tmp_path: Path, name: str, given: dict[str, Any], field: str, problem: str
) -> None:
    with pytest.raises(BadTerrain, match=problem) as caught:
        made(tmp_path, name, HEIGHTMAPS[name], **given)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("scale", "words"),
    [({"degrees": True}, "cells in degrees"), ({"along_m": 2.6}, "cells of 2.5 x 2.6 m")],
)
def test_a_map_whose_cells_are_no_squares_in_meters_needs_their_length(
    tmp_path: Path, scale: dict[str, Any], words: str
) -> None:
    told: list[str] = []
    write(tmp_path, "map.tif", tiff(**scale))
    with pytest.raises(BadTerrain, match="does not say it"):
        terrain.build(HeightmapFile(file="map.tif", material="grass"), tmp_path, told.append)
    assert words in told[0]


def test_a_surface_map_names_materials_of_cells(tmp_path: Path) -> None:
    numbers = np.arange(40, dtype=np.uint8).reshape(5, 8) % 2
    for pixels in (numbers, np.pad(numbers, ((0, 1), (0, 1)))):
        write(tmp_path, "surface.png", png(pixels))
        surface = SurfaceMap(file="surface.png", materials=("grass", "rock"))
        here, _ = made(tmp_path, "map.asc", esri(), surface=surface)
        assert here.materials == ("grass", "rock")
        assert (here.surface == numbers).all()


SLOPE = np.add.outer(np.arange(21.0), np.maximum(np.arange(41.0) - 20, 0) * 2).astype(np.float32)
"""Rises by 1 in 1 to the north, in the east also by 2 in 1 to the east."""


def test_materials_by_rule_and_the_last_that_fits_counts(tmp_path: Path) -> None:
    where = (
        MaterialRule(material="rock", slope_deg=(60.0, 90.0)),
        MaterialRule(material="snow", height_m=(18.0, 1e9)),
    )
    here, _ = made(tmp_path, "map.npy", npy(SLOPE), cell_m=1.0, where=where)
    assert here.materials == ("grass", "rock", "snow")
    assert set(np.unique(here.surface[:17, :20])) == {0}
    assert (here.surface[:2, 20:28] == 1).all()
    assert (here.surface[18:] == 2).all()


def test_a_road_that_ends_where_it_begins_has_no_step_there() -> None:
    square = ((-40.0, 0.0), (0.0, -40.0), (40.0, 0.0), (0.0, 40.0), (-40.0, 0.0))
    ring = Road(points_m=square, width_m=6.0, material="asphalt", smooth_m=40.0)
    spec = HillsTerrain(
        size_m=(120, 120), cell_m=1, height_m=20, longest_m=120, material="grass", roads=(ring,)
    )
    here = load_ground(terrain.build(spec, Path(), print))
    before, behind = here.height_at([-39.3, -39.3], [0.7, -0.7])
    assert abs(before - behind) < 0.3  # 0.8 m where each end is smoothed for itself


def test_a_road_is_level_across_and_follows_the_ground_along() -> None:
    road = Road(
        points_m=((-45.0, -20.0), (0.0, -20.0), (0.0, 60.0)),  # and on beyond the map
        width_m=6.0,
        material="asphalt",
        smooth_m=20.0,
    )
    spec = HillsTerrain(
        size_m=(100.0, 100.0), cell_m=0.5, height_m=8.0, longest_m=60.0, roughness=0.5,
        material="grass", roads=(road,), seed=3,
    )  # fmt: skip
    wild = load_ground(terrain.build(HillsTerrain(**_fields(spec) | {"roads": ()}), Path(), print))
    here = load_ground(terrain.build(spec, Path(), print))
    across = np.linspace(-2.4, 2.4, 9)
    for along in (-30.0, -10.0, -5.0):  # the last beside the bend
        profile = here.height_at(np.full(9, along), -20.0 + across)
        assert np.ptp(profile) < 0.02
        assert np.ptp(wild.height_at(np.full(9, along), -20.0 + across)) > 0.03
        assert abs(profile[4] - wild.height_at(along, -20.0)) < 1.0
        assert (here.material_at(np.full(9, along), -20.0 + across) == 1).all()
    north = np.linspace(-15, 49, 200)
    bumps = [np.abs(np.diff(g.height_at(np.zeros(200), north), n=2)).max() for g in (wild, here)]
    assert bumps[1] < 0.5 * bumps[0]
    # Beyond its shoulders nothing has changed.
    far = np.full(50, -20.0 + 3.0 + 4.0 + 1.0)
    x = np.linspace(-40, -10, 50)
    assert here.height_at(x, far) == pytest.approx(wild.height_at(x, far), abs=1e-6)


def test_a_pond_is_level_and_a_place_is_as_high_as_told() -> None:
    levels = (
        LevelArea(at_m=(-20.0, 0.0), radius_m=8.0, material="water"),
        LevelArea(at_m=(20.0, 0.0), radius_m=8.0, height_m=3.0),
        LevelArea(at_m=(500.0, 0.0), radius_m=8.0, material="water"),
    )
    spec = HillsTerrain(
        size_m=(100.0, 60.0), cell_m=0.5, height_m=8.0, longest_m=60.0,
        at_m=(0.0, 0.0, 10.0), material="grass", levels=levels,
    )  # fmt: skip
    wild = load_ground(terrain.build(HillsTerrain(**_fields(spec) | {"levels": ()}), Path(), print))
    here = load_ground(terrain.build(spec, Path(), print))
    turn = np.linspace(0, 2 * np.pi, 40)
    for radius in (0.0, 4.0, 7.0):
        x, y = radius * np.cos(turn), radius * np.sin(turn)
        assert np.ptp(here.height_at(x - 20, y)) < 1e-5
        assert here.height_at(x + 20, y) == pytest.approx(13.0, abs=1e-5)
        assert (here.material_at(x - 20, y) == 1).all()
        assert not here.material_at(x + 20, y).any()
    rim = wild.height_at(8 * np.cos(turn) - 20, 8 * np.sin(turn))
    assert here.height_at(-20.0, 0.0) == pytest.approx(rim.min(), abs=0.3)
    assert here.height_at(-20.0, 15.0) == wild.height_at(-20.0, 15.0)


def _fields(spec: HillsTerrain) -> dict[str, Any]:
    return {name: getattr(spec, name) for name in spec.__struct_fields__}
