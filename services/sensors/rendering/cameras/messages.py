# SPDX-License-Identifier: Apache-2.0
"""Pictures as messages of the bus.

Rule: what a message says of a picture is the truth of how it was made.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.messages.base import packed
from groundlink.messages.imagery import CameraInfo, CompressedImage, Image
from groundlink.scenario.lenses import Lens
from services.sensors.rendering.optics.pinhole import Pinhole

Pixels = NDArray[np.uint8]


def _grey(rgb: Pixels) -> Pixels:
    """Return the brightness, shape (height, width)."""
    return rgb if rgb.ndim == 2 else np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)


def _bayer(rgb: Pixels) -> Pixels:
    """Return what is behind a colour filter of red green, green blue, shape (height, width)."""
    if rgb.ndim == 2:
        return rgb
    mosaic = rgb[..., 1].copy()
    mosaic[::2, ::2] = rgb[::2, ::2, 0]
    mosaic[1::2, 1::2] = rgb[1::2, 1::2, 2]
    return mosaic


ENCODINGS: dict[str, Callable[[Pixels], Pixels]] = {
    "rgb8": lambda rgb: rgb,
    "bgr8": lambda rgb: np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), np.uint8),
    "mono8": _grey,
    "bayer_rggb8": _bayer,
}
"""From red, green, blue, shape (height, width, 3), to the pixels of an encoding of ROS.

What has one number a pixel already stays as it is.
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
        data=packed(np.array(pixels, order="C")),  # its own: frames are overwritten
    )


def jpeg(
    stamp_nanos: int, frame: str, pixels: Pixels, *, grey: bool, quality: int
) -> CompressedImage:
    """Return a JPEG of red, green, blue, shape (height, width, 3), or of its brightness.

    The format is as image_transport has it: the pixels' encoding; the file's.
    """
    encoding, stored = ("mono8", "mono8") if grey else ("rgb8", "bgr8")
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
    """Return how points of the optical frame come to pixels.

    Eyes of a pair look the same way, so R is one: to rectify a picture is to undistort it.

    Parameters
    ----------
    baseline_m
        How far to the right of a stereo pair's left eye the camera is: P has Tx = -fx baseline.
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
