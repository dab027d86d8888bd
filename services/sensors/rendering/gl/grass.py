# SPDX-License-Identifier: Apache-2.0
"""Tall grass on the graphics card: tufts as instances of some blades.

Tufts are made where a view needs them, from their places alone. Near the eye all are drawn; farther
away their number falls with the distance, and their blades get wider, as many pixels as they were.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats, matrix_from_quaternion
from groundlink.world.cover import TUFT_M, GrassArea, grass_of_cells, tuft_draws
from groundlink.world.ruts import RutGrid
from groundlink.world.solids import Material
from groundlink.world.terrain import Ground
from services.sensors.rendering.look.mesh import Skin
from services.sensors.rendering.look.textures import texture

from .culling import Boxes, seen
from .stage import Outline

PATCH = 16
"""Tufts along the side of a patch, which is culled and thinned as a whole."""

NEAR_M, FAR_M = 6.0, 60.0
"""Distances up to which all tufts are drawn, and any."""

BLADES = 9
"""Blades of a tuft."""

COARSE_M, COARSE_BLADES = 14.0, 3
"""Distance from which a tuft has so many, which are as much wider."""

BENT_M = 0.02
"""Height of grass under what lies on the ground."""

MOST_PATCHES = 4000
"""Patches that are kept."""

_TUFT = np.dtype(
    [
        ("root", np.float32, 4),
        ("look", np.float32, 4),
        ("draw", np.float32),
        ("tuft_label", np.int32),
    ]
)


class PressedArea(NamedTuple):
    """The rectangle of a vehicle as seen from above, and the height of its lowest point."""

    at: tuple[float, float]
    ahead: tuple[float, float]
    """Unit vector of its heading."""

    low: tuple[float, float]
    """Ends along and across the heading; so is `high`."""

    high: tuple[float, float]
    under_m: float

    def bend(self, tufts: NDArray[np.void]) -> None:
        """Bend the tufts in the area down to its lowest point."""
        root = tufts["root"]
        from_it = root[:, :2] - np.array(self.at, np.float32)
        x, y = self.ahead
        at = np.stack([from_it @ (x, y), from_it @ (-y, x)], axis=-1)
        inside = ((at > self.low) & (at < self.high)).all(axis=1)
        left = np.maximum(self.under_m - root[inside, 2], BENT_M)
        root[inside, 3] = np.minimum(root[inside, 3], left)


def lay(tufts: NDArray[np.void], ruts: RutGrid) -> None:
    """Let those tufts lie in whose squares a wheel has pressed the ground."""
    lies = np.zeros(len(tufts), np.bool_)
    for east in (-1, 0, 1):
        for north in (-1, 0, 1):
            x, y = (tufts["root"][:, :2] + TUFT_M / 3 * np.array([east, north])).T
            lies |= ruts.are_pressed(x, y)
    tufts["root"][lies, 3] = BENT_M


def pressed_by(outline: Outline) -> PressedArea:
    """Return the area of a vehicle, of which the first link is the base."""
    x, y, *_ = base = outline.poses[0]
    ahead = matrix_from_quaternion(base[3:])[:2, 0]
    ahead = ahead / max(float(np.hypot(*ahead)), 1e-9)
    from_base = outline.corners[..., :2].reshape(-1, 2) - (x, y)
    along, across = from_base @ ahead, from_base @ (-ahead[1], ahead[0])
    return PressedArea(
        at=(float(x), float(y)),
        ahead=(float(ahead[0]), float(ahead[1])),
        low=(float(along.min()), float(across.min())),
        high=(float(along.max()), float(across.max())),
        under_m=float(outline.corners[0, :, 2].min()),
    )


class DrawnGrass:
    """The grass of a world.

    Parameters
    ----------
    programs
        One of each pass.
    labels
        Label of each area.

    Attributes
    ----------
    skin : Skin
        Texture of the blades.
    """

    def __init__(
        self,
        context: moderngl.Context,
        programs: Sequence[moderngl.Program],
        ground: Ground,
        areas: Sequence[GrassArea],
        materials: Mapping[str, Material],
        labels: Sequence[int],
    ) -> None:
        self._programs, self._ground = programs, ground
        self._kinds = grass_of_cells(areas, ground)
        self._heights = np.array([(0.0, 0.0), *(area.height_m for area in areas)], np.float32)
        self._colors = np.array([(0.0,) * 3, *(materials[a.material].color for a in areas)])
        self._labels = np.array([0, *labels], np.int32)
        self._patches: dict[tuple[int, int], NDArray[np.void]] = {}
        vertices, faces = _blades()
        content = context.buffer(vertices.tobytes()), "3f", "knot"
        indices = context.buffer(faces.tobytes())
        self._indices = len(faces) // BLADES * 3
        self._groups = []
        for blades in (BLADES, COARSE_BLADES):
            buffer = context.buffer(reserve=1024 * _TUFT.itemsize)
            tufts = buffer, "4f 4f 1f 1i /i", *_TUFT.names  # type: ignore[misc]
            arrays = [
                context.vertex_array(program, [content, tufts], indices, skip_errors=True)
                for program in programs
            ]
            self._groups.append((blades, buffer, arrays))
        self._counts = [0, 0]
        self._ruts: RutGrid | None = None
        self.skin = Skin(texture("plain"))

    def press(self, ruts: RutGrid) -> None:
        """Let grass lie in these ruts from now on."""
        self._ruts = ruts

    def aim(self, clip_from_world: Floats, eye: Floats, pressed: Sequence[PressedArea]) -> None:
        """Choose the tufts of a view, for all passes."""
        groups = self._shown(clip_from_world, eye)
        self._counts = [len(tufts) for tufts in groups]
        for tufts, (_, buffer, _) in zip(groups, self._groups, strict=True):
            for area in pressed:
                area.bend(tufts)
            if self._ruts is not None and self._ruts.count:
                lay(tufts, self._ruts)
            if tufts.nbytes > buffer.size:
                buffer.orphan(2 * tufts.nbytes)
            buffer.write(tufts.tobytes())

    def draw(self, number: int) -> None:
        """Draw the chosen tufts with the program of a pass, whose uniforms must be set."""
        for count, (blades, _, arrays) in zip(self._counts, self._groups, strict=True):
            if count:
                arrays[number].render(vertices=blades * self._indices, instances=count)

    def _shown(self, clip_from_world: Floats, eye: Floats) -> list[NDArray[np.void]]:
        """Return the tufts with all blades, and those with few."""
        side_m = PATCH * TUFT_M
        reach = int(FAR_M / side_m) + 1
        middle = np.floor(eye[:2] / side_m).astype(int)
        across, along = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
        numbers = np.stack([middle[0] + across, middle[1] + along], axis=-1)
        ground, tallest = self._ground, float(self._heights.max())
        corners = numbers * side_m
        rows, columns = ground.heights.shape
        first = np.array([ground.x0_m, ground.y0_m])
        size = ground.cell_m * (np.array([columns, rows]) - 1)
        there = ((corners + side_m > first) & (corners < first + size)).all(axis=1)
        numbers, corners = numbers[there], corners[there]
        heights = ground.height_at(*(np.clip(corners + side_m / 2, first, first + size).T))
        # The ground of a patch is not more than its own side above or below its middle.
        lows = np.column_stack([corners, heights - side_m])
        highs = np.column_stack([corners + side_m, heights + side_m + tallest])
        boxes = Boxes.around(lows, highs)
        away_m = boxes.away(eye)
        visible = np.flatnonzero(seen(boxes, clip_from_world) & (away_m < FAR_M))
        groups = [[np.empty(0, _TUFT)], [np.empty(0, _TUFT)]]
        for index in visible:
            share = NEAR_M / max(float(away_m[index]), NEAR_M)
            patch = self._patch(*numbers[index].tolist())
            part = patch[: int(np.ceil(share * len(patch)))].copy()
            is_coarse = bool(away_m[index] > COARSE_M)
            part["look"][:, 3] = (BLADES / COARSE_BLADES if is_coarse else 1) / share
            groups[is_coarse].append(part)
        return [np.concatenate(parts) for parts in groups]

    def _patch(self, column: int, row: int) -> NDArray[np.void]:
        """Return the tufts of a patch, in a random order."""
        key = column, row
        if key not in self._patches:
            while len(self._patches) >= MOST_PATCHES:
                del self._patches[next(iter(self._patches))]
            self._patches[key] = self._grown(column, row)
        return self._patches[key]

    def _grown(self, column: int, row: int) -> NDArray[np.void]:
        ground = self._ground
        x, y = np.mgrid[:PATCH, :PATCH].reshape(2, -1)
        x, y = column * PATCH + x, row * PATCH + y
        at = TUFT_M * np.stack([x + 0.5, y + 0.5])
        inside = ground.inside(*at)
        (x, y), at = (x[inside], y[inside]), at[:, inside]
        cells = ((at - [[ground.x0_m], [ground.y0_m]]) / ground.cell_m).astype(int)
        rows, columns = self._kinds.shape
        kinds = self._kinds[np.minimum(cells[1], rows - 1), np.minimum(cells[0], columns - 1)]
        grows = np.flatnonzero(kinds)
        x, y, at, kinds = x[grows], y[grows], at[:, grows], kinds[grows]
        height, rank = tuft_draws(x, y), tuft_draws(y + 7919, x)
        low, high = self._heights[kinds].T
        tufts = np.zeros(len(grows), _TUFT)
        tufts["root"] = np.column_stack([*at, ground.height_at(*at), low + (high - low) * height])
        shade = 0.8 + 0.4 * tuft_draws(x, y + 104729)
        tufts["look"][:, :3] = self._colors[kinds] * shade[:, None]
        tufts["draw"] = rank
        tufts["tuft_label"] = self._labels[kinds]
        return tufts[np.argsort(rank, kind="stable")]


def _blades() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return knots, shape (K, 3), and faces, shape (F, 3), of the blades of a tuft."""
    strip = np.array([(-1, 0), (1, 0), (-1, 0.5), (1, 0.5), (0, 1)], np.float32)
    faces = np.array([(0, 1, 2), (2, 1, 3), (2, 3, 4)])
    numbers = np.repeat(np.arange(BLADES), len(strip))
    knots = np.column_stack([numbers, np.tile(strip, (BLADES, 1))]).astype(np.float32)
    every = faces[None] + len(strip) * np.arange(BLADES)[:, None, None]
    return knots, every.reshape(-1, 3).astype(np.uint32)
