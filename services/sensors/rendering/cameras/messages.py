# SPDX-License-Identifier: Apache-2.0
"""Pictures as messages of the bus."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.messages.base import packed
from groundlink.messages.imagery import CameraInfo, CompressedImage, Image
from groundlink.scenario.cameras import Lens
from services.sensors.rendering.gl.pinhole import Pinhole

Pixels = NDArray[np.uint8]


def _gray(rgb: Pixels) -> Pixels:
    """Return the brightness, shape (height, width)."""
    return rgb if rgb.ndim == 2 else np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)


def _bayer(rgb: Pixels) -> Pixels:
    """Return the values behind a Bayer filter (red green, green blue), shape (height, width)."""
    if rgb.ndim == 2:
        return rgb
    mosaic = rgb[..., 1].copy()
    mosaic[::2, ::2] = rgb[::2, ::2, 0]
    mosaic[1::2, 1::2] = rgb[1::2, 1::2, 2]
    return mosaic


ENCODINGS: dict[str, Callable[[Pixels], Pixels]] = {
    "rgb8": lambda rgb: rgb,
    "bgr8": lambda rgb: np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), np.uint8),
    "mono8": _gray,
    "bayer_rggb8": _bayer,
}
"""Conversions from red, green, blue, shape (height, width, 3), to the pixels of a ROS encoding.

Pixels with one number already stay as they are.
"""


def image(stamp_nanos: int, frame: str, encoding: str, pixels: NDArray[np.generic]) -> Image:
    """Return pixels, shape (height, width) or (height, width, channels), as a message."""
    height, width = pixels.shape[:2]
    return Image(
        stamp_nanos=stamp_nanos,
        frame=frame,
        height=height,
        width=width,
        encoding=encoding,
        row_bytes=pixels.nbytes // height,
        data=packed(pixels),
    )


def jpeg(
    stamp_nanos: int, frame: str, pixels: Pixels, *, gray: bool, quality: int
) -> CompressedImage:
    """Return a JPEG of red, green, blue, shape (height, width, 3), or of its brightness.

    The format string is that of image_transport: the encoding of the pixels; that of the file.
    """
    encoding, stored = ("mono8", "mono8") if gray else ("rgb8", "bgr8")
    done, file = cv2.imencode(
        ".jpg", ENCODINGS[stored](pixels), (cv2.IMWRITE_JPEG_QUALITY, quality)
    )
    assert done
    return CompressedImage(
        stamp_nanos=stamp_nanos,
        frame=frame,
        format=f"{encoding}; jpeg compressed {stored}",
        data=packed(file),
    )


def camera_info(
    stamp_nanos: int,
    frame: str,
    pinhole: Pinhole,
    lens: Lens,
    *,
    baseline_m: float = 0.0,
) -> CameraInfo:
    """Return the projection from the optical frame to pixels.

    The eyes of a pair are parallel, so R is the identity: to rectify a picture means to undistort
    it.

    Parameters
    ----------
    baseline_m
        Distance to the right of a stereo pair's left eye: P has Tx = -fx baseline.
    """
    matrix = pinhole.matrix()
    projection = np.hstack([matrix, [[-pinhole.fx * baseline_m], [0.0], [0.0]]])
    return CameraInfo(
        stamp_nanos=stamp_nanos,
        frame=frame,
        height=pinhole.height,
        width=pinhole.width,
        distortion_model=lens.model,
        distortion=packed(np.array(lens.coefficients)),
        intrinsic=packed(matrix),
        rectification=packed(np.eye(3)),
        projection=packed(projection),
    )
