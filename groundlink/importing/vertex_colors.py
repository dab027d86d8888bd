# SPDX-License-Identifier: Apache-2.0
"""Vertex colors as a picture, so that renderers need to know pictures only.

Each face gets the mean color of its corners, with 32 levels a channel. The picture has a square of
2 x 2 pixels for each color. The corners of a face map to the middle of its square, so filtering
mixes no colors.
"""

from io import BytesIO
from math import ceil, sqrt

import numpy as np

from .mesh_files import MeshPiece

LEVELS = 32


def with_color_picture(piece: MeshPiece) -> MeshPiece:
    """Return a piece with vertex colors as one with a picture."""
    from PIL import Image

    assert piece.colors is not None
    means = np.clip(piece.colors[piece.faces].mean(axis=1), 0, 1)
    levels = np.rint(means * (LEVELS - 1)).astype(np.int64)
    known, place = np.unique(levels @ (LEVELS * LEVELS, LEVELS, 1), return_inverse=True)
    side = ceil(sqrt(len(known)))
    picture = np.zeros((side * side, 3), np.uint8)
    parts = np.stack([known // LEVELS**2, known // LEVELS % LEVELS, known % LEVELS], axis=-1)
    picture[: len(known)] = np.rint(parts * (255 / (LEVELS - 1)))
    pixels = picture.reshape(side, side, 3).repeat(2, axis=0).repeat(2, axis=1)
    file = BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    column, row = place % side, place // side
    at = np.stack([(column + 0.5) / side, 1 - (row + 0.5) / side], axis=-1)
    vertices = piece.vertices[piece.faces].reshape(-1, 3)
    return MeshPiece(
        vertices=vertices,
        faces=np.arange(len(vertices)).reshape(-1, 3),
        uv=at.repeat(3, axis=0),
        paint=((1.0, 1.0, 1.0), file.getvalue(), None),
    )
