# SPDX-License-Identifier: Apache-2.0
"""Conversion between linear light and sRGB (IEC 61966-2-1), both in the range 0..1."""

import numpy as np

from groundlink.core.frames import Floats


def srgb(linear: Floats) -> Floats:
    """Return sRGB values of linear colors."""
    part = np.clip(linear, 0, 1)
    return np.where(part <= 0.0031308, 12.92 * part, 1.055 * part ** (1 / 2.4) - 0.055)


def linear(srgb: Floats) -> Floats:
    """Return linear colors of sRGB values."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
