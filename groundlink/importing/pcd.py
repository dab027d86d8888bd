# SPDX-License-Identifier: Apache-2.0
"""Point clouds in PCD files: ascii, binary and binary_compressed (LZF).

Positions and colors are read, other fields ignored. Format: Point Cloud Library, "The PCD (Point
Cloud Data) file format", version 0.7.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats

MAX_HEADER_LINES = 30

MAX_COMPRESSION = 100
"""Maximum compression of LZF is 88: 264 bytes from 3."""

_KINDS = {"F": "f", "I": "i", "U": "u"}


def read(file: Path) -> tuple[Floats, Floats | None]:
    """Return points, shape (N, 3), and their sRGB colors, 0..1, or None where it has none.

    Raises
    ------
    ValueError
        when it is no such file.
    """
    content = file.read_bytes()
    header, start = _header(content)
    layout, count = _layout(header)
    if count * layout.itemsize > MAX_COMPRESSION * len(content):
        raise ValueError(f"the header declares {count} points, more than the file can hold")
    form = header["DATA"][0]
    if form == "ascii":
        fields = _from_text(content[start:], layout, count)
    elif form == "binary":
        points = np.frombuffer(content, layout, count, start)
        fields = {name: points[name] for name in layout.names or ()}
    elif form == "binary_compressed":
        fields = _from_columns(_decompressed(content[start:]), layout, count)
    else:
        raise ValueError(f"unknown DATA format `{form}`")
    positions = np.stack([fields[axis][:, 0] for axis in ("x", "y", "z")], axis=-1)
    return positions.astype(np.float64), _colors(fields)


def _header(content: bytes) -> tuple[dict[str, list[str]], int]:
    """Return the words after each key, and where the data begin."""
    header: dict[str, list[str]] = {}
    start = 0
    for _ in range(MAX_HEADER_LINES):
        end = content.index(b"\n", start)
        key, *words = content[start:end].decode("ascii").split() or ["#"]
        start = end + 1
        header[key] = words
        if key == "DATA":
            return header, start
    raise ValueError("no DATA line in the header")


def _layout(header: dict[str, list[str]]) -> tuple[np.dtype[np.void], int]:
    """Return the dtype of a point, each field an array, and the number of points."""
    names = header["FIELDS"]
    counts = header.get("COUNT", ["1"] * len(names))
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    for i, (name, size, kind, number) in enumerate(
        zip(names, header["SIZE"], header["TYPE"], counts, strict=True)
    ):
        # Fields called `_` are padding, and there may be several.
        unique = name if name not in names[:i] else f"{name}{i}"
        fields.append((unique, f"<{_KINDS[kind]}{int(size)}", (int(number),)))
    count = int(header["POINTS"][0])
    if count < 1:
        raise ValueError("it has no points")
    return np.dtype(fields), count


def _from_text(
    body: bytes, layout: np.dtype[np.void], count: int
) -> dict[str, NDArray[np.generic]]:
    rows = np.loadtxt(body.decode("ascii").splitlines(), ndmin=2)
    widths = [layout[name].shape[0] for name in layout.names or ()]
    if rows.shape != (count, sum(widths)):
        raise ValueError(f"the header declares {count} points of {sum(widths)} numbers")
    ends = np.cumsum(widths)
    return {
        name: rows[:, end - width : end].astype(layout[name].base)
        for name, width, end in zip(layout.names or (), widths, ends, strict=True)
    }


def _from_columns(
    body: bytes, layout: np.dtype[np.void], count: int
) -> dict[str, NDArray[np.generic]]:
    """Return the fields of data that hold all points of one field before those of the next."""
    fields, start = {}, 0
    for name in layout.names or ():
        of, width = layout[name].base, layout[name].shape[0]
        fields[name] = np.frombuffer(body, of, count * width, start).reshape(count, width)
        start += fields[name].nbytes
    return fields


def _decompressed(body: bytes) -> bytes:
    """Decompress LZF: a control byte below 32 starts a literal run, others a back reference."""
    size, expected = np.frombuffer(body, "<u4", 2).tolist()
    packed = body[8 : 8 + size]
    if expected > MAX_COMPRESSION * len(packed) or len(packed) < size:
        raise ValueError("compressed data are truncated")
    out = bytearray()
    at = 0
    while at < size:
        control = packed[at]
        at += 1
        if control < 32:
            out += packed[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += packed[at]
            at += 1
        back = ((control & 31) << 8) + packed[at] + 1
        at += 1
        start = len(out) - back
        if start < 0:
            raise ValueError("compressed data are damaged")
        for k in range(start, start + length + 2):  # The source may overlap the copy.
            out.append(out[k])
    if len(out) != expected:
        raise ValueError("compressed data are damaged")
    return bytes(out)


def _colors(fields: dict[str, NDArray[np.generic]]) -> Floats | None:
    """Return colors from a field `rgb` or `rgba`: 0xAARRGGBB, by custom in a float's bits."""
    packed = fields.get("rgb", fields.get("rgba"))
    if packed is None or packed.dtype.itemsize != 4:
        return None
    bits = np.ascontiguousarray(packed[:, 0]).view(np.uint32)
    return np.stack([(bits >> shift) & 255 for shift in (16, 8, 0)], axis=-1) / 255.0
