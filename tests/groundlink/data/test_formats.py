# SPDX-License-Identifier: Apache-2.0
"""Files of other tools, read back by programs that know nothing of the writers."""

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from pyarrow import parquet
from scipy.spatial.transform import Rotation

from groundlink.data.formats import (
    ParquetFile,
    append_csv,
    write_kitti_poses,
    write_pcd,
    write_png,
    write_times,
    write_velodyne,
)
from groundlink.data.trajectory import Trajectory

RECORD = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring", "normal"],
        "formats": ["<f4", "<f4", ">f4", "<f4", "<u2", ("<f8", 3)],
        "offsets": [0, 4, 8, 16, 20, 24],
        "itemsize": 64,
    }
)
"""A point with gaps, a field of three numbers, and one of another byte order."""


def cloud() -> NDArray[np.void]:
    points = np.zeros(5, RECORD)
    for place, name in enumerate(("x", "y", "z", "intensity")):
        points[name] = np.arange(5) * 1.5 + place
    points["ring"] = [0, 1, 2, 40_000, 65_535]
    points["normal"] = np.arange(15).reshape(5, 3) / 7
    return points


def read_pcd(file: Path) -> tuple[dict[str, list[str]], dict[str, NDArray[np.generic]]]:
    """Read a binary PCD file by its specification alone."""
    head, _, body = file.read_bytes().partition(b"DATA binary\n")
    lines = [line.split() for line in head.decode("ascii").splitlines() if line[0] != "#"]
    header = {key: words for key, *words in lines}
    columns = zip(*(header[key] for key in ("FIELDS", "TYPE", "SIZE", "COUNT")), strict=True)
    record = np.dtype(
        [(name, f"<{kind.lower()}{size}", (int(count),)) for name, kind, size, count in columns]
    )
    points = np.frombuffer(body, record)
    return header, {name: points[name] for name in header["FIELDS"]}


def test_a_velodyne_scan_is_four_floats_a_point(tmp_path: Path) -> None:
    points = cloud()
    points["y"][1] = np.nan
    write_velodyne(tmp_path / "a.bin", points)
    scan = np.fromfile(tmp_path / "a.bin", "<f4").reshape(-1, 4)
    kept = [0, 2, 3, 4]
    for column, name in enumerate(("x", "y", "z", "intensity")):
        assert scan[:, column].tolist() == points[name][kept].tolist()
    write_velodyne(tmp_path / "b.bin", points[["x", "y", "z"]])
    assert np.fromfile(tmp_path / "b.bin", "<f4")[3::4].tolist() == [0, 0, 0, 0]


def test_a_pcd_file_has_every_field_of_the_cloud(tmp_path: Path) -> None:
    write_pcd(tmp_path / "a.pcd", cloud())
    header, fields = read_pcd(tmp_path / "a.pcd")
    assert header["VERSION"] == ["0.7"]
    assert header["TYPE"] == ["F", "F", "F", "F", "U", "F"]
    assert header["SIZE"] == ["4", "4", "4", "4", "2", "8"]
    assert header["COUNT"] == ["1", "1", "1", "1", "1", "3"]
    assert header["WIDTH"] == header["POINTS"] == ["5"]
    assert header["HEIGHT"] == ["1"]
    for name in RECORD.names or ():
        assert fields[name].tolist() == cloud()[name].reshape(5, -1).tolist()


GRAY = np.arange(12, dtype=np.uint8).reshape(3, 4)


@pytest.mark.parametrize(
    ("pixels", "mode"),
    [
        (GRAY, "L"),
        (np.stack([GRAY, GRAY + 50, GRAY + 100], axis=-1), "RGB"),
        (np.stack([GRAY, GRAY + 50, GRAY + 100, GRAY + 150], axis=-1), "RGBA"),
        (GRAY.astype("<u2") * 5000, "I;16"),
        (GRAY.astype(">u2") * 5000, "I;16"),
    ],
    ids=["gray", "rgb", "rgba", "16 bits", "big endian"],
)
def test_a_png_file_has_the_pixels(
    tmp_path: Path, pixels: NDArray[np.unsignedinteger], mode: str
) -> None:
    write_png(tmp_path / "a.png", pixels)
    with Image.open(tmp_path / "a.png") as image:
        assert (image.format, image.mode) == ("PNG", mode)
        assert np.asarray(image).tolist() == pixels.tolist()


def test_depth_is_in_millimeters_and_0_where_there_is_none(tmp_path: Path) -> None:
    depth = np.array([[1.0, 0.0006, 65.535], [np.nan, np.inf, 65.6], [-1.0, 0.0, 2.5]], np.float32)
    write_png(tmp_path / "a.png", depth)
    with Image.open(tmp_path / "a.png") as image:
        assert np.asarray(image).tolist() == [[1000, 1, 65535], [0, 0, 0], [0, 0, 2500]]


def test_kitti_poses_are_relative_to_the_first(tmp_path: Path) -> None:
    turns = Rotation.from_euler("xyz", [[10, 20, 30], [-40, 5, 170], [0, 80, 0]], degrees=True)
    positions = np.array([[5.0, 6.0, 7.0], [8.0, -9.0, 1.0], [0.0, 0.0, 0.0]])
    write_kitti_poses(tmp_path / "poses.txt", Trajectory(np.arange(3), positions, turns.as_quat()))
    found = np.loadtxt(tmp_path / "poses.txt").reshape(3, 3, 4)
    assert found[0].tolist() == np.eye(4)[:3].tolist()
    back = turns[0].inv()
    np.testing.assert_allclose(found[:, :, :3], (back * turns).as_matrix(), atol=1e-9)
    np.testing.assert_allclose(found[:, :, 3], back.apply(positions - positions[0]), atol=1e-9)


def test_times_keep_every_nanosecond(tmp_path: Path) -> None:
    write_times(tmp_path / "times.txt", [7, 1_700_000_000_123_456_789])
    lines = (tmp_path / "times.txt").read_text(encoding="ascii").splitlines()
    assert lines == ["0.000000007", "1700000000.123456789"]


COLUMNS = {
    "stamp": np.array([1_700_000_000_123_456_789, 2]),
    "a.x": np.array([0.1 + 0.2, -np.inf]),
    "b": np.array([0.1, np.nan], np.float32),
    "on": np.array([True, False]),
}


def test_csv_and_parquet_files_have_every_digit(tmp_path: Path) -> None:
    table = ParquetFile(tmp_path / "a.parquet")
    for _ in range(2):
        append_csv(tmp_path / "a.csv", COLUMNS)
        table.append(COLUMNS)
    table.close()
    with (tmp_path / "a.csv").open(newline="", encoding="utf-8") as stream:
        names, *rows = csv.reader(stream)
    assert names == [*COLUMNS]
    assert rows[:2] == rows[2:]
    read = parquet.read_table(tmp_path / "a.parquet")
    assert read.column_names == names
    for place, (name, values) in enumerate(COLUMNS.items()):
        column = read[name].to_numpy()
        assert column.dtype == values.dtype
        np.testing.assert_array_equal(column, np.tile(values, 2))
        if name == "on":
            assert [row[place] for row in rows[:2]] == ["True", "False"]
        else:
            parsed = np.array([row[place] for row in rows[:2]]).astype(values.dtype)
            np.testing.assert_array_equal(parsed, values)
    assert rows[0][2] == "0.1"
