# SPDX-License-Identifier: Apache-2.0
"""Encodings of measured depth as bus messages: images, compressedDepth and point clouds.

The encodings follow REP 118 and the codec of image_transport. A pixel without depth stays without
depth in every encoding.
"""

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
"""Largest 16-bit value."""

INVERSE_DEPTH = 1
"""The only format in the header of compressedDepth."""

QUANTIZATION_M = 100.0
"""Z0 of the codec, its default. The quantization step is z^2 / (Z0 (Z0 + 1)), 10 mm at 10 m."""

PNG_LEVEL = 1
"""PNG compression level. The codec's own level 9 takes ten times as long and saves a tenth in size.
"""


def millimeters(depth_m: Reals) -> Shorts:
    """Return the pixels of 16UC1: whole millimeters, 0 for no depth."""
    fits = (depth_m > 0) & (depth_m < (LARGEST + 0.5) / 1000)
    return np.rint(np.where(fits, depth_m, 0) * np.float32(1000)).astype(np.uint16)


def pixels(depth_m: Reals, encoding: str) -> Reals | Shorts:
    """Return depth, shape (height, width), as the pixels of 16UC1 or 32FC1."""
    return millimeters(depth_m) if encoding == "16UC1" else depth_m


def inverse_depth(depth_m: Reals, max_range_m: float) -> tuple[Shorts, float, float]:
    """Return depth as the codec stores 32FC1, A / z + B in 16 bits with 0 for none, and A and B.

    A = Z0 (Z0 + 1) and B = 1 - A / max, so the largest range is stored as 1 (codec.cpp of
    compressed_depth_image_transport). Depth below A / (65535 - B), which is 0.15 m for a largest
    range of 10 m, does not fit and is stored as none.
    """
    a = QUANTIZATION_M * (QUANTIZATION_M + 1)
    b = 1 - a / max_range_m
    fits = (depth_m >= a / (LARGEST - b)) & (depth_m <= max_range_m)
    stored = np.rint(a / np.where(fits, depth_m, np.float32(1)) + b)
    return np.where(fits, stored, 0).astype(np.uint16), a, b


def compressed_depth(
    stamp_nanos: int, frame: str, depth_m: Reals, encoding: str, max_range_m: float
) -> CompressedImage:
    """Return depth as compressed_depth_image_transport reads it: a 12-byte header and a PNG."""
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
    """Return a point for each pixel with depth, in the optical frame, row by row.

    Parameters
    ----------
    slopes : float array, shape (height, width, 2)
        x and y of each pixel's ray at z = 1.
    every : int
        Stride in rows and columns.
    color : uint8 array, shape (height, width, 3), optional
        Color image; the intensity of a point is the mean of red, green and blue.
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
