# SPDX-License-Identifier: Apache-2.0
"""Silhouettes: how many pixels single objects would cover if nothing were in front of them.

Each object is drawn alone, with the programs, the matrices and the vertices of the whole picture,
so that it covers the same pixels as there.
"""

from collections.abc import Mapping
from typing import NamedTuple

import moderngl
import numpy as np

from groundlink.core.frames import Floats
from groundlink.world.solids import Material, Solid
from services.sensors.rendering.look.labels import Labels
from services.sensors.rendering.look.mesh import Skin
from services.sensors.rendering.look.shapes import meshes

from .stage import DrawCall, Stage, Things, boxes_around
from .target import TruthTarget


class _Part(NamedTuple):
    """A part of an object that is drawn with one call."""

    link: int | None
    """None in the static world."""

    call: DrawCall
    corners: Floats
    """Corners of the box around it, in the frame of its link or in the world, shape (8, 3)."""


class Silhouettes:
    """Draws single objects of a stage.

    Parameters
    ----------
    number : int
        Index of the pass that draws depth and labels.
    sky : moderngl.VertexArray
        Sky of that pass, which covers all that the object leaves.
    """

    def __init__(
        self,
        context: moderngl.Context,
        stage: Stage,
        around: Things,
        materials: Mapping[str, Material],
        labels: Labels,
        *,
        target: TruthTarget,
        number: int,
        sky: moderngl.VertexArray,
    ) -> None:
        self._context, self._stage, self._materials = context, stage, materials
        self._target, self._number, self._sky = target, number, sky
        self._skins: dict[str, Skin] = {}
        self._passed = context.query(samples=True)
        self._static: dict[int, list[Solid]] = {}
        numbers = labels.of_solids(solid.name for solid in around.static)
        for label, solid in zip(numbers, around.static, strict=True):
            self._static.setdefault(label, []).append(solid)
        self._links: dict[int, list[int]] = {}
        for link, mover in enumerate(around.movers):
            self._links.setdefault(labels.of_mover(mover), []).append(link)
        self._solids_of_link = around.links
        self._at_rest = stage.instances(1)
        stage.write(self._at_rest, np.eye(4)[None])
        self._of_link = stage.instances(1)
        self._parts: dict[int, list[_Part]] = {}
        """By label."""

    def covered(self, label: int, clip_from_world: Floats) -> int:
        """Return the pixels that an object covers alone, in the view that was drawn last."""
        parts = self._parts_of(label)
        corners = [
            part.corners if part.link is None else self._moved(part.corners, part.link)
            for part in parts
        ]
        pixels = self._target.begin_part(np.concatenate(corners), clip_from_world)
        self._context.depth_func = "<"
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        for part in parts:
            if part.link is not None:
                self._stage.write(self._of_link, self._stage.matrices[part.link][None])
            part.call.surfaces[self._number].render(instances=1)
        self._context.disable(moderngl.CULL_FACE)
        self._context.depth_func = "<="
        with self._passed:
            self._sky.render(vertices=3)
        self._target.end_part()
        return pixels - self._passed.samples

    def _moved(self, corners: Floats, link: int) -> Floats:
        matrix = self._stage.matrices[link]
        moved: Floats = corners @ matrix[:3, :3].T + matrix[:3, 3]
        return moved

    def _parts_of(self, label: int) -> list[_Part]:
        if label not in self._parts:
            solids: list[tuple[int | None, list[Solid]]] = [(None, self._static.get(label, []))]
            solids += [
                (link, list(self._solids_of_link[link])) for link in self._links.get(label, [])
            ]
            self._parts[label] = [
                _Part(
                    link,
                    self._stage.part(mesh, self._at_rest if link is None else self._of_link, 1),
                    boxes_around([mesh]).corners()[0],
                )
                for link, parts in solids
                for mesh in meshes(parts, [0] * len(parts), self._materials, self._skins)
            ]
        return self._parts[label]
