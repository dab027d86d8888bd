# SPDX-License-Identifier: Apache-2.0
"""Small valid files of every format, for tests that read them and tests that break them."""

import base64
import json
import struct
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image, TiffImagePlugin

HEIGHTS = np.random.default_rng(3).uniform(0, 100, (6, 9)).astype(np.float32)
"""Row 0 is in the south."""

COLORS = np.random.default_rng(4).integers(0, 256, (8, 8, 3), np.uint8)


def png(array: np.ndarray) -> bytes:
    """Return a picture whose first row, as in all pictures, is in the north."""
    file = BytesIO()
    Image.fromarray(np.ascontiguousarray(array[::-1])).save(file, "PNG")
    return file.getvalue()


def sixteen_bits() -> np.ndarray:
    return np.rint(HEIGHTS / 100 * 65535).astype(np.uint16)


def tiff(
    array: np.ndarray = HEIGHTS, *, degrees: bool = False, along_m: float = 2.5, **saved: Any
) -> bytes:
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[33550] = (2.5, along_m, 0.0)
    tags.tagtype[33550] = 12
    tags[34735] = (1, 1, 0, 1, 1024, 0, 1, 2 if degrees else 1)
    tags.tagtype[34735] = 3
    tags[42113] = "-9999"
    file = BytesIO()
    Image.fromarray(np.ascontiguousarray(array[::-1])).save(file, "TIFF", tiffinfo=tags, **saved)
    return file.getvalue()


def npy(array: np.ndarray = HEIGHTS) -> bytes:
    file = BytesIO()
    np.save(file, array)
    return file.getvalue()


def esri(array: np.ndarray = HEIGHTS) -> bytes:
    rows, columns = array.shape
    header = f"ncols {columns}\nnrows {rows}\nxllcorner 0\nyllcorner 0\ncellsize 2.5\n"
    lines = [" ".join(f"{value:.6g}" for value in row) for row in array[::-1]]
    return (header + "NODATA_value -9999\n" + "\n".join(lines) + "\n").encode()


def textured_box() -> trimesh.Trimesh:
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    picture = Image.open(BytesIO(png(COLORS)))
    box.visual = trimesh.visual.TextureVisuals(
        uv=np.random.default_rng(5).random((8, 2)),
        material=trimesh.visual.material.PBRMaterial(
            baseColorTexture=picture, normalTexture=picture, baseColorFactor=[255, 128, 0, 255]
        ),
    )
    return box


def glb() -> bytes:
    """A textured box of 1 x 2 x 3 m, y up, and beside it, at x = 5, one without paint."""
    scene = trimesh.Scene()
    scene.add_geometry(textured_box())
    aside = trimesh.transformations.translation_matrix((5.0, 0.0, 0.0))
    scene.add_geometry(trimesh.creation.box((1.0, 2.0, 3.0)), transform=aside)
    content: bytes = scene.export(file_type="glb")
    return content


def gltf(**changes: Any) -> bytes:
    """A triangle in a text file that holds its numbers too."""
    numbers = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes() + b"\0\1\2"
    data = "data:application/octet-stream;base64," + base64.b64encode(numbers).decode()
    scene = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5121, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 3},
        ],
        "buffers": [{"byteLength": len(numbers), "uri": data}],
    }
    return json.dumps(scene | changes).encode()


def mesh(file_type: str) -> bytes:
    """A box of 1 x 2 x 3 m."""
    content = trimesh.creation.box((1.0, 2.0, 3.0)).export(file_type=file_type)
    return content if isinstance(content, bytes) else content.encode()


def cloud(count: int = 400) -> np.ndarray:
    """Points on a plane of 4 x 4 m that leans by 45 degrees about x."""
    u, v = np.random.default_rng(6).uniform(-2, 2, (2, count))
    return np.stack([u, v * np.sqrt(0.5), v * np.sqrt(0.5)], axis=-1).astype(np.float32)


def pcd(form: str = "binary") -> bytes:
    points = cloud()
    rgb = np.full(len(points), 0x00FF8000, np.uint32)
    header = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb _\nSIZE 4 4 4 4 1\nTYPE F F F U U\n"
        f"COUNT 1 1 1 1 4\nWIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {len(points)}\nDATA {form}\n"
    ).encode()
    if form == "ascii":
        rows = [
            f"{x} {y} {z} {color} 0 0 0 0" for (x, y, z), color in zip(points, rgb, strict=True)
        ]
        return header + "\n".join(rows).encode() + b"\n"
    if form == "binary":
        layout = np.dtype([("xyz", "<f4", 3), ("rgb", "<u4"), ("pad", "u1", 4)])
        table = np.zeros(len(points), layout)
        table["xyz"], table["rgb"] = points, rgb
        return header + table.tobytes()
    columns = b"".join([*(axis.tobytes() for axis in points.T), rgb.tobytes(), bytes(4 * len(rgb))])
    packed = lzf(columns)
    return header + struct.pack("<II", len(packed), len(columns)) + packed


def lzf(data: bytes) -> bytes:
    """Compress: runs of a repeated byte become references, all else goes as it is."""
    out, at = bytearray(), 0
    while at < len(data):
        run = 1
        while run < 264 and data[at : at + 1] * (run + 1) == data[at : at + run + 1]:
            run += 1
        if run >= 4:
            length = run - 1 - 2
            out += bytes((0, data[at]))
            out += bytes((length << 5, 0)) if length < 7 else bytes((7 << 5, length - 7, 0))
            at += run
        else:
            out += bytes((0, data[at]))
            at += 1
    return bytes(out)


HEIGHTMAPS: dict[str, bytes] = {
    "map.png": png(sixteen_bits()),
    "map.tif": tiff(),
    "map.npy": npy(),
    "map.asc": esri(),
}


def painted() -> bytes:
    """A ball whose vertices have colors."""
    ball = trimesh.creation.icosphere(1)
    ball.visual.vertex_colors = np.random.default_rng(8).integers(0, 256, (42, 4), np.uint8)
    content: bytes = ball.export(file_type="ply")
    return content


MESHES: dict[str, bytes] = {
    "painted.ply": painted(),
    "box.glb": glb(),
    "triangle.gltf": gltf(),
    "box.obj": mesh("obj"),
    "box.ply": mesh("ply"),
    "box.stl": mesh("stl"),
    "ascii.ply": trimesh.creation.box().export(file_type="ply", encoding="ascii"),
    "ascii.stl": mesh("stl_ascii"),
    "cloud.ply": trimesh.PointCloud(cloud()).export(file_type="ply"),
    "cloud.pcd": pcd("binary"),
    "ascii.pcd": pcd("ascii"),
    "packed.pcd": pcd("binary_compressed"),
}


def write(folder: Path, name: str, content: bytes) -> Path:
    file = folder / name
    file.write_bytes(content)
    return file
