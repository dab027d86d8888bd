# SPDX-License-Identifier: Apache-2.0
"""Mesh import: checks a mesh file, converts it to meters with z up, and stores its asset."""

from dataclasses import dataclass
from io import BytesIO
from math import ceil, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from groundlink.core.fields import Vector3
from groundlink.core.frames import Floats
from groundlink.world import assets
from groundlink.world.mesh_asset import MeshPart, encode_mesh
from groundlink.world.solids import Mesh

from . import scans
from .file_errors import BadFile, Warn
from .mesh_files import MeshPiece, Paint, read
from .mesh_specs import MeshFile

MAX_OFFSET_M = 100_000.0
"""Beyond, float32 is coarser than a centimeter."""

SCANS = (".ply", ".pcd")
"""Formats of scans without faces."""

LARGE_M, SMALL_M = 500.0, 0.005
"""Longest sides outside of which the unit is doubted."""

_Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class ImportedMesh:
    """A mesh ready to be stored as an asset."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    uv: NDArray[np.float32] | None
    parts: tuple[MeshPart, ...]
    points: int
    """Number of points converted to discs."""

    def shape(self) -> Mesh:
        """Store the asset and return the shape."""
        return Mesh(
            asset=assets.put(encode_mesh(self.vertices, self.faces, self.uv, self.parts)),
            low_m=_vector(self.vertices.min(axis=0)),
            high_m=_vector(self.vertices.max(axis=0)),
        )


def import_mesh(spec: MeshFile, folder: Path, warn: Warn) -> ImportedMesh:
    """Import a mesh file.

    Parameters
    ----------
    folder
        folder of the file and of the files it names.
    warn
        receives warnings.

    Raises
    ------
    BadFile
        when the file cannot be used.
    """
    file = folder / spec.file
    pieces = read(file, folder, warn)
    up = spec.up or ("y" if file.suffix.lower() in (".gltf", ".glb") else "z")
    turn = spec.scale * (_Z_UP_FROM_Y_UP if up == "y" else np.eye(3))
    for piece in pieces:
        _check_numbers(file, piece, warn)
        far_m = spec.scale * float(np.abs(piece.vertices).max(initial=0.0))
        if far_m > MAX_OFFSET_M:
            raise BadFile(
                f"{file}: vertices {far_m:.3g} m from its origin; subtract the offset of its "
                "coordinates, or correct `scale`"
            )
        if piece.faces.min(initial=0) < 0 or piece.faces.max(initial=-1) >= len(piece.vertices):
            raise BadFile(f"{file}: faces with vertices that there are not; export it again")
        piece.vertices = piece.vertices @ turn.T
    cloud = [piece for piece in pieces if not len(piece.faces)]
    pieces = [piece for piece in pieces if len(piece.faces)]
    points = 0
    if cloud and not pieces and file.suffix.lower() in SCANS:
        points = sum(len(piece.vertices) for piece in cloud)
        pieces = [_discs(cloud, spec)] if points else []
        kept = sum(len(piece.faces) for piece in pieces) // (scans.CORNERS - 2)
        if kept < points:
            warn(f"{file}: {points} points were thinned to {kept} discs")
    if not pieces:
        raise BadFile(f"{file}: no triangles; export it as triangles, or a scan as PLY or PCD")
    made = _joined(file, pieces, points, warn)
    _check_size(file, np.ptp(made.vertices, axis=0), spec, warn)
    return made


def _check_numbers(file: Path, piece: MeshPiece, warn: Warn) -> None:
    """Drop points without coordinates from a scan; refuse such vertices in a mesh."""
    broken = (~np.isfinite(piece.vertices)).any(axis=1)
    wrong, count = int(broken.sum()), len(piece.vertices)
    if not wrong:
        return
    if len(piece.faces) or wrong == count:
        raise BadFile(f"{file}: {wrong} of {count} vertices are not numbers; mend the mesh")
    warn(f"{file}: {wrong} of {count} points are not numbers and were left out")
    piece.vertices = piece.vertices[~broken]
    if piece.colors is not None:
        piece.colors = piece.colors[~broken]


def _discs(cloud: list[MeshPiece], spec: MeshFile) -> MeshPiece:
    """Return the points of a scan as discs."""
    gray = [np.full((len(piece.vertices), 3), 0.5) for piece in cloud]
    colors = [g if p.colors is None else p.colors for g, p in zip(gray, cloud, strict=True)]
    points, mean_colors, apart_m = scans.thinned(
        np.concatenate([piece.vertices for piece in cloud]),
        np.concatenate(colors),
        spec.most_points,
    )
    radius_m = spec.disc_m or scans.WIDER * apart_m
    vertices, faces = scans.discs(points, scans.normals(points, apart_m), radius_m)
    painted_at_all = any(piece.colors is not None for piece in cloud)
    by_vertex = mean_colors.repeat(scans.CORNERS, axis=0) if painted_at_all else None
    return MeshPiece(vertices=vertices, faces=faces, colors=by_vertex)


def _joined(file: Path, pieces: list[MeshPiece], points: int, warn: Warn) -> ImportedMesh:
    """Join pieces into one mesh, grouped by appearance."""
    pieces = [with_color_picture(piece) if piece.colors is not None else piece for piece in pieces]
    alike: dict[Paint, list[MeshPiece]] = {}
    for piece in pieces:
        alike.setdefault(piece.paint, []).append(piece)
    vertices, faces, uv = [], [], []
    parts: list[MeshPart] = []
    count = first = without_area = 0
    for (color, picture, normals), members in alike.items():
        begin = first
        for piece in members:
            corners = piece.vertices[piece.faces]
            across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            kept = piece.faces[across.any(axis=1)]
            vertices.append(piece.vertices)
            faces.append(kept + count)
            uv.append(np.zeros((len(piece.vertices), 2)) if piece.uv is None else piece.uv)
            count += len(piece.vertices)
            first += len(kept)
            without_area += len(piece.faces) - len(kept)
        if first > begin:
            size = first - begin
            parts.append(
                MeshPart(first=begin, count=size, color=color, picture=picture, normals=normals)
            )
    if not first:
        raise BadFile(f"{file}: no triangle has an area; export it again")
    if without_area:
        warn(f"{file}: {without_area} triangles without area were left out")
    has_pictures = any(part.picture or part.normals for part in parts)
    return ImportedMesh(
        vertices=np.concatenate(vertices).astype(np.float32),
        faces=np.concatenate(faces).astype(np.uint32),
        uv=np.concatenate(uv).astype(np.float32) if has_pictures else None,
        parts=tuple(parts),
        points=points,
    )


def _check_size(file: Path, size: Floats, spec: MeshFile, warn: Warn) -> None:
    """Warn about units that look wrong."""
    extent = " x ".join(f"{length:.4g}" for length in size)
    if size.max() > LARGE_M:
        warn(f"{file}: {extent} m is large. Fix: for millimeters, `scale: {spec.scale / 1000:g}`")
    if size.max() < SMALL_M:
        warn(f"{file}: {extent} m is small. Fix: correct `scale`, got {spec.scale:g}")


def _vector(point: NDArray[np.float32]) -> Vector3:
    x, y, z = point.tolist()
    return x, y, z


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
