# SPDX-License-Identifier: Apache-2.0
"""The scene on the graphics card: static objects in chunks of space, moving objects as instances.

The stage knows where things are and how they are drawn, and nothing of cameras, light or pictures.
Static objects are uploaded once; a move uploads matrices only.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import moderngl
import numpy as np
from msgspec import structs

from groundlink.core.frames import Floats, transform
from groundlink.world.solids import Material, Solid
from services.sensors.rendering.look.labels import Labels
from services.sensors.rendering.look.mesh import VERTEX, Skin, SkinnedMesh
from services.sensors.rendering.look.shapes import meshes

from .culling import Boxes
from .programs import Programs

CHUNK_M = 6.0
"""Smallest edge of the cells that static objects are split into."""

CHUNKS = 24
"""Largest number of cells along the world's longest side: each cell is a draw call."""

_VERTICES = "3f 3f 2f 3f 1i"
_INSTANCES = "16f 1i /i"
_INSTANCE = np.dtype([("world_from_link", np.float32, (4, 4)), ("vehicle", np.int32)])


@dataclass(frozen=True)
class DrawCall:
    """Something drawn with one call, once or as several instances."""

    surfaces: tuple[moderngl.VertexArray, ...]
    """One vertex array for each pass of `Programs`."""

    shadow: moderngl.VertexArray
    skin: Skin
    instances: int
    is_open: bool


class Things(Protocol):
    """The visible objects around a sensor. The world replica provides them."""

    @property
    def static(self) -> Sequence[Solid]:
        """Static solids, in the world's frame."""

    @property
    def links(self) -> Sequence[Sequence[Solid]]:
        """The solids of each moving link, in the frame of the link."""

    @property
    def movers(self) -> Sequence[str]:
        """The vehicle or actor of each link."""


class Outline(NamedTuple):
    """The place of a vehicle or an actor."""

    poses: Floats
    """world_from_link, shape (links, 7)."""

    corners: Floats
    """Corners of the boxes around its links, in the world, shape (links, 8, 3)."""


