# SPDX-License-Identifier: Apache-2.0
"""First difference between two ROS messages or two scenarios: the field and both values.

Fields are compared in the order of the definition, numbers by their bits: NaN equals NaN, and -0
differs from 0. Point clouds and images are compared point by point and pixel by pixel.
"""

import dataclasses
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError

from groundlink.ros.pixels import ENCODINGS
from groundlink.ros.types import STORE

_NAMES = ("child_frame_id", "name", "key", "kind")
"""Fields that name an element of a list."""

_POINT_TYPES = ("", "i1", "u1", "<i2", "<u2", "<i4", "<u4", "<f4", "<f8")
"""numpy type by sensor_msgs/PointField datatype."""


class Difference(NamedTuple):
    """The first field in which two values differ."""

    field: str
    """Path of the field, such as `pose.pose.position.x`; empty for the values themselves."""

    recorded: str
    repeated: str
    of: tuple[str, ...] = ()
    """Names of the list elements along the path."""

    more: str = ""
    """Extent of further differences in the field."""

    def __str__(self) -> str:
        of = f" ({', '.join(self.of)})" if self.of else ""
        more = f"; {self.more}" if self.more else ""
        return f"{self.field}{of}: {self.recorded} recorded, {self.repeated} repeated{more}"


def message_difference(ros_type: str, recorded: bytes, repeated: bytes) -> Difference:
    """Return the first difference of two unequal bodies.

    Parameters
    ----------
    recorded, repeated
        CDR of messages of this type.
    """
    found = value_difference(ros_type, recorded, repeated)
    return found or _in_bytes("body", recorded, repeated)


def value_difference(ros_type: str, recorded: bytes, repeated: bytes) -> Difference | None:
    """Return the first difference of the values in two unequal bodies; None for padding alone.

    DDS leaves padding undefined. Bodies that cannot be read as this type are compared by bytes.
    """
    try:
        old, new = (STORE.deserialize_cdr(body, ros_type) for body in (recorded, repeated))
        return first_difference(old, new)
    except (SerdeError, ValueError, IndexError, KeyError, struct.error):
        return _in_bytes("body", recorded, repeated)


def first_difference(recorded: Any, repeated: Any) -> Difference | None:
    """Return the first difference of messages, dicts or lists; None if they are equal."""
    return next(_differences(recorded, repeated, "", ()), None)


def _differences(old: Any, new: Any, path: str, of: tuple[str, ...]) -> Iterator[Difference]:
    if dataclasses.is_dataclass(old):
        for name in (field.name for field in dataclasses.fields(old) if field.name[0] != "_"):
            inner = f"{path}.{name}" if path else name
            parts = getattr(old, name), getattr(new, name)
            if isinstance(parts[0], np.ndarray):
                yield from _in_array(inner, old, *parts, of)
            else:
                yield from _differences(*parts, inner, of)
    elif isinstance(old, Mapping) and isinstance(new, Mapping):
        for name in {**old, **new}:
            inner = f"{path}.{name}" if path else str(name)
            yield from _differences(old.get(name), new.get(name), inner, of)
    elif _is_list(old) and _is_list(new):
        for i, parts in enumerate(zip(old, new, strict=False)):
            yield from _differences(*parts, f"{path}[{i}]", (*of, *_name_of(parts[0])))
        if len(old) != len(new):
            yield Difference(path, f"{len(old)} elements", f"{len(new)} elements", of)
    elif _bits(old) != _bits(new):
        yield Difference(path, *_texts(old, new), of)


def _is_list(value: object) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _bits(value: object) -> object:
    return struct.pack("<d", value) if isinstance(value, float) else value


def _name_of(part: object) -> Iterator[str]:
    """Yield the name of a list element, if it has one."""
    for field in _NAMES:
        name = part.get(field) if isinstance(part, Mapping) else getattr(part, field, None)
        if isinstance(name, str):
            yield name
            return


