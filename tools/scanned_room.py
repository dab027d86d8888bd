# SPDX-License-Identifier: Apache-2.0
"""Generate the scanned room: `python -m tools.scanned_room`.

A synthetic room that resembles a phone scan: walls and floor are uneven by millimeters, glass and
dark corners are holes, there is no ceiling, and one image textures all surfaces. Writes
`scenarios/worlds/scanned_room.glb` (CC0 1.0). The same versions of NumPy and Pillow write the same
bytes.
"""

import io
import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

FILE = Path(__file__).parents[1] / "scenarios" / "worlds" / "scanned_room.glb"

Floats = NDArray[np.float64]

LENGTH_M, WIDTH_M, HEIGHT_M = 8.0, 6.0, 2.5
CELL_M = 0.125
UNEVEN_M = 0.004
TEXELS = 512
"""Width and height of the texture."""

WINDOW_M = ((-1.5, 0.5), (0.9, 1.9))
"""Hole in the north wall: x range and height range."""

POSTER_M = ((1.5, 2.5), (0.9, 1.9))
"""Poster on the north wall with red and white squares of 0.25 m: x range and height range."""

SEED = 20

FLOOR, WALL, CRATE, POSTER = ((0.0, 0.5), (0.5, 0.5), (0.0, 0.0), (0.5, 0.0))
"""Left and upper edge of each surface's quarter of the texture, relative to its size."""


class Sheet(NamedTuple):
    """An uneven rectangle with holes."""

    corner_m: tuple[float, float, float]
    along: tuple[float, float, float]
    """Unit vector of the columns."""

    up: tuple[float, float, float]
    """Unit vector of the rows; the sheet faces `along` x `up`."""

    size_m: tuple[float, float]
    quarter: tuple[float, float]
    repeats_m: float
    """Length of the pattern on the quarter."""

    holes: Sequence[tuple[float, float, float, float]] = ()
    """Left, right, low and high of rectangles, in meters along the sheet."""

    ragged: float = 0.0
    """Share of the cells near holes that are missing too."""


def sheets() -> list[Sheet]:
    """Return the sheets of the room. The origin is in the middle of the floor."""
    x, y = LENGTH_M / 2, WIDTH_M / 2
    (west, east), (low, high) = WINDOW_M
    (left, right), (under, over) = POSTER_M
    east_x, north_y, up = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    west_x, south_y = (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)
    window = (west + x, east + x, low, high)
    poster = (left + x, right + x, under, over)
    made = [
        # Dark corners are holes in the floor.
        Sheet(
            *((-x, -y, 0.0), east_x, north_y, (LENGTH_M, WIDTH_M), FLOOR, 2.0),
            [(0.0, 0.75, 5.25, 6.0), (7.25, 8.0, 0.0, 0.75)],
            0.4,
        ),
        # Walls face inwards.
        Sheet(*((-x, y, 0.0), east_x, up, (LENGTH_M, HEIGHT_M), WALL, 2.0), [window, poster], 0.25),
        Sheet((left, y, under), east_x, up, (right - left, over - under), POSTER, 1.0),
        Sheet((x, -y, 0.0), west_x, up, (LENGTH_M, HEIGHT_M), WALL, 2.0),
        Sheet(*((x, y, 0.0), south_y, up, (WIDTH_M, HEIGHT_M), WALL, 2.0), [(2.5, 3.5, 0.0, 2.0)]),
        Sheet((-x, -y, 0.0), north_y, up, (WIDTH_M, HEIGHT_M), WALL, 2.0),
    ]
    for cx, cy, side, tall in ((-2.5, 2.25, 1.0, 0.75), (3.0, -2.0, 0.75, 1.25)):
        h = side / 2
        for a, b, along in (
            (-h, -h, east_x),
            (h, -h, north_y),
            (h, h, west_x),
            (-h, h, south_y),
        ):
            made.append(Sheet((cx + a, cy + b, 0.0), along, up, (side, tall), CRATE, 1.0))
        made.append(Sheet((cx - h, cy - h, tall), east_x, north_y, (side, side), CRATE, 1.0))
    return made


