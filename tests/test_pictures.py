# SPDX-License-Identifier: Apache-2.0
"""Each picture of the documentation has a command that makes it."""

from pathlib import Path

import numpy as np
from PIL import Image

from services.sensors.rendering.gl.pinhole import Pinhole
from tools.pictures.__main__ import PICTURES, RECIPES, reduced
from tools.pictures.moving import draw_points


def test_every_picture_has_a_recipe() -> None:
    raster = {file.name for file in PICTURES.iterdir() if file.suffix in (".png", ".webp")}
    assert raster == RECIPES.keys()
    for recipe in RECIPES.values():
        assert any("OUT" in command for command in recipe.commands) or recipe.by_hand


def test_points_behind_a_surface_are_hidden_and_near_ones_cover_far_ones() -> None:
    picture = np.zeros((30, 40, 3), np.uint8)
    depth_m = np.full((30, 40), 5.0, np.float32)
    points = np.array([(0.0, 0, 2), (0.0, 0, 4), (1.0, 0, 8), (0.0, 0, -2), (-1.0, 0, 4)])
    colors = np.array([(1, 1, 1), (2, 2, 2), (3, 3, 3), (4, 4, 4), (5, 5, 5)], np.uint8)
    draw_points(picture, depth_m, points, colors, Pinhole(40, 30, 20, 20, 20, 15), np.eye(4), 2)
    assert (picture[15:17, 20:22] == 1).all()
    assert (picture[15:17, 15:17] == 5).all()
    assert np.count_nonzero(picture[..., 0]) == 8


def test_fewer_colors_make_a_picture_small(tmp_path: Path) -> None:
    file = tmp_path / "noise.png"
    noise = np.random.default_rng(1).integers(0, 255, (64, 64, 3), np.uint8)
    Image.fromarray(noise).save(file)
    before = file.stat().st_size
    reduced(file, 32)
    assert file.stat().st_size < before / 2
    with Image.open(file) as picture:
        assert picture.size == (64, 64)
        assert len(picture.convert("RGB").getcolors(64) or range(64)) <= 32
