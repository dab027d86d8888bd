# SPDX-License-Identifier: Apache-2.0
"""Firings in a room whose answers are known."""

import numpy as np

from groundlink.fitting.firings import Firings

STEP_RAD = np.radians(0.2)
HALF_M = np.array([4.0, 9.0])
"""Of a room with four walls."""

WHITE, DARK = 80.0, 4.0


def exact(turns: int = 4, lasers: int = 16) -> Firings:
    """Return ranges without error: walls along x are white, those along y dark."""
    azimuth = (np.arange(turns * 1800) + 0.5) * STEP_RAD
    heights = np.cos(np.radians(np.linspace(-15, 15, lasers)))
    to_walls = HALF_M[:, None] / np.abs([np.cos(azimuth), np.sin(azimuth)])
    range_m = to_walls.min(axis=0)[:, None] / heights
    intensity = np.where(to_walls.argmin(axis=0) == 0, WHITE, DARK)
    return Firings(range_m, np.repeat(intensity[:, None], lasers, axis=1), STEP_RAD)


def measured(
    white_m: float, dark_m: float, *, lost: float = 0.0, step_m: float = 0.0, seed: int = 1
) -> Firings:
    """Return ranges with noise of the brightness; of dark ones a share is lost."""
    firings, source = exact(), np.random.default_rng(seed)
    dark = firings.intensity == DARK
    noise = source.normal(size=dark.shape) * np.where(dark, dark_m, white_m)
    range_m = firings.range_m + noise
    if step_m:
        range_m = np.rint(range_m / step_m) * step_m
    range_m[dark & (source.random(dark.shape) < lost)] = 0
    return firings._replace(range_m=range_m)
