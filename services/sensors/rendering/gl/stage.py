# SPDX-License-Identifier: Apache-2.0
"""The world on the graphics card: what stands in chunks of space, what moves as instances.

Rule: knows what is where and how it is drawn, and nothing of cameras, light or pictures. What
stands is uploaded once; a move uploads matrices alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import moderngl
import numpy as np
from msgspec.structs import replace

from groundlink.core.frames import Floats, transform
from groundlink.world.solids import Material, Solid
from services.sensors.rendering.look.labels import Labels
from services.sensors.rendering.look.mesh import VERTEX, Mesh, Skin
from services.sensors.rendering.look.shapes import meshes

from .chunks import boxes_around, cut
from .programs import Programs

CHUNK_M = 6.0
"""Least edge of the cells that what stands is cut into."""

CHUNKS = 24
"""Most of them along the world's longest side: each is a call."""

_VERTICES = "3f 3f 2f 3f 1i"
_INSTANCES = "16f 1i /i"
_INSTANCE = np.dtype([("world_from_link", np.float32, (4, 4)), ("vehicle", np.int32)])


@dataclass(frozen=True)
class Part:
    """Something that is drawn with one call, or several times at once as instances."""

    surfaces: tuple[moderngl.VertexArray, ...]
    """One for each pass of `Programs`."""

    shadow: moderngl.VertexArray
    skin: Skin
    instances: int
    is_open: bool


class Things(Protocol):
    """What there is to see; `Surroundings` are such."""

    @property
    def static(self) -> Sequence[Solid]:
        """In the world."""

    @property
    def links(self) -> Sequence[Sequence[Solid]]:
        """Those of all that moves, each in its own frame."""

    @property
    def movers(self) -> Sequence[str]:
        """The vehicle of each link, or the actor that it is."""


class Outline(NamedTuple):
    """Where a vehicle or an actor is."""

    poses: Floats
    """world_from_link, shape (links, 7)."""

    corners: Floats
    """Of the boxes around its links, in the world, shape (links, 8, 3)."""


class Stage:
    """Everything that can be seen in a scenario, at rest or moving.

    Attributes
    ----------
    standing : list of Part
        In the world.
    boxes : Boxes
        Around each of `standing`.
    moving : list of Part
        One for each kind of link and texture.
    movers : list of Outline
        Where each vehicle and actor is now.
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
        self._at_rest = context.buffer(_instances(np.eye(4)[None], [0]).tobytes())
        numbers = labels.of_solids(solid.name for solid in around.static)
        self.standing: list[Part] = []
        self.boxes = boxes_around([])
        made = meshes(around.static, numbers, materials, self._skins)
        extent = boxes_around(made).whole().halves.max(initial=0) * 2
        self._chunk_m = max(CHUNK_M, extent / CHUNKS)
        for mesh in made:
            self.add(mesh)

        self._mover_labels = [labels.of_mover(name) for name in around.movers]
        self._groups: list[tuple[list[int], moderngl.Buffer]] = []
        self.moving: list[Part] = []
        corners = np.zeros((len(around.links), 8, 3))
        for links in _alike(around.links):
            looks = around.links[links[0]]
            if not looks:
                continue
            buffer = context.buffer(reserve=len(links) * _INSTANCE.itemsize)
            made = meshes(looks, [0] * len(looks), materials, self._skins)
            self.moving += [self._part(mesh, buffer, len(links)) for mesh in made]
            self._groups.append((links, buffer))
            corners[links] = boxes_around(made).whole().corners()
        self._link_corners = corners
        self._links_of = [
            [i for i, name in enumerate(around.movers) if name == mover]
            for mover in dict.fromkeys(around.movers)
        ]
        self.movers: list[Outline] = []

    def add(self, mesh: Mesh) -> None:
        """Stand a mesh in the world that no solid is made of, in the world's frame."""
        chunks = list(cut(mesh, self._chunk_m))
        self.standing += [self._part(chunk, self._at_rest, 1) for chunk in chunks]
        self.boxes = self.boxes.joined(boxes_around(chunks))

    def place(self, world_from_link: Floats) -> None:
        """Put every link at a pose: position and quaternion, shape (links, 7)."""
        matrices = transform(world_from_link[:, :3], world_from_link[:, 3:])
        for links, buffer in self._groups:
            numbers = [self._mover_labels[link] for link in links]
            buffer.write(_instances(matrices[links], numbers).tobytes())
        corners = self._link_corners @ np.swapaxes(matrices[:, :3, :3], 1, 2)
        corners += matrices[:, None, :3, 3]
        self.movers = [Outline(world_from_link[i], corners[i]) for i in self._links_of]

    def _part(self, mesh: Mesh, instances: moderngl.Buffer, count: int) -> Part:
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
                skip_errors=True,  # a program leaves out what it does not need
            )
            for program in (*drawn, programs.shadow)
        ]
        return Part(tuple(arrays[:-1]), arrays[-1], mesh.skin, count, mesh.is_open)


def _instances(
    matrices: Floats, labels: Sequence[int]
) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    rows = np.empty(len(matrices), _INSTANCE)
    rows["world_from_link"] = np.swapaxes(matrices, 1, 2)  # OpenGL goes by columns
    rows["vehicle"] = labels
    return rows


def _alike(links: Sequence[Sequence[Solid]]) -> list[list[int]]:
    """Return the numbers of links that look alike, together."""
    groups: dict[tuple[Solid, ...], list[int]] = {}
    for number, link in enumerate(links):
        groups.setdefault(tuple(replace(solid, name="") for solid in link), []).append(number)
    return list(groups.values())