def mesh() -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint16]]:
    """Return vertices, shape (V, 3), z up; texture coordinates, (V, 2); and faces, (F, 3)."""
    generator = np.random.default_rng(SEED)
    vertices, places = [], []
    for sheet in sheets():
        columns, rows = (round(length / CELL_M) for length in sheet.size_m)
        row, column = np.indices((rows + 1, columns + 1))
        along, up = np.array(sheet.along), np.array(sheet.up)
        bumps = _smooth(generator, rows + 1, columns + 1) * UNEVEN_M
        bumps[[0, -1]] = bumps[:, [0, -1]] = 0.0  # adjacent sheets share their edges
        at = column[..., None] * CELL_M * along + row[..., None] * CELL_M * up
        at += np.array(sheet.corner_m) + bumps[..., None] * np.cross(along, up)
        cell = np.indices((rows, columns))
        middle_m = (cell[::-1] + 0.5) * CELL_M
        kept = np.ones((rows, columns), bool)
        ragged = generator.random((rows, columns)) < sheet.ragged
        for left, right, low, high in sheet.holes:
            beyond = np.maximum(
                np.maximum(left - middle_m[0], middle_m[0] - right),
                np.maximum(low - middle_m[1], middle_m[1] - high),
            )
            kept &= ~(beyond < 0) & ~((beyond < 1.5 * CELL_M) & ragged)
        # Cells do not share vertices because the pattern restarts where it repeats.
        r, c = (index[:, None] for index in np.nonzero(kept))
        across, above = np.array([0, 1, 1, 0]), np.array([0, 0, 1, 1])
        per = round(sheet.repeats_m / CELL_M)
        inset = 0.5 / TEXELS  # avoids bleeding from neighboring quarters
        u, v = (across + c % per) / per, 1 - (above + r % per) / per
        u, v = (inset + axis * (0.5 - 2 * inset) for axis in (u, v))
        vertices.append(at[r + above, c + across].reshape(-1, 3))
        places.append(np.stack([sheet.quarter[0] + u, sheet.quarter[1] + v], axis=-1))
    corners = np.concatenate(vertices).astype(np.float32)
    first = np.arange(0, len(corners), 4)[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3).astype(np.uint16)
    return corners, np.concatenate(places).reshape(-1, 2).astype(np.float32), faces


def picture() -> NDArray[np.uint8]:
    """Return the texture, shape (TEXELS, TEXELS, 3): sRGB."""
    generator = np.random.default_rng(SEED + 1)
    half = TEXELS // 2
    grain = np.repeat(np.repeat(generator.integers(-6, 7, (half // 4,) * 2), 4, 0), 4, 1)
    row, column = np.indices((half, half))
    looks = {
        FLOOR: np.where(((row % 64 < 2) | (column % 64 < 2))[..., None], 70, (150, 140, 125)),
        WALL: np.where((row > 0.6 * half)[..., None], (90, 125, 120), (205, 200, 185)),
        CRATE: np.where((row % 43 < 4)[..., None], (90, 60, 35), (165, 120, 75)),
        POSTER: np.where(
            ((row // (half // 4) + column // (half // 4)) % 2 == 0)[..., None],
            (200, 30, 30),
            (240, 240, 240),
        ),
    }
    made = np.zeros((TEXELS, TEXELS, 3), np.int64)
    for (left, top), look in looks.items():
        r, c = int(top * TEXELS), int(left * TEXELS)
        made[r : r + half, c : c + half] = look + grain[..., None]
    return np.clip(made, 0, 255).astype(np.uint8)


def glb() -> bytes:
    """Return the file: vertices, faces and texture of one mesh (glTF 2.0, y up)."""
    vertices, places, faces = mesh()
    turned = np.stack([vertices[:, 0], vertices[:, 2], -vertices[:, 1]], axis=1)
    parts = [turned.tobytes(), places.tobytes(), faces.tobytes(), png(picture())]
    padded = [part + bytes(-len(part) % 4) for part in parts]
    offsets = np.cumsum([0, *map(len, padded)]).tolist()
    views = [
        {"buffer": 0, "byteOffset": offset, "byteLength": len(part)}
        for offset, part in zip(offsets, parts, strict=False)
    ]
    low, high = turned.min(axis=0).tolist(), turned.max(axis=0).tolist()
    attributes = {"POSITION": 0, "TEXCOORD_0": 1}
    position = {"bufferView": 0, "componentType": 5126, "count": len(turned), "type": "VEC3"}
    content = {
        "asset": {"version": "2.0", "copyright": "CC0 1.0", "generator": "tools.scanned_room"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 2, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "accessors": [
            {**position, "min": low, "max": high},
            {"bufferView": 1, "componentType": 5126, "count": len(places), "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": offsets[-1]}],
    }
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary = b"".join(padded)
    head = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(binary))
    head += struct.pack("<I4s", len(text), b"JSON") + text
    return head + struct.pack("<I4s", len(binary), b"BIN\0") + binary


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Encode pixels, shape (H, W, 3), as PNG."""
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG", compress_level=9)
    return file.getvalue()


def _smooth(generator: np.random.Generator, rows: int, columns: int) -> Floats:
    """Return smoothed noise with an amplitude of about 1."""
    rough = generator.uniform(-1, 1, (rows + 2, columns + 2))
    around = [rough[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    return np.asarray(np.sum(around, axis=0) / 4)


if __name__ == "__main__":
    FILE.write_bytes(glb())
    print(FILE)