def _in_array(
    path: str, of_message: Any, old: NDArray[Any], new: NDArray[Any], of: tuple[str, ...]
) -> Iterator[Difference]:
    """Yield the first number in which two arrays of a message differ."""
    if old.dtype == np.uint8:
        before, after = old.tobytes(), new.tobytes()
        if before != after:
            found = _in_unit(path, of_message, before, after) or _in_bytes(path, before, after)
            yield found._replace(of=of)
        return
    if len(old) != len(new):
        yield Difference(path, f"{len(old)} numbers", f"{len(new)} numbers", of)
        return
    differing = np.flatnonzero(old.view(f"u{old.itemsize}") != new.view(f"u{new.itemsize}"))
    if len(differing):
        first = int(differing[0])
        names = getattr(of_message, "name", None)
        name = (names[first],) if isinstance(names, list) and len(names) == len(old) else ()
        more = f"{len(differing)} of {len(old)} numbers differ"
        yield Difference(f"{path}[{first}]", *_texts(old[first], new[first]), (*of, *name), more)


class _Unit(NamedTuple):
    """The number of a point or pixel that a byte belongs to."""

    words: str
    dtype: str
    begin: int
    """Of the number, in bytes."""

    size: int
    """Of a point or a pixel, in bytes."""

    many: str


def _in_unit(path: str, message: Any, old: bytes, new: bytes) -> Difference | None:
    """Return the difference as a number of a point or pixel; None for other bytes."""
    find = _UNITS.get(message.__msgtype__)
    unit = find(message, _first_byte(old, new)) if find and len(old) == len(new) else None
    if unit is None:
        return None
    values = (np.frombuffer(b, unit.dtype, 1, unit.begin)[0] for b in (old, new))
    count = len(old) // unit.size
    rows = (np.frombuffer(b, f"V{unit.size}", count) for b in (old, new))
    differ = int(np.count_nonzero(next(rows) != next(rows)))
    more = f"{differ} of {count} {unit.many} differ"
    return Difference(f"{path}: {unit.words}", *_texts(*values), more=more)


def _point(cloud: Any, byte: int) -> _Unit | None:
    point, within = divmod(byte, cloud.point_step)
    for field in cloud.fields:
        dtype = np.dtype(_POINT_TYPES[field.datatype])
        if 0 <= within - field.offset < dtype.itemsize * field.count:
            element = (within - field.offset) // dtype.itemsize
            begin = point * cloud.point_step + field.offset + element * dtype.itemsize
            words = f"point {point}, field {field.name}"
            words += f"[{element}]" if field.count > 1 else ""
            return _Unit(words, dtype.str, begin, cloud.point_step, "points")
    return None


def _pixel(image: Any, byte: int) -> _Unit | None:
    encoding = ENCODINGS.get(image.encoding)
    if encoding is None:
        return None
    number, channels = np.dtype(f"<{encoding.number}"), len(encoding.channels)
    row, within = divmod(byte, image.step)
    column, within = divmod(within, number.itemsize * channels)
    words = f"pixel in row {row}, column {column}"
    words += f", {encoding.channels[within // number.itemsize].lower()}" if channels > 1 else ""
    begin = byte - byte % number.itemsize
    return _Unit(words, number.str, begin, number.itemsize * channels, "pixels")


_UNITS = {"sensor_msgs/msg/PointCloud2": _point, "sensor_msgs/msg/Image": _pixel}


def _in_bytes(path: str, old: bytes, new: bytes) -> Difference:
    """Return the first differing byte of unequal bytes."""
    first = _first_byte(old, new)
    if len(old) == len(new):
        return Difference(f"{path}: byte {first} of {len(old)}", str(old[first]), str(new[first]))
    same = f"equal up to byte {first}"
    return Difference(path, f"{len(old)} bytes", f"{len(new)} bytes", more=same)


def _first_byte(old: bytes, new: bytes) -> int:
    """Return the offset of the first differing byte, or the end of the shorter bytes."""
    size = min(len(old), len(new))
    differ = np.frombuffer(old, np.uint8, size) != np.frombuffer(new, np.uint8, size)
    return int(differ.argmax()) if differ.any() else size


def _texts(old: object, new: object) -> tuple[str, str]:
    """Return two different values as distinguishable texts."""
    short = _short(old), _short(new)
    return short if short[0] != short[1] else (repr(old), repr(new))


def _short(value: object) -> str:
    if isinstance(value, float | np.floating):
        # The shortest digits of a float32, which Python holds as a float64.
        number = float(value)
        narrow = np.float32(number) if abs(number) < 3e38 else np.float64(number)
        return str(narrow) if float(narrow) == number else str(number)
    return "nothing" if value is None else f"`{value}`" if isinstance(value, str) else str(value)
