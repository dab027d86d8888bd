# SPDX-License-Identifier: Apache-2.0
"""Files of other tools, written from arrays: KITTI, PCD, PNG, CSV and Parquet. One function each.

`trajectory.write_tum` writes TUM files.

Formats: KITTI odometry benchmark, development kit (poses, times, Velodyne scans); Point Cloud
Library, "The PCD (Point Cloud Data) file format", version 0.7; REP 118 for depth images.
"""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import NANOS
from groundlink.core.frames import transform

from .trajectory import Trajectory


class ExportFormat(NamedTuple):
    """A format of `groundlink export`."""

    what: str
    module: str = ""
    """Optional Python module that writes it."""


FORMATS = {
    "tum": ExportFormat("poses as TUM trajectories"),
    "kitti": ExportFormat("poses and point clouds as in the KITTI odometry benchmark"),
    "kitti-objects": ExportFormat(
        "pictures, clouds and boxes of labeled cameras as in the KITTI object benchmark", "PIL"
    ),
    "pcd": ExportFormat("point clouds as binary PCD files with all fields"),
    "png": ExportFormat("images; depth with 16 bits, in millimeters", "PIL"),
    "csv": ExportFormat("a row for each message, a column for each number"),
    "parquet": ExportFormat("the same rows and columns as Parquet files", "pyarrow"),
}

_PCD_TYPES = {"f": "F", "i": "I", "u": "U"}
"""TYPE of a PCD file by the kind of numpy's type."""

_MILLIMETERS_PER_METER = 1000.0


def write_times(file: Path, stamps_nanos: Iterable[int]) -> None:
    """Write the time of each file or pose: a line of seconds with nine decimals."""
    lines = (f"{nanos // NANOS}.{nanos % NANOS:09d}\n" for nanos in stamps_nanos)
    file.write_text("".join(lines), encoding="ascii")


def write_kitti_poses(file: Path, trajectory: Trajectory) -> None:
    """Write first_from_frame of each pose: the 12 numbers of a 3x4 matrix, row by row."""
    world_from_frame = transform(trajectory.positions_m, trajectory.orientations)
    first_from_frame = np.linalg.inv(world_from_frame[0]) @ world_from_frame
    # Zero instead of the last bits of products, which differ between processors.
    rows = np.round(first_from_frame[:, :3].reshape(-1, 12), 9) + 0.0
    np.savetxt(file, rows, fmt="%.12g")


def write_velodyne(file: Path, points: NDArray[np.void]) -> None:
    """Write a KITTI scan: x, y, z and intensity of each point as float32.

    Intensities are those of the cloud, 0 if it has none. Points without a position are left out.
    """
    scan = np.zeros((len(points), 4), "<f4")
    for column, name in enumerate(("x", "y", "z", "intensity")):
        if name in (points.dtype.names or ()):
            scan[:, column] = points[name]
    file.write_bytes(scan[np.isfinite(scan[:, :3]).all(axis=1)].tobytes())


def write_pcd(file: Path, points: NDArray[np.void]) -> None:
    """Write a cloud with all its fields as a binary PCD file, version 0.7."""
    fields = [
        (name, points.dtype[name].base.newbyteorder("<"), points.dtype[name].shape)
        for name in points.dtype.names or ()
    ]
    header: dict[str, Sequence[object]] = {
        "VERSION": ["0.7"],
        "FIELDS": [name for name, _, _ in fields],
        "SIZE": [number.itemsize for _, number, _ in fields],
        "TYPE": [_PCD_TYPES[number.kind] for _, number, _ in fields],
        "COUNT": [int(np.prod(shape)) for _, _, shape in fields],
        "WIDTH": [len(points)],
        "HEIGHT": [1],
        "VIEWPOINT": [0, 0, 0, 1, 0, 0, 0],
        "POINTS": [len(points)],
        "DATA": ["binary"],
    }
    lines = [f"{key} {' '.join(map(str, values))}\n" for key, values in header.items()]
    text = "# .PCD v0.7 - Point Cloud Data file format\n" + "".join(lines)
    # The fields of a message may have gaps between them; those of a file have none.
    file.write_bytes(text.encode("ascii") + points.astype(np.dtype(fields)).tobytes())


def write_png(file: Path, pixels: NDArray[Any]) -> None:
    """Write an image: gray, RGB or RGBA with 8 bits, or gray with 16 bits.

    Floating-point numbers are depths in meters: the file has millimeters, 0 where there is no depth
    or where it does not fit into 16 bits.
    """
    from PIL import Image

    if pixels.dtype.kind == "f":
        millimeters = np.rint(pixels * _MILLIMETERS_PER_METER)
        fits = (millimeters >= 0) & (millimeters <= np.iinfo(np.uint16).max)
        pixels = np.where(fits, millimeters, 0).astype(np.uint16)
    Image.fromarray(np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("="))).save(file, "PNG")


def append_csv(file: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Append rows; the names of the columns are the first line of a new file."""
    with file.open("a", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        if stream.tell() == 0:
            writer.writerow(columns)
        # The text of a numpy number is the shortest that reads back as the same number.
        writer.writerows(zip(*columns.values(), strict=True))


class ParquetFile:
    """A Parquet file to which rows are appended; complete after `close`."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._writer: Any = None

    def append(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """Append rows."""
        import pyarrow
        from pyarrow import parquet

        rows = pyarrow.table(dict(columns))
        if self._writer is None:
            self._writer = parquet.ParquetWriter(self._file, rows.schema)
        self._writer.write_table(rows)

    def close(self) -> None:
        """Write the end of the file."""
        if self._writer is not None:
            self._writer.close()
