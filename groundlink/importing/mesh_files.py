# SPDX-License-Identifier: Apache-2.0
"""Mesh and scan files: OBJ, PLY, STL, glTF and GLB with `trimesh`, PCD with `pcd`.

Pieces stay in the frame and units of the file. Pictures stay encoded. Files that a mesh names are
read only from its own folder and from the folder that the caller trusts, after following links, so
an untrusted mesh cannot read other files.
"""

import json
import logging
import warnings
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundlink.core.fields import Vector3
from groundlink.core.frames import Floats
from groundlink.world.colors import linear

from . import pcd
from .file_errors import BadFile, Warn, one_line, reading

FORMATS = {
    ".obj": "OBJ mesh",
    ".ply": "PLY mesh",
    ".stl": "STL mesh",
    ".gltf": "glTF scene",
    ".glb": "GLB scene",
    ".pcd": "PCD point cloud",
}

MAX_FACES = 20_000_000

MAX_PIXELS = 2**26
"""Maximum size of a picture. A file of 20 kB can declare more."""

Paint = tuple[Vector3 | None, bytes | None, bytes | None]
"""Color, picture and normals, as in `mesh_asset.MeshPart`."""

UNPAINTED: Paint = (None, None, None)


@dataclass(eq=False, kw_only=True)
class MeshPiece:
    """Triangles, or points without faces, with the same appearance."""

    vertices: Floats
    """Shape (V, 3)."""

    faces: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 3), np.int64))
    """Shape (F, 3)."""

    uv: Floats | None = None
    """Shape (V, 2)."""

    colors: Floats | None = None
    """sRGB vertex colors, 0..1, shape (V, 3)."""

    paint: Paint = UNPAINTED


def read(file: Path, folder: Path, warn: Warn) -> list[MeshPiece]:
    """Return the pieces of a file; files that it names lie in `folder` or beside it.

    Raises
    ------
    BadFile
        when the file cannot be read.
    """
    suffix = file.suffix.lower()
    if suffix not in FORMATS:
        raise BadFile(f"{file}: no mesh or scan that is known; expected {', '.join(FORMATS)}")
    with reading(file, FORMATS[suffix]), np.errstate(all="ignore"):
        if suffix == ".pcd":
            points, colors = pcd.read(file)
            return [MeshPiece(vertices=points, colors=colors)]
        return list(_pieces(file, suffix, folder, warn))


def _pieces(file: Path, suffix: str, folder: Path, warn: Warn) -> Iterator[MeshPiece]:
    import trimesh

    scene, lacking = _scene(file, suffix, folder)
    for problem in dict.fromkeys(lacking):
        warn(f"{file}: {problem}; its content is ignored")
    pictures = _Pictures(file, warn)
    faces_so_far = 0
    for name, scene_from_part in _placed(scene):
        part = scene.geometry[name]
        faces_so_far += len(getattr(part, "faces", ()))
        if faces_so_far > MAX_FACES:
            raise BadFile(
                f"{file}: more than {MAX_FACES // 10**6} million triangles; simplify the mesh"
            )
        vertices = np.asarray(part.vertices, np.float64)
        vertices = vertices @ scene_from_part[:3, :3].T + scene_from_part[:3, 3]
        if isinstance(part, trimesh.PointCloud):
            colors = np.asarray(part.colors)
            fits = colors.shape[:1] == vertices.shape[:1] and colors.shape[1] >= 3
            yield MeshPiece(vertices=vertices, colors=colors[:, :3] / 255.0 if fits else None)
        elif isinstance(part, trimesh.Trimesh):
            faces = np.asarray(part.faces, np.int64)
            if np.linalg.det(scene_from_part[:3, :3]) < 0:
                faces = faces[:, ::-1]  # A mirroring transform inverts the winding of faces.
            yield _painted_as(part.visual, MeshPiece(vertices=vertices, faces=faces), pictures)


def _placed(scene: Any) -> Iterator[tuple[str, Floats]]:
    """Yield the parts of a scene and their poses, shape (4, 4).

    Walks down from the root. trimesh walks up from each part, which takes a minute for a chain of a
    thousand parts.
    """
    forest = scene.graph.transforms
    waiting: list[tuple[str, Floats]] = [(scene.graph.base_frame, np.eye(4))]
    below = defaultdict(list)
    for (parent, child), edge in forest.edge_data.items():
        below[parent].append((child, edge.get("matrix", np.eye(4))))
    while waiting:
        node, scene_from_node = waiting.pop()
        if (name := forest.node_data[node].get("geometry")) in scene.geometry:
            yield name, scene_from_node
        waiting += [(child, scene_from_node @ at) for child, at in below.pop(node, [])]


