# SPDX-License-Identifier: Apache-2.0
"""Every form of picture that a camera sends becomes one for a page, or is left out."""

import base64
import io
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from groundlink.report.analysis.thumbnails import MAX_COMPRESSED_BYTES, data_uri


def image(encoding: str, data: np.ndarray[Any, Any], **more: Any) -> SimpleNamespace:
    height, width = data.shape[:2]
    flat = np.ascontiguousarray(data).view(np.uint8).reshape(-1)
    fields = {"step": len(flat) // max(height, 1), "is_bigendian": 0} | more
    return SimpleNamespace(encoding=encoding, height=height, width=width, data=flat, **fields)


def shown(message: SimpleNamespace) -> np.ndarray[Any, Any]:
    uri = data_uri(message)
    assert uri is not None
    data = base64.b64decode(uri.removeprefix("data:image/png;base64,"))
    return np.round(255 * imread(io.BytesIO(data), format="png")[:, :, :3])


ORANGE = (250, 120, 10)


@pytest.mark.parametrize(
    ("encoding", "pixel", "expected"),
    [
        ("rgb8", ORANGE, ORANGE),
        ("bgr8", ORANGE[::-1], ORANGE),
        ("rgba8", (*ORANGE, 255), ORANGE),
        ("bgra8", (*ORANGE[::-1], 0), ORANGE),
        ("mono8", (77,), (77, 77, 77)),
        ("8UC1", (77,), (77, 77, 77)),
    ],
)
def test_colors_are_in_their_order(
    encoding: str, pixel: tuple[int, ...], expected: tuple[int, ...]
) -> None:
    data = np.tile(np.array(pixel, np.uint8), (4, 6, 1))
    assert shown(image(encoding, data))[2, 3].tolist() == list(expected)


def test_rows_may_be_padded() -> None:
    rows = np.zeros((4, 32), np.uint8)
    rows[:, :18] = 200
    message = image("rgb8", rows.reshape(4, 32))
    message.width = 6
    assert shown(message).shape == (4, 6, 3)
    assert (shown(message) == 200).all()


@pytest.mark.parametrize(
    ("encoding", "dtype", "big"), [("16UC1", "<u2", 0), ("16UC1", ">u2", 1), ("32FC1", "<f4", 0)]
)
def test_depth_is_light_where_it_is_near(encoding: str, dtype: str, big: int) -> None:
    depth = np.full((10, 10), 4000).astype(dtype)
    depth[:5] = 1000
    depth[9, 9] = 0
    gray = shown(image(encoding, depth, is_bigendian=big))
    assert gray[0, 0, 0] > 240
    assert 30 < gray[8, 0, 0] < 60
    assert gray[9, 9, 0] == 0


def test_large_pictures_are_thinned() -> None:
    assert shown(image("mono8", np.zeros((960, 1280), np.uint8))).shape == (240, 320, 3)


@pytest.mark.parametrize(
    "message",
    [
        image("bayer_rggb8", np.zeros((4, 4), np.uint8)),
        image("rgb8", np.zeros((0, 4, 3), np.uint8), step=12),
        SimpleNamespace(encoding="rgb8", height=9, width=9, step=27, data=np.zeros(3, np.uint8)),
        SimpleNamespace(format="jpeg", data=np.zeros(9, np.uint8)),
        SimpleNamespace(format="png", data=b"\x89PNG" + bytes(MAX_COMPRESSED_BYTES)),
    ],
)
def test_what_is_not_known_is_left_out(message: SimpleNamespace) -> None:
    assert data_uri(message) is None
