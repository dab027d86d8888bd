# SPDX-License-Identifier: Apache-2.0
"""ROS messages as numpy arrays.

`row` turns a message of any type into the fields of one record: numbers stay numbers, messages of
numbers alone (points, vectors, quaternions) become vectors, nested messages become dotted names,
and times become nanoseconds. Text and lists of messages are left out. `content` is the array that a
message exists for: the points of a cloud, the pixels of an image.
"""

import io
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import RequirementError
from groundlink.ros.pixels import ENCODINGS, pixels
from groundlink.ros.types import nanos

_POINT_FIELD_TYPES = ("", "i1", "u1", "<i2", "<u2", "<i4", "<u4", "<f4", "<f8")
"""numpy's type for each `datatype` of sensor_msgs/PointField."""


def row(message: Any, prefix: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the names and values of a message's fields. A header yields `stamp` alone."""
    for part in _parts(message):
        name, value = prefix + part, getattr(message, part)
        ros_type = getattr(value, "__msgtype__", "")
        if not ros_type:
            array = np.asarray(value)
            if array.dtype.kind in "biuf":
                yield name, array
        elif ros_type == "std_msgs/msg/Header":
            yield f"{prefix}stamp", np.asarray(nanos(value.stamp))
        elif ros_type == "builtin_interfaces/msg/Time":
            yield name, np.asarray(nanos(value))
        elif (vector := _vector(value)) is not None:
            yield name, vector
        else:
            yield from row(value, f"{name}.")


def components(message: Any, name: str) -> list[str]:
    """Return the names of the components of a vector field of `row`."""
    for part in name.split("."):
        message = getattr(message, part)
    if is_dataclass(message):
        return _parts(message)
    return [str(i) for i in range(np.size(message))]


def content(message: Any) -> NDArray[Any] | None:
    """Return the points or pixels of a message; None for other types.

    A cloud is a structured array, shape (N,), with the cloud's own fields; an image has the shape
    (height, width) or (height, width, channels).

    Raises
    ------
    RequirementError
        when an image is compressed and pillow is not installed.
    KeyError
        when the encoding of an image is unknown.
    """
    reader = _CONTENTS.get(message.__msgtype__)
    return None if reader is None else reader(message)


def _parts(message: Any) -> list[str]:
    """Return the fields of a message, without its constants and its type."""
    return [f.name for f in fields(message) if not f.name.isupper() and f.name != "__msgtype__"]


def _vector(message: Any) -> NDArray[np.float64] | None:
    values = [getattr(message, part) for part in _parts(message)]
    return np.array(values) if all(isinstance(value, float) for value in values) else None


def _points(cloud: Any) -> NDArray[np.void]:
    record = np.dtype(
        {
            "names": [field.name for field in cloud.fields],
            "formats": [_POINT_FIELD_TYPES[field.datatype] for field in cloud.fields],
            "offsets": [field.offset for field in cloud.fields],
            "itemsize": cloud.point_step,
        }
    )
    return np.frombuffer(cloud.data, record)


def _image(image: Any) -> NDArray[Any]:
    size = (image.height, image.width, image.step)
    return pixels(ENCODINGS[image.encoding], image.data, *size, big=bool(image.is_bigendian))


def _compressed_image(image: Any) -> NDArray[Any]:
    try:
        from PIL import Image
    except ImportError:
        raise RequirementError(
            "compressed images need the Python package `pillow`. Fix: pip install pillow"
        ) from None
    return np.asarray(Image.open(io.BytesIO(bytes(image.data))))


_CONTENTS: dict[str, Callable[[Any], NDArray[Any]]] = {
    "sensor_msgs/msg/PointCloud2": _points,
    "sensor_msgs/msg/Image": _image,
    "sensor_msgs/msg/CompressedImage": _compressed_image,
}
