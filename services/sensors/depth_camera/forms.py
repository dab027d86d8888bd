# SPDX-License-Identifier: Apache-2.0
"""Measured depth as messages of the bus: images, compressedDepth, points.

Rule: as REP 118 and image_transport's codec have it; what is not a depth stays none.
"""

from __future__ import annotations

import struct

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.messages.base import POINT, PointCloud, packed
from groundlink.messages.imagery import CompressedImage

Reals = NDArray[np.float32]
Shorts = NDArray[np.uint16]

LARGEST = 65535
"""Of 16 bits."""

INVERSE_DEPTH = 1
"""The only format of compressedDepth's header."""

QUANTIZATION_M = 100.0
"""Z0 of the codec, its default: steps of z^2 / (Z0 (Z0 + 1)), which are 10 mm at 10 m."""

PNG_LEVEL = 1
"""The codec's own is 9, which takes ten times as long for a tenth less."""


def millimeters(depth_m: Reals) -> Shorts:
    """Return the pixels of 16UC1: whole millimetres, 0 for what is no depth."""
    fits = (depth_m > 0) & (depth_m < (LARGEST + 0.5) / 1000)
    return np.rint(np.where(fits, depth_m, 0) * np.float32(1000)).astype(np.uint16)


def pixels(depth_m: Reals, encoding: str) -> Reals | Shorts:
    """Return depth, shape (height, width), as the pixels of 16UC1 or 32FC1."""
    return millimeters(depth_m) if encoding == "16UC1" else depth_m


def inverse_depth(depth_m: Reals, max_range_m: float) -> tuple[Shorts, float, float]:
    """Return depth as the codec stores 32FC1: A / z + B in 16 bits, 0 for none; and A and B.

    A = Z0 (Z0 + 1) and B = 1 - A / max, so that the largest range is 1 (codec.cpp of
    compressed_depth_image_transport). What is nearer than A / (65535 - B), 0.15 m with 10 m as the
    largest range, does not fit and is none.
    """
    a = QUANTIZATION_M * (QUANTIZATION_M + 1)
    b = 1 - a / max_range_m
    fits = (depth_m >= a / (LARGEST - b)) & (depth_m <= max_range_m)
    stored = np.rint(a / np.where(fits, depth_m, np.float32(1)) + b)
    return np.where(fits, stored, 0).astype(np.uint16), a, b


def compressed_depth(
    stamp_nanos: int, frame: str, depth_m: Reals, encoding: str, max_range_m: float
) -> CompressedImage:
    """Return depth as compressed_depth_image_transport reads it: a header of 12 bytes and a PNG."""
    a = b = 0.0
    if encoding == "16UC1":
        stored = millimeters(depth_m)
    else:
        stored, a, b = inverse_depth(depth_m, max_range_m)
    done, file = cv2.imencode(".png", stored, (cv2.IMWRITE_PNG_COMPRESSION, PNG_LEVEL))
    assert done
    return CompressedImage(
        stamp_nanos=stamp_nanos,
        frame=frame,
        format=f"{encoding}; compressedDepth png",
        data=memoryview(struct.pack("<iff", INVERSE_DEPTH, a, b) + file.tobytes()),
    )


def points(
    stamp_nanos: int,
    frame: str,
    depth_m: Reals,
    slopes: Floats,
    *,
    every: int,
    color: NDArray[np.uint8] | None,
) -> PointCloud:
    """Return a point for every pixel that has a depth, in the optical frame, row after row.

    Parameters
    ----------
    slopes : float array, shape (height, width, 2)
        Where the ray of each pixel passes z of 1.
    every : int
        Of so many rows and columns, the first.
    colour : uint8 array, shape (height, width, 3), optional
        Makes the intensity: the mean of red, green and blue.
    """
    z = depth_m[::every, ::every]
    rows, columns = np.nonzero(np.isfinite(z))
    z = z[rows, columns]
    rows, columns = rows * every, columns * every
    made = np.zeros(len(z), POINT)
    made["x"], made["y"] = (slopes[rows, columns] * z[:, None]).T
    made["z"] = z
    made["ring"] = len(depth_m) - 1 - rows
    if color is not None:
        made["intensity"] = color[rows, columns].mean(axis=1)
    return PointCloud(stamp_nanos, frame, packed(made.view(np.uint8)))
