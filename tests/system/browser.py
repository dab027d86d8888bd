# SPDX-License-Identifier: Apache-2.0
"""Headless Chromium: screenshots of pages, and a check for blank pages."""

import subprocess
from pathlib import Path

import numpy as np
from matplotlib.image import imread
from numpy.typing import NDArray

from tests.bridge.programs import need


def screenshot(page: Path, out: Path, *, width: int, height: int, dark: bool = False) -> Path:
    """Take a picture of a page's beginning; skip the test where there is no Chromium."""
    need("chromium")
    scheme = ["--blink-settings=preferredColorScheme=0"] if dark else []
    done = subprocess.run(
        [
            *("chromium", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"),
            *("--disable-dev-shm-usage", f"--user-data-dir={out.parent / 'profile'}"),
            *(f"--screenshot={out}", f"--window-size={width},{height}", *scheme),
            page.resolve().as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert out.is_file(), done.stderr
    return out


def pixels(picture: Path) -> NDArray[np.uint8]:
    """Return a PNG's red, green, blue, shape (height, width, 3)."""
    return np.round(255 * imread(picture)[:, :, :3]).astype(np.uint8)


def colors(image: NDArray[np.uint8]) -> dict[str, int]:
    """Return how many pixels there are of each color, as `#rrggbb`: the histogram."""
    codes = image.reshape(-1, 3).astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    found, counts = np.unique(codes, return_counts=True)
    return {f"#{code:06x}": int(n) for code, n in zip(found.tolist(), counts, strict=True)}


def assert_not_blank(image: NDArray[np.uint8], *, bands: int = 4) -> None:
    """Fail where a picture, or a band of it from side to side, has next to nothing on it."""
    for number, band in enumerate(np.array_split(image, bands)):
        histogram = colors(band)
        background = max(histogram.values())
        share = 1 - background / (band.shape[0] * band.shape[1])
        assert share > 0.01, f"band {number} of {bands} is blank: {share:.2%} drawn"
        assert len(histogram) > 20, f"band {number} of {bands}: {len(histogram)} colors"
