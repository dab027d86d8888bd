# SPDX-License-Identifier: Apache-2.0
"""Depth as ROS reads it: REP 118's images, image_transport's compressedDepth, points."""

import math
import struct

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.messages.imagery import CompressedImage
from services.sensors.depth_camera.forms import compressed_depth, millimeters, pixels, points
from services.sensors.rendering.gl.pinhole import Pinhole

NOTHING = (math.nan, math.inf, -math.inf)
ROW = np.array([[0.5, 1.0, 1.2344, 9.999, 10.0, *NOTHING]], np.float32)


def decoded(message: CompressedImage) -> NDArray[np.generic]:
    """Return what image_transport's decoder would: a header {int32, float, float}, then a PNG.

    Of 32FC1, z = A / (stored - B), and NaN for a stored 0; of 16UC1, what is stored.
    """
    encoding, _, rest = message.format.partition("; ")
    assert rest == "compressedDepth png"
    kind, a, b = struct.unpack_from("<iff", message.data)
    assert kind == 1
    stored = cv2.imdecode(np.frombuffer(message.data[12:], np.uint8), cv2.IMREAD_UNCHANGED)
    assert stored is not None
    assert stored.dtype == np.uint16
    if encoding == "16UC1":
        return stored
    with np.errstate(divide="ignore"):
        z = np.float32(a) / (stored.astype(np.float32) - np.float32(b))
    return np.where(stored == 0, np.float32(np.nan), z)


def test_millimeters() -> None:
    assert millimeters(ROW).tolist() == [[500, 1000, 1234, 9999, 10000, 0, 0, 0]]
    edge = np.array([[65.535, 65.536, 0.0004, 0.0, -1.0]], np.float32)
    assert millimeters(edge).tolist() == [[65535, 0, 0, 0, 0]]


def test_meters_stay_as_they_are() -> None:
    same = pixels(ROW, "32FC1")
    assert same.dtype == np.float32
    assert np.array_equal(same, ROW, equal_nan=True)


def test_compressed_depth_of_millimeters_is_lossless() -> None:
    message = compressed_depth(7, "eye", ROW, "16UC1", 10.0)
    assert (message.stamp_nanos, message.frame) == (7, "eye")
    assert message.format == "16UC1; compressedDepth png"
    assert np.array_equal(decoded(message), millimeters(ROW))


def test_compressed_depth_of_meters_is_within_a_step() -> None:
    z = np.linspace(0.16, 10.0, 5000, dtype=np.float32).reshape(50, 100)
    message = compressed_depth(7, "eye", z, "32FC1", 10.0)
    back = decoded(message)
    step = z**2 / 10100.0
    assert np.abs((back - z) / step).max() < 0.51
    assert back[-1, -1] == pytest.approx(10.0, abs=1e-5)
    assert message.format == "32FC1; compressedDepth png"
    # What the codec itself writes with its defaults, depth_quantization 100 and depth_max 10.
    assert struct.unpack_from("<ff", message.data, 4) == pytest.approx((10100.0, -1009.0))


def test_compressed_depth_has_nothing_for_what_is_none() -> None:
    row = np.array([[*NOTHING, 0.0, 0.1, 10.001, 2.0]], np.float32)
    back = decoded(compressed_depth(7, "eye", row, "32FC1", 10.0))
    assert np.isnan(back[0, :-1].astype(np.float32)).all()
    assert float(back[0, -1]) == pytest.approx(2.0, abs=4e-4)


def test_points_are_where_their_pixels_look() -> None:
    pinhole = Pinhole(8, 6, 10.0, 12.0, 3.4, 2.6)
    depth_m = np.full((6, 8), 2.0, np.float32)
    depth_m[0, 0], depth_m[2, 2], depth_m[4, 4] = NOTHING
    depth_m[2, 4] = 3.0
    color = np.zeros((6, 8, 3), np.uint8)
    color[2, 4] = (30, 60, 90)
    slopes = pinhole.rays()[..., :2]
    cloud = points(7, "eye", depth_m, slopes, every=2, color=color)
    made = cloud.records()
    kept = [
        (r, c) for r in (0, 2, 4) for c in (0, 2, 4, 6) if (r, c) not in ((0, 0), (2, 2), (4, 4))
    ]
    back = pinhole.matrix() @ np.stack([made["x"], made["y"], made["z"]]) / made["z"]
    assert np.allclose(back[:2].T, [(c, r) for r, c in kept], atol=1e-5)
    assert np.array_equal(made["z"], [depth_m[place] for place in kept])
    assert np.array_equal(made["ring"], [5 - r for r, _ in kept])
    assert np.array_equal(made["intensity"], [60.0 if p == (2, 4) else 0.0 for p in kept])
