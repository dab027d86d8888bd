# SPDX-License-Identifier: Apache-2.0
"""Hills: the same for a seed, as high and as smooth as told, large ones in little time."""

import hashlib

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.importing.hills import heights
from groundlink.importing.terrain_specs import HillsTerrain

SPEC = HillsTerrain(
    seed=1, size_m=(300.0, 200.0), cell_m=1.0, height_m=12.0, longest_m=80.0, material="grass"
)


def test_a_seed_gives_the_same_bytes() -> None:
    first = heights(SPEC)
    assert first.dtype == np.float32
    assert first.shape == (201, 301)
    assert hashlib.sha256(first.tobytes()).hexdigest() == DIGEST
    other = heights(replace(SPEC, seed=2))
    assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 0.5


DIGEST = "5948806e2cca8f49bea47ac5e78271e27dff192bf6f12c29d69b5d8eaa5f942c"
"""Made from sums and products alone, so it is this on every machine."""


def test_heights_go_from_zero_to_the_highest() -> None:
    made = heights(SPEC)
    assert made.min() == 0
    assert made.max() == pytest.approx(12.0, abs=1e-4)


def spectrum(made: np.ndarray) -> np.ndarray:
    """Return the power over wave numbers along x, in cycles per 300 m."""
    waves = (made - made.mean()) * np.hanning(made.shape[1])
    return (np.abs(np.fft.rfft(waves, axis=1)) ** 2).mean(axis=0)


def test_waves_are_no_shorter_than_specified() -> None:
    smooth = heights(replace(SPEC, shortest_m=40.0))
    rough = heights(replace(SPEC, shortest_m=4.0, roughness=0.8))
    short = 30  # cycles: waves of 10 m
    shares = [spectrum(made)[short:].sum() / spectrum(made).sum() for made in (smooth, rough)]
    assert shares[0] < 1e-3
    assert shares[1] > 10 * shares[0]
    flat = spectrum(heights(replace(SPEC, roughness=0.0)))
    assert flat[8:].sum() < 0.02 * flat.sum()
