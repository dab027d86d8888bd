# SPDX-License-Identifier: Apache-2.0
"""ROS messages as numpy arrays.

`row` turns a message of any type into the fields of one record: numbers stay numbers, messages of
numbers alone (points, vectors, quaternions) become vectors, nested messages become dotted names,
and times become nanoseconds. Text and lists of messages are left out. `content` is the array that a
message exists for: the points of a cloud, the pixels of an image. Of labels, each detection and
each entry of a table is a record, with its texts.
"""

import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import RequirementError
from groundlink.ros.pixels import ENCODINGS, pixels
from groundlink.ros.types import nanos

_POINT_FIELD_TYPES = ("", "i1", "u1", "<i2", "<u2", "<i4", "<u4", "<f4", "<f8")
"""numpy's type for each `datatype` of sensor_msgs/PointField."""


LISTS = {
    "vision_msgs/msg/Detection2DArray": "detections",
    "vision_msgs/msg/Detection3DArray": "detections",
    "vision_msgs/msg/LabelInfo": "class_map",
}
"""Field of the messages that are records, by the ROS type of the message that lists them."""

_TEXT = "U128"
"""Type of a text in a record."""


def items(messages: Iterable[tuple[int, Any]]) -> Iterator[tuple[int, Any]]:
    """Yield messages with their times; of those in `LISTS`, the messages in their lists."""
    for time, message in messages:
        if field := LISTS.get(message.__msgtype__):
            for item in getattr(message, field):
                yield time, item
        else:
            yield time, message


def row(message: Any, prefix: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the names and values of a message's fields. A header yields `stamp` alone."""
    is_label = message.__msgtype__.startswith("vision_msgs/")
    for part in _parts(message):
        name, value = prefix + part, getattr(message, part)
        ros_type = getattr(value, "__msgtype__", "")
        if is_label and isinstance(value, str):
            yield name, np.asarray(value, _TEXT)
        elif is_label and part == "results":
            yield from row(value[0].hypothesis, prefix)
        elif not ros_type:
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


def record_array(
    messages: Sequence[tuple[int, Any]], like: np.dtype[np.void] | None = None
) -> NDArray[np.void]:
    """Return messages of one type, each after its time in nanoseconds, as a structured array.

    The field `stamp` is that of the message's header, else its time.

    Raises
    ------
    ValueError
        when a list differs in length between the messages, or from the record `like`.
    """
    rows = [{"stamp": np.asarray(time)} | dict(row(message)) for time, message in messages]
    found = table(rows)
    if like not in (None, found.dtype):
        raise ValueError("the lists differ in length from those of earlier messages")
    return found


def table(rows: Sequence[Mapping[str, NDArray[Any]]]) -> NDArray[np.void]:
    """Return the rows of messages of one type as a structured array.

    Raises
    ------
    ValueError
        when a list differs in length between the rows.
    """
    fields = [(name, value.dtype, value.shape) for name, value in rows[0].items()]
    records = np.empty(len(rows), np.dtype(fields))
    for name in rows[0]:
        records[name] = np.stack([row[name] for row in rows])
    return records


def columns(records: NDArray[np.void], message: Any) -> dict[str, NDArray[Any]]:
    """Return a column for each component of a record's fields, by dotted name.

    Columns of vectors are named like `linear_acceleration.x`, those of lists like `position.wheel`
    where the message names the elements, else like `ranges.0`.

    Parameters
    ----------
    message
        one of the messages, for the names of the components.
    """
    found: dict[str, NDArray[Any]] = {}
    for name in records.dtype.names or ():
        if records[name].ndim == 1:
            found[name] = records[name]
            continue
        flat = records[name].reshape(len(records), -1)
        found |= {f"{name}.{part}": flat[:, i] for i, part in enumerate(_components(message, name))}
    return found


def _components(message: Any, name: str) -> list[str]:
    """Return the names of the components of a vector field of `row`."""
    elements = getattr(message, "name", None)
    for part in name.split("."):
        message = getattr(message, part)
    if is_dataclass(message):
        return _parts(message)
    size = np.size(message)
    if isinstance(elements, list) and len(elements) == size:
        return elements
    return [str(i) for i in range(size)]


def content(message: Any) -> NDArray[Any] | None:
    """Return the points or pixels of a message; None for other types.

    A cloud is a structured array, shape (N,), with the cloud's own fields; an image has the shape
    (height, width) or (height, width, channels), with channels in the order red, green, blue,
    alpha.

    Raises
    ------
    RequirementError
        when an image is compressed and pillow is not installed.
    KeyError
        when the encoding of an image is unknown.
    """
    reader = (CLOUDS | IMAGES).get(message.__msgtype__)
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
            "formats": [
                # A field that no writer counted has one number, as has one with a count of 1.
                (_POINT_FIELD_TYPES[field.datatype], field.count if field.count > 1 else ())
                for field in cloud.fields
            ],
            "offsets": [field.offset for field in cloud.fields],
            "itemsize": cloud.point_step,
        }
    )
    return np.frombuffer(cloud.data, record.newbyteorder(">") if cloud.is_bigendian else record)


def _image(image: Any) -> NDArray[Any]:
    encoding, size = ENCODINGS[image.encoding], (image.height, image.width, image.step)
    values = pixels(encoding, image.data, *size, big=bool(image.is_bigendian))
    order = [encoding.channels.index(color) for color in "RGBA" if color in encoding.channels]
    return values[..., order] if order else values


def _compressed_image(image: Any) -> NDArray[Any]:
    try:
        from PIL import Image
    except ImportError:
        raise RequirementError(
            "compressed images need the Python package `pillow`. Fix: pip install pillow"
        ) from None
    return np.asarray(Image.open(io.BytesIO(bytes(image.data))))


CLOUDS: dict[str, Callable[[Any], NDArray[Any]]] = {"sensor_msgs/msg/PointCloud2": _points}
"""Function that returns the points, by ROS type."""

IMAGES: dict[str, Callable[[Any], NDArray[Any]]] = {
    "sensor_msgs/msg/Image": _image,
    "sensor_msgs/msg/CompressedImage": _compressed_image,
}
"""Function that returns the pixels, by ROS type."""

POSES = {
    "nav_msgs/msg/Odometry": "pose.pose",
    "geometry_msgs/msg/PoseStamped": "pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose",
}
"""Field of the pose, by ROS type."""
