# SPDX-License-Identifier: Apache-2.0
"""Rough ground has the spectra of ISO 8608."""

import numpy as np
import pytest

from groundlink.world.roughness import CELL_M, CELLS, RoughGround, roughness_of

STEP_M = CELL_M / 2
LENGTH = 2 * CELLS
"""Heights along a line, as far as the tile reaches."""


@pytest.fixture(scope="module")
def ground() -> RoughGround:
    return RoughGround(3)


@pytest.mark.parametrize("heading", [(1.0, 0.0), (0.0, 1.0)])
def test_lines_have_the_spectrum_of_class_a(
    ground: RoughGround, heading: tuple[float, float]
) -> None:
    along = np.outer(np.arange(LENGTH) * STEP_M, heading)
    power = np.zeros(LENGTH // 2 + 1)
    lines = 12
    for line in range(lines):
        offset = 4.2 * line * np.array(heading[::-1])
        heights = [ground.height_m(x, y) for x, y in (along + offset).tolist()]
        power += 2 * np.abs(np.fft.rfft(heights)) ** 2 * STEP_M / LENGTH / lines
    frequency = np.fft.rfftfreq(LENGTH, STEP_M)
    for low, high in ((0.05, 0.3), (0.3, 1.0), (1.0, 2.83)):
        band = (frequency >= low) & (frequency < high)
        # Gd(n) n^2 = Gd(n0) n0^2, with n0 = 0.1 cycles/m and Gd(n0) = 16e-6 m^3 for class A.
        level = (power[band] * frequency[band] ** 2).mean() / (16e-6 * 0.1**2)
        assert level == pytest.approx(1.0, abs=0.35 if high < 0.5 else 0.1), (low, high)
    assert power[frequency > 10.5].sum() < 0.005 * power[frequency > 1.0].sum()


def test_a_tile_repeats_without_a_seam(ground: RoughGround) -> None:
    around = [ground.height_m(x, 7.0) for x in np.arange(-1.0, 1.0, 0.001)]
    assert np.abs(np.diff(around, 2)).max() < 5e-6
    assert ground.height_m(0.123, -0.4) == pytest.approx(
        ground.height_m(0.123 + CELLS * CELL_M, -0.4 - CELLS * CELL_M), abs=1e-12
    )


def test_the_seed_makes_the_ground(ground: RoughGround) -> None:
    assert RoughGround(3).height_m(1.0, 2.0) == ground.height_m(1.0, 2.0)
    assert RoughGround(4).height_m(1.0, 2.0) != ground.height_m(1.0, 2.0)


def test_each_class_is_twice_as_high_as_the_one_before() -> None:
    assert roughness_of(None)("soil") == 0.0
    assert roughness_of("A")("soil") == 1.0
    by_material = roughness_of({"soil": "E", "asphalt": "B"})
    assert [by_material(name) for name in ("soil", "asphalt", "grass")] == [16.0, 2.0, 0.0]