class Stage:
    """All visible objects of a scenario.

    Attributes
    ----------
    standing : list of DrawCall
        Static objects.
    boxes : Boxes
        Box around each of `standing`.
    moving : list of DrawCall
        One for each kind of link and texture.
    movers : list of Outline
        Current place of each vehicle and actor.
    matrices : array, shape (links, 4, 4)
        Current world_from_link.
    """

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        around: Things,
        materials: Mapping[str, Material],
        labels: Labels,
    ) -> None:
        self._context, self._programs = context, programs
        self._skins: dict[str, Skin] = {}
        self._at_rest = self.instances(1)
        self.write(self._at_rest, np.eye(4)[None])
        numbers = labels.of_solids(solid.name for solid in around.static)
        self.standing: list[DrawCall] = []
        self.boxes = boxes_around([])
        made = meshes(around.static, numbers, materials, self._skins)
        extent = boxes_around(made).whole().halves.max(initial=0) * 2
        self._chunk_m = max(CHUNK_M, extent / CHUNKS)
        for mesh in made:
            self.add(mesh)

        self._mover_labels = [labels.of_mover(name) for name in around.movers]
        self._groups: list[tuple[list[int], moderngl.Buffer]] = []
        self.moving: list[DrawCall] = []
        corners = np.zeros((len(around.links), 8, 3))
        for links in _alike(around.links):
            looks = around.links[links[0]]
            if not looks:
                continue
            buffer = self.instances(len(links))
            made = meshes(looks, [0] * len(looks), materials, self._skins)
            self.moving += [self.part(mesh, buffer, len(links)) for mesh in made]
            self._groups.append((links, buffer))
            corners[links] = boxes_around(made).whole().corners()
        self._link_corners = corners
        self._links_of = [
            [i for i, name in enumerate(around.movers) if name == mover]
            for mover in dict.fromkeys(around.movers)
        ]
        self.movers: list[Outline] = []
        self.matrices: Floats = np.empty((0, 4, 4))

    def add(self, mesh: SkinnedMesh) -> None:
        """Add a mesh that belongs to no solid, in the world's frame."""
        chunks = list(cut(mesh, self._chunk_m))
        self.standing += [self.part(chunk, self._at_rest, 1) for chunk in chunks]
        self.boxes = self.boxes.joined(boxes_around(chunks))

    def place(self, world_from_link: Floats) -> None:
        """Set the pose of every link: position and quaternion, shape (links, 7)."""
        matrices = self.matrices = transform(world_from_link[:, :3], world_from_link[:, 3:])
        for links, buffer in self._groups:
            numbers = [self._mover_labels[link] for link in links]
            self.write(buffer, matrices[links], numbers)
        corners = self._link_corners @ np.swapaxes(matrices[:, :3, :3], 1, 2)
        corners += matrices[:, None, :3, 3]
        self.movers = [Outline(world_from_link[i], corners[i]) for i in self._links_of]

    def instances(self, count: int) -> moderngl.Buffer:
        """Return a buffer for the matrices and labels of instances, for `part`."""
        return self._context.buffer(reserve=count * _INSTANCE.itemsize)

    def write(
        self, instances: moderngl.Buffer, matrices: Floats, labels: Sequence[int] = (0,)
    ) -> None:
        """Set the poses of instances, shape (instances, 4, 4), and their labels."""
        instances.write(_instances(matrices, labels).tobytes())

    def part(self, mesh: SkinnedMesh, instances: moderngl.Buffer, count: int) -> DrawCall:
        """Return the draw call of a mesh at the poses of instances."""
        vertices = self._context.buffer(mesh.vertices.tobytes())
        faces = self._context.buffer(mesh.faces.tobytes())
        programs = self._programs
        drawn = [one.surface if mesh.skin.normal is None else one.bumped for one in programs.passes]
        arrays = [
            self._context.vertex_array(
                program,
                [
                    (vertices, _VERTICES, *VERTEX.names),  # type: ignore[misc]
                    (instances, _INSTANCES, "world_from_link", "vehicle"),
                ],
                faces,
                skip_errors=True,  # a program omits the attributes that it does not use
            )
            for program in (*drawn, programs.shadow)
        ]
        return DrawCall(tuple(arrays[:-1]), arrays[-1], mesh.skin, count, mesh.is_open)


def _instances(
    matrices: Floats, labels: Sequence[int]
) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    rows = np.empty(len(matrices), _INSTANCE)
    rows["world_from_link"] = np.swapaxes(matrices, 1, 2)  # OpenGL stores matrices by columns
    rows["vehicle"] = labels
    return rows


def _alike(links: Sequence[Sequence[Solid]]) -> list[list[int]]:
    """Return groups of indices of links that look alike."""
    groups: dict[tuple[Solid, ...], list[int]] = {}
    for number, link in enumerate(links):
        look = tuple(structs.replace(solid, name="") for solid in link)
        groups.setdefault(look, []).append(number)
    return list(groups.values())


def cut(mesh: SkinnedMesh, edge_m: float) -> Iterator[SkinnedMesh]:
    """Yield the chunks of a mesh: the faces whose centers share one cell of space.

    Splitting moves no vertex and cuts no triangle.
    """
    middles = mesh.vertices["position"][mesh.faces].mean(axis=1)
    cells, of_face = np.unique(np.floor(middles / edge_m), axis=0, return_inverse=True)
    of_face = of_face.reshape(-1)
    ends = np.cumsum(np.bincount(of_face, minlength=len(cells)))
    for faces in np.split(mesh.faces[np.argsort(of_face, kind="stable")], ends[:-1]):
        used, numbers = np.unique(faces, return_inverse=True)
        faces = numbers.reshape(-1, 3).astype(np.uint32)
        yield replace(mesh, vertices=mesh.vertices[used], faces=faces)


def boxes_around(made: Sequence[SkinnedMesh]) -> Boxes:
    """Return the box around each mesh."""
    positions = [mesh.vertices["position"].astype(np.float64) for mesh in made]
    lows, highs = ([f(p, axis=0) for p in positions] for f in (np.min, np.max))
    return Boxes.around(np.reshape(lows, (-1, 3)), np.reshape(highs, (-1, 3)))