def _scene(file: Path, suffix: str, folder: Path) -> tuple[Any, list[str]]:
    """Return a trimesh scene, and the problems of files that it names."""
    import trimesh

    lacking: list[str] = []
    allowed = [folder.resolve(), file.parent.resolve(), file.resolve().parent]

    class Beside(trimesh.resolvers.FilePathResolver):
        def get(self, name: str) -> bytes:
            problem = "is missing"
            with suppress(OSError, ValueError):  # Some names are invalid on this system.
                # An absolute name of another machine refers to a file beside the mesh.
                paths = [(file.parent / part).resolve() for part in (name.strip(), Path(name).name)]
                inside = [path for path in paths if any(map(path.is_relative_to, allowed))]
                for path in filter(Path.is_file, inside):
                    content = path.read_bytes()
                    return _utf8(content) if name.lower().endswith(".mtl") else content
                if paths[0] not in inside:
                    problem = "lies outside its folder"
            lacking.append(f"its `{one_line(name)}` {problem}")
            raise FileNotFoundError(name)

    content = file.read_bytes()
    if suffix in (".gltf", ".glb"):
        _check_gltf(file, content)
    if suffix == ".ply":
        _check_ply(file, content)
    # trimesh logs what it cannot read; the errors are reported here instead.
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about picture sizes, which are checked here
            scene = trimesh.load_scene(
                BytesIO(_utf8(content) if suffix == ".obj" else content),
                file_type=suffix[1:],
                resolver=Beside(str(file)),
                process=False,
            )
    except Exception:
        if lacking:
            raise BadFile(f"{file}: {lacking[0]}; put it beside it") from None
        raise
    return scene, lacking


def _check_gltf(file: Path, content: bytes) -> None:
    """Refuse compressed and missing data, which trimesh reads as zeros."""
    text = content
    if content[:4] == b"glTF":
        text = content[20 : 20 + int.from_bytes(content[12:16], "little")]
    header = json.loads(text)
    packed = [name for name in header.get("extensionsRequired", []) if "compression" in name]
    if packed:
        raise BadFile(f"{file}: its meshes are packed by {packed[0]}; export it without")
    for accessor in header.get("accessors", []):
        if "bufferView" not in accessor and accessor["count"] > len(content):
            raise BadFile(f"{file}: declares {accessor['count']} numbers that it does not hold")


def _check_ply(file: Path, content: bytes) -> None:
    """Refuse truncated text, for which trimesh mistakes faces for points."""
    head, _, body = content.partition(b"end_header")
    words = [line.split() for line in head.splitlines()]
    if not any(line[:2] == [b"format", b"ascii"] for line in words):
        return
    declared = sum(int(line[2]) for line in words if line[:1] == [b"element"])
    held = sum(1 for line in body.splitlines() if line.strip())
    if declared > held:
        raise BadFile(f"{file}: declares {declared} vertices and faces, but has {held}")


def _utf8(text: bytes) -> bytes:
    """Return text as UTF-8; only comments and names have other encodings."""
    return text.decode("utf-8", errors="replace").encode()


class _Pictures:
    """Encodes pictures, with one warning for each broken one."""

    def __init__(self, file: Path, warn: Warn) -> None:
        self._file = file
        self._warn = warn
        self._known: dict[int, bytes | None] = {}

    def content(self, image: Any) -> bytes | None:
        """Return a Pillow image as PNG or JPEG, with its original bytes if possible."""
        if image is None:
            return None
        if id(image) not in self._known:
            columns, rows = image.size
            if columns * rows > MAX_PIXELS:
                raise BadFile(
                    f"{self._file}: a picture in it has {columns} x {rows} pixels; expected at "
                    f"most {MAX_PIXELS // 10**6} million. Fix: scale it down"
                )
            try:
                self._known[id(image)] = _encoded(image)
            except Exception:
                self._known[id(image)] = None
                self._warn(f"{self._file}: a picture in it cannot be read and is left out")
        return self._known[id(image)]


def _encoded(image: Any) -> bytes:
    stream = getattr(image, "fp", None)
    original = stream.getvalue() if isinstance(stream, BytesIO) else None
    image.load()
    if original is not None and image.format in ("PNG", "JPEG"):
        return original
    file = BytesIO()
    image.convert("RGBA" if "A" in image.mode else "RGB").save(file, "PNG")
    return file.getvalue()


def _painted_as(visual: Any, piece: MeshPiece, pictures: _Pictures) -> MeshPiece:
    """Give a piece the appearance that trimesh found."""
    if visual.kind == "vertex":
        piece.colors = np.asarray(visual.vertex_colors)[:, :3] / 255.0
    elif visual.kind == "face":
        piece.vertices = piece.vertices[piece.faces].reshape(-1, 3)
        piece.faces = np.arange(len(piece.vertices)).reshape(-1, 3)
        piece.colors = (np.asarray(visual.face_colors)[:, :3] / 255.0).repeat(3, axis=0)
    elif visual.kind == "texture":
        material = visual.material
        if hasattr(material, "baseColorFactor"):
            factor, image = material.baseColorFactor, material.baseColorTexture
            normals = pictures.content(material.normalTexture)
            color = None if factor is None else np.asarray(factor)[:3] / 255.0
        else:
            image, normals = material.image, None
            # Exporters disagree on the diffuse factor of OBJ pictures; it is ignored.
            color = None if image is not None else linear(np.asarray(material.diffuse)[:3] / 255.0)
        picture = pictures.content(image)
        if picture is not None and color is None:
            color = np.ones(3)
        uv = None if visual.uv is None else np.asarray(visual.uv, np.float64)
        if uv is None or len(uv) != len(piece.vertices) or not np.isfinite(uv).all():
            uv = picture = normals = None
        piece.uv = uv
        piece.paint = (None if color is None else _vector(color), picture, normals)
    return piece


def _vector(color: Floats) -> Vector3:
    red, green, blue = np.clip(color, 0, 1).round(6).tolist()
    return red, green, blue
