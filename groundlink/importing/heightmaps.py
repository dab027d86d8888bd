# SPDX-License-Identifier: Apache-2.0
"""Heightmap files: PNG, GeoTIFF, ESRI ASCII grid and .npy.

The result has its rows from south to north, and NaN where the file has no height. The first row of
a picture, GeoTIFF or ESRI grid is the northern one; that of a .npy file is the southern one. A map
has between 2 x 2 and 134 million heights.
"""

import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import grayscale
from .file_errors import BadFile, Warn, reading

_MODEL_TYPE, _PIXEL_SCALE, _KEYS, _NO_DATA = 1024, 33550, 34735, 42113
"""A key and tags of GeoTIFF 1.1 (OGC 19-008r4), and GDAL's tag for places without data."""

_GEOGRAPHIC = 2


@dataclass(frozen=True, eq=False)
class Heightmap:
    """Contents of a heightmap file."""

    values: NDArray[Any]
    """Shape (rows, columns), numbers; floats may be NaN. Row 0 is in the south."""

    full_scale: int | None = None
    """Value of the upper end of the range, 255 or 65535; None: values are meters."""

    cell_m: float | None = None
    """None if the file does not state it."""


def read(file: Path, warn: Warn) -> Heightmap:
    """Return the heightmap in a file.

    Raises
    ------
    BadFile
        when there is none.
    """
    suffix = file.suffix.lower()
    if suffix not in FORMATS:
        raise BadFile(f"{file}: no heightmap that is known; expected {', '.join(FORMATS)}")
    name, read_format = FORMATS[suffix]
    with reading(file, name), np.errstate(all="ignore"):
        found = read_format(file, warn)
        _check_size(file, found.values.shape)
    return found


def _check_size(file: Path, shape: tuple[int, ...]) -> None:
    if len(shape) != 2:
        raise BadFile(f"{file}: expected heights in rows and columns, has {len(shape)} dimensions")
    rows, columns = shape
    if min(shape) < 2:
        raise BadFile(f"{file}: {columns} x {rows} heights; expected 2 x 2 or more")
    grayscale.check_count(file, rows, columns)


def _read_picture(file: Path, warn: Warn) -> Heightmap:
    """Return a PNG's or GeoTIFF's values."""
    gray = grayscale.read(file)
    if gray.mode == "P":
        raise BadFile(f"{file}: a picture of a palette of colors; expected one gray channel")
    if gray.is_png:
        return Heightmap(gray.values, full_scale=255 if gray.mode == "L" else 65535)
    values = _without(gray.values, gray.tags.get(_NO_DATA))
    return Heightmap(values, cell_m=_cell_m(file, gray.tags, warn))


def _without(values: NDArray[Any], no_data: Any) -> NDArray[Any]:
    """Return values with NaN for the no-data marker."""
    if no_data is None:
        return values
    marker = np.float32(str(no_data).strip("\0 "))
    floats = values.astype(np.float32)
    floats[floats == marker] = np.nan
    return floats


def _cell_m(file: Path, tags: dict[int, Any], warn: Warn) -> float | None:
    """Return the cell length of a GeoTIFF in meters, or None if not stated."""
    scale = tags.get(_PIXEL_SCALE)
    if scale is None:
        return None
    keys = np.array(tags.get(_KEYS, ())[4:], np.int64)
    keys = keys[: len(keys) // 4 * 4].reshape(-1, 4)
    if any(key == _MODEL_TYPE and value == _GEOGRAPHIC for key, _, _, value in keys):
        warn(f"{file}: cells in degrees, not meters; project it first, or give `cell_m`")
        return None
    across, along = float(scale[0]), float(scale[1])
    if not (across > 0 and abs(across - along) <= 1e-3 * across):
        warn(f"{file}: cells of {across:g} x {along:g} m; resample it to square ones")
        return None
    return across


def _read_npy(file: Path, warn: Warn) -> Heightmap:
    """Return a .npy file's array; one that would need unpickling is refused."""
    # `np.load` would also accept pickles and archives.
    values = np.lib.format.open_memmap(file, mode="r")
    if values.dtype.kind not in "iuf":
        raise BadFile(f"{file}: an array of {values.dtype}; expected numbers, best float32")
    return Heightmap(values)


_HEADER_LINE = re.compile(r"\s*([a-zA-Z_]+)\s+(\S+)\s*$")


def _read_esri(file: Path, warn: Warn) -> Heightmap:
    """Return an ESRI ASCII grid: lines of a key and a value, then rows from north to south."""
    header: dict[str, float] = {}
    with file.open(encoding="ascii", errors="strict") as lines:
        while match := _HEADER_LINE.match(first := lines.readline(1000)):
            header[match[1].lower()] = float(match[2])
        missing = {"ncols", "nrows"} - header.keys()
        if missing:
            raise BadFile(f"{file}: the header has no {', '.join(sorted(missing))}")
        rows, columns = header["nrows"], header["ncols"]
        if not (rows.is_integer() and columns.is_integer()):
            raise BadFile(f"{file}: the header has {columns:g} x {rows:g} heights")
        _check_size(file, (int(rows), int(columns)))
        if 2 * rows * columns > file.stat().st_size + 1:
            raise BadFile(
                f"{file}: the header declares {columns:.0f} x {rows:.0f} heights, the file of "
                f"{file.stat().st_size} bytes cannot hold them"
            )
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy only warns about text that is no number
            values = np.fromstring(first + lines.read(), np.float32, sep=" ")
    if values.size != rows * columns:
        raise BadFile(
            f"{file}: {values.size} heights, but the header declares {columns:.0f} x {rows:.0f}"
        )
    cell_m = header.get("cellsize")
    if cell_m is not None and not (0 < cell_m < np.inf):
        raise BadFile(f"{file}: the header has a cellsize of {cell_m:g}")
    grid = values.reshape(int(rows), int(columns))[::-1]
    return Heightmap(_without(grid, header.get("nodata_value")), cell_m=cell_m)


FORMATS = {
    ".png": ("PNG picture", _read_picture),
    ".tif": ("GeoTIFF", _read_picture),
    ".tiff": ("GeoTIFF", _read_picture),
    ".asc": ("ESRI ASCII grid", _read_esri),
    ".npy": (".npy file", _read_npy),
}
