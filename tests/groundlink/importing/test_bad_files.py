# SPDX-License-Identifier: Apache-2.0
"""Bad files: each is one line that names the file, in little time, and never anything else."""

import os
import pickle
import struct
import sys
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from groundlink.core.errors import UserError
from groundlink.importing import meshes, terrain
from groundlink.importing.file_errors import ignore_warning
from groundlink.importing.mesh_specs import MeshFile
from groundlink.importing.terrain_specs import HeightmapFile, SurfaceMap

from .files import (
    COLORS,
    HEIGHTMAPS,
    HEIGHTS,
    MESHES,
    esri,
    glb,
    gltf,
    npy,
    painted,
    pcd,
    png,
    sixteen_bits,
    tiff,
    write,
)


def use(file: Path) -> None:
    """Import a file as the world file of a user who knows what it should be would have it."""
    if file.suffix in (".png", ".tif", ".npy", ".asc"):
        heights_m = (0.0, 100.0) if file.suffix == ".png" else None
        spec = HeightmapFile(file=file.name, material="m", cell_m=1.0, heights_m=heights_m)
        terrain.build(spec, file.parent, ignore_warning)
    else:
        meshes.import_mesh(MeshFile(file=file.name), file.parent, ignore_warning).shape()


def line(file: Path) -> str:
    """Return what is said about a file that cannot be used."""
    began = time.process_time()
    with pytest.raises(UserError) as caught:
        use(file)
    assert time.process_time() - began < 5
    said = str(caught.value)
    assert "\n" not in said
    assert said.startswith(str(file))
    assert len(said) < len(str(file)) + 250
    return said.removeprefix(str(file))


class Bomb:
    def __reduce__(self) -> tuple[Callable[[str], int], tuple[str]]:
        return exec, ("raise SystemExit('unpickled')",)


def header(text: str) -> bytes:
    """Return a .npy file of a header alone."""
    body = text.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(body)) + body


def ihdr(columns: int, rows: int) -> bytes:
    """Return a PNG that declares another size than it has."""
    content = png(sixteen_bits())
    chunk = b"IHDR" + struct.pack(">II", columns, rows) + content[24:29]
    return (
        content[:8]
        + struct.pack(">I", 13)
        + chunk
        + struct.pack(">I", zlib.crc32(chunk))
        + content[33:]
    )


