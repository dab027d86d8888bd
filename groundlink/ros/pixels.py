# SPDX-License-Identifier: Apache-2.0
"""Pixels of images by encoding (sensor_msgs/image_encodings.hpp). Loads no ROS types."""

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Encoding(NamedTuple):
    """Meaning of the bytes of an image."""

    channels: Literal["RGB", "BGR", "RGBA", "BGRA", "L"]
    """Channels of a pixel, in order; `L` for a single one."""

    number: str
    """numpy's type of a channel, without its byte order."""

    meter: float = 0.0
    """Value of one meter (REP 118); 0 for an image that is no depth image."""


ENCODINGS = {
    "rgb8": Encoding("RGB", "u1"),
    "bgr8": Encoding("BGR", "u1"),
    "rgba8": Encoding("RGBA", "u1"),
    "bgra8": Encoding("BGRA", "u1"),
    "mono8": Encoding("L", "u1"),
    "8UC1": Encoding("L", "u1"),
    "mono16": Encoding("L", "u2"),
    "16UC1": Encoding("L", "u2", 1000.0),
    "32FC1": Encoding("L", "f4", 1.0),
}


def pixels(
    encoding: Encoding, data: Any, height: int, width: int, row_bytes: int, *, big: bool = False
) -> NDArray[Any]:
    """Return an image without the padding of its rows.

    Parameters
    ----------
    data
        `height` rows of `row_bytes` bytes, as a buffer of bytes.
    big
        numbers are big-endian.

    Returns
    -------
    array
        shape (height, width), or (height, width, channels) for several channels.
    """
    number = np.dtype(encoding.number).newbyteorder(">" if big else "<")
    channels = len(encoding.channels)
    rows = np.frombuffer(data, np.uint8, height * row_bytes).reshape(height, row_bytes)
    used = rows[:, : width * channels * number.itemsize]
    values: NDArray[Any] = np.ascontiguousarray(used).view(number)
    return values.reshape(height, width, channels) if channels > 1 else values