def ply(vertices: int, faces: int, body: bytes) -> bytes:
    return (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode() + body


LITTLE = b"binary_little_endian"
POINTS = {"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}
VAST = {"componentType": 5126, "count": 10**9, "type": "VEC3"}
TRIANGLE = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
FACE = b"\x03" + struct.pack("<3i", 0, 1, 2)
NAN_HEIGHTS = np.where(HEIGHTS > 10, np.nan, HEIGHTS)
INF_HEIGHTS = np.where(HEIGHTS > 90, np.inf, HEIGHTS)

END = "<end>"
"""Stands behind a line, for tests of what it ends with."""

BAD: dict[str, tuple[str, bytes, str]] = {
    "cut png": ("a.png", png(sixteen_bits())[:-40], "not a whole PNG picture"),
    "no png": ("a.png", b"GIF89a" + bytes(100), "PNG picture"),
    "color png": ("a.png", png(COLORS), "a picture in color (mode RGB)"),
    "png of one row": ("a.png", png(sixteen_bits()[:1]), "9 x 1 heights"),
    "vast png": ("a.png", ihdr(60_000, 60_000), "more than 134 million"),
    "hollow png": ("a.png", ihdr(11_000, 11_000), "cannot hold"),
    "cut tiff": ("a.tif", tiff()[:60], "GeoTIFF"),
    "color tiff": ("a.tif", tiff(COLORS), "a picture in color"),
    "empty": ("a.tif", b"", "GeoTIFF"),
    "pickle": ("a.npy", pickle.dumps(Bomb()), "not a valid .npy file"),
    "objects": ("a.npy", npy(np.array([[Bomb()] * 2] * 2)), "not a valid .npy file"),
    "archive": ("a.npy", b"PK\x03\x04" + bytes(100), "not a valid .npy file"),
    "cut npy": ("a.npy", npy()[:-4], ".npy file"),
    "complex npy": ("a.npy", npy(HEIGHTS.astype(complex)), "complex128; expected numbers"),
    "flat npy": ("a.npy", npy(HEIGHTS.ravel()), "rows and columns, has 1 dimensions"),
    "vast npy": (
        "a.npy",
        header("{'descr': '<f4', 'fortran_order': False, 'shape': (100000, 100000), }"),
        ".npy file",
    ),
    "nan": ("a.npy", npy(NAN_HEIGHTS), "places have no height"),
    "infinite": ("a.npy", npy(INF_HEIGHTS), "heights that are infinite"),
    "no meters": ("a.npy", npy(HEIGHTS * 1e6), "which are no meters"),
    "overflowing": ("a.npy", npy(HEIGHTS.astype(float) * 1e200), "infinite"),
    "no esri header": ("a.asc", b"1 2 3\n4 5 6\n", "no ncols, nrows"),
    "half a header": ("a.asc", b"ncols 3\ncellsize 1\n1 2 3\n", "no nrows"),
    "wrong count": ("a.asc", esri().replace(b"nrows 6", b"nrows 5"), "54 heights, but the header"),
    "vast esri": ("a.asc", b"ncols 40000\nnrows 3000\n1 2 3", "cannot hold them"),
    "vaster esri": ("a.asc", b"ncols 1e9\nnrows 1e9\n1 2 3", "more than 134 million"),
    "fractional": ("a.asc", b"ncols 2.5\nnrows 2\n1 2 3 4 5\n", "2.5 x 2 heights"),
    "words": ("a.asc", b"ncols 2\nnrows 2\n1 2\n3 four\n", "ESRI ASCII grid"),
    "binary esri": ("a.asc", bytes(range(256)), "ESRI ASCII grid"),
    "cell of nothing": ("a.asc", b"ncols 2\nnrows 2\ncellsize 0\n1 2\n3 4\n", "cellsize of 0"),
    "no such format": ("a.blend", b"BLENDER", "expected .obj"),
    "empty glb": ("a.glb", b"", "not a valid GLB scene"),
    "corrupt glb": ("a.glb", glb()[:200], "not a valid GLB scene"),
    "gltf without its buffer": (
        "a.gltf",
        trimesh.creation.box().scene().export(file_type="gltf")["model.gltf"],
        "is missing; put it beside it",
    ),
    "gltf that is no JSON": ("a.gltf", b"{", "not a valid glTF scene"),
    "gltf of something else": ("a.gltf", b"[]", "not a valid glTF scene"),
    "packed gltf": (
        "a.gltf",
        gltf(extensionsRequired=["KHR_draco_mesh_compression"]),
        "packed by KHR_draco_mesh_compression; export it without",
    ),
    "vast gltf": ("a.gltf", gltf(accessors=[VAST, VAST]), "declares 1000000000 numbers"),
    "gltf with a list for a number": (
        "a.gltf",
        gltf(nodes=[{"mesh": 0, "children": ["x"]}]),
        f"glTF scene{END}",
    ),
    "gltf without accessors": ("a.gltf", gltf(accessors=[]), f"glTF scene{END}"),
    "gltf without a view": ("a.gltf", gltf(accessors=[{}]), f"glTF scene{END}"),
    "gltf with numbers outside": (
        "a.gltf",
        gltf(buffers=[{"byteLength": 39, "uri": "../../secret.bin"}]),
        ": its `../../secret.bin` lies outside its folder; put it beside it",
    ),
    "gltf with numbers at an absolute place": (
        "a.gltf",
        gltf(buffers=[{"byteLength": 39, "uri": "/etc/passwd"}]),
        ": its `/etc/passwd` lies outside its folder; put it beside it",
    ),
    "gltf with a name of two lines": (
        "a.gltf",
        gltf(buffers=[{"byteLength": 39, "uri": "a\nb" * 99}]),
        "is missing; put it beside it",
    ),
    "gltf of no size": ("a.gltf", gltf(nodes=[{"mesh": 0, "scale": [0, 0, 0]}]), "has an area"),
    "gltf of all sizes": (
        "a.gltf",
        gltf(nodes=[{"mesh": 0, "scale": [1e308, 1e308, 1e308]}]),
        "from its origin",
    ),
    "nan ply": ("a.ply", ply(3, 1, b"\xff" * 36 + FACE), "3 of 3 vertices are not numbers"),
    "ply of nothing": ("a.ply", ply(0, 0, b""), "no triangles; export it as"),
    "obj of points": ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no triangles; export it as"),
    "gltf of points": ("a.gltf", gltf(meshes=[POINTS]), "no triangles; export it as"),
    "cut ascii ply": (
        "a.ply",
        ply(8, 2, b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 2\n").replace(LITTLE, b"ascii"),
        "declares 10 vertices and faces, but has 5",
    ),
    "vast ply": ("a.ply", ply(2**40, 2**40, TRIANGLE), "PLY mesh"),
    "absent vertices": (
        "a.ply",
        ply(3, 1, TRIANGLE + FACE[:-4] + struct.pack("<i", 7)),
        "vertices that there are not",
    ),
    "absent painted vertices": (
        "a.ply",
        painted()[:-4] + struct.pack("<i", 42),
        "vertices that there are not",
    ),
    "no area": ("a.ply", ply(3, 1, bytes(36) + FACE), "no triangle has an area"),
    "far away": (
        "a.stl",
        trimesh.creation.box().apply_translation((5e6, 0, 0)).export(file_type="stl"),
        "subtract the offset",
    ),
    "empty stl": ("a.stl", bytes(84), "no triangles"),
    # trimesh 4 refuses it, trimesh 5 reads no triangles.
    "vast stl": ("a.stl", bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(50), ""),
    "empty obj": ("a.obj", b"# nothing\n", ""),
    "cut pcd": ("a.pcd", pcd()[:-5], "not a valid PCD point cloud"),
    "vast pcd": ("a.pcd", pcd().replace(b"POINTS 400", b"POINTS 4000000"), "more than the file"),
    "no pcd": ("a.pcd", b"hello", "not a valid PCD point cloud"),
    "pcd without x": ("a.pcd", pcd().replace(b"FIELDS x", b"FIELDS q"), f"PCD point cloud{END}"),
    "pcd without fields": ("a.pcd", pcd().replace(b"FIELDS", b"FILES"), f"PCD point cloud{END}"),
    "cut packed pcd": ("a.pcd", pcd("binary_compressed")[:-9], "truncated"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_one_line(tmp_path: Path, name: str) -> None:
    file, content, expected = BAD[name]
    content = content if isinstance(content, bytes) else content.encode()
    assert expected in line(write(tmp_path, file, content)) + END


@pytest.mark.parametrize("name", ["a.png", "a.asc", "a.npy", "a.glb", "a.pcd", "a.obj"])
def test_a_file_that_is_not_there_is_one_line(tmp_path: Path, name: str) -> None:
    assert line(tmp_path / name) == ": there is no such file"
    (tmp_path / name).mkdir()
    line(tmp_path / name)


@pytest.mark.parametrize("name", ["a.png", "a.obj"])
def test_a_pipe_is_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    assert line(tmp_path / name) == ": no file, but a folder, a pipe or a device"


@pytest.mark.parametrize(
    ("pixels", "problem"),
    [
        (np.full((5, 8), 2, np.uint8), "the number 2, but `materials` has 2"),
        (np.zeros((4, 8), np.uint8), "8 x 4 pixels; expected one for each cell, 8 x 5"),
        (sixteen_bits(), "mode I;16; expected 8-bit gray"),
    ],
)
def test_a_surface_map_that_does_not_fit(tmp_path: Path, pixels: np.ndarray, problem: str) -> None:
    write(tmp_path, "map.asc", esri())
    write(tmp_path, "s.png", png(pixels))
    surface = SurfaceMap(file="s.png", materials=("a", "b"))
    with pytest.raises(UserError, match=problem):
        terrain.build(HeightmapFile(file="map.asc", material="a", surface=surface), tmp_path, print)


@pytest.mark.parametrize(("name", "library"), [("a.png", "PIL"), ("a.obj", "trimesh")])
def test_a_library_that_is_not_installed_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, library: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    file = write(tmp_path, name, b"")
    assert f"needs `{library}`. Fix: pip install 'groundlink[physics]'" in line(file)


VALID = HEIGHTMAPS | MESHES


@settings(
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
@pytest.mark.parametrize("name", VALID)
def test_a_broken_file_is_read_or_is_one_line(
    tmp_path: Path, name: str, data: st.DataObject
) -> None:
    whole = VALID[name]
    content = bytearray(whole if isinstance(whole, bytes) else whole.encode())
    for _ in range(data.draw(st.integers(0, 3))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at : at + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=4))
    end = data.draw(st.integers(0, len(content)) | st.just(len(content)))
    file = write(tmp_path, name, bytes(content[:end]))
    said = f"{file}"
    try:
        use(file)
    except UserError as error:
        said = str(error)
    assert said.startswith(str(file))
    assert "\n" not in said


def test_a_small_picture_that_declares_a_gigabyte_is_one_line(tmp_path: Path) -> None:
    Image.new("1", (8300, 8300)).save(tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size < 20_000
    write(tmp_path, "a.mtl", b"newmtl m\nmap_Kd a.png\n")
    corners = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    file = write(tmp_path, "a.obj", b"mtllib a.mtl\n" + corners + b"usemtl m\nf 1/1 2/2 3/3\n")
    assert "has 8300 x 8300 pixels; expected at most 67 million" in line(file)
