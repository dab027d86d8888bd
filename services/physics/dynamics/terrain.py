# SPDX-License-Identifier: Apache-2.0
"""What physics sees of terrain: a window of it around each vehicle and all else that falls.

Rule: a window consists of cells of the map, so that wheels roll on the very triangles that sensors
see; where it lies follows from where it lay and where its body is, so the same calls give the
same bytes. A body meets its own window and no other: where windows overlap, nothing is borne
twice. Beside the map the ground goes on, level outwards, as high as at its edge.

A map of 15 km as a whole would take gigabytes of the engine, which wants 1 to 2 kB for each height
and says nothing when there are more than it has room for.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import UserError
from groundlink.core.fields import Vector3
from groundlink.core.frames import IDENTITY_QUATERNION, Floats
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.bounds import bounds
from groundlink.world.solids import Material, Solid, Sphere
from groundlink.world.spawn_pose import touching
from groundlink.world.terrain import Ground

from .engine import Engine
from .static_mesh import SKIN_M
from .statics import RAY, TERRAIN

LEAST_CELLS = 32
"""Along a side of a window: 2 MB, and 2 ms to lay it anew."""

MOST_CELLS = 256
"""Of that many a window takes 0.1 GB, and 0.1 s to lay it anew."""

MARGIN_M = 1.0
"""How far a body may go beyond its reach in a tick."""


class CarriedBody(Protocol):
    """A body that lies or stands on the ground."""

    @property
    def body(self) -> int:
        """Its number in the engine."""

    @property
    def position_m(self) -> Vector3:
        """Its origin in the world."""


class NoTerrain:
    """No terrain."""

    ground = None

    def carry(self, carried: CarriedBody, name: str, reach_m: float) -> None:
        """Do nothing: what carries bodies is solid."""

    def drop(self, carried: CarriedBody) -> None:
        """Do nothing: nothing was put under it."""

    def follow(self) -> None:
        """Do nothing."""

    def lowest_m(self, low: Floats, high: Floats) -> float:
        """Return the z above which things are high."""
        return 0.0

    def friction_at(self, x_m: float, y_m: float) -> float:
        """Return that of nothing."""
        return 0.0


class TerrainWindows:
    """A map, and its windows around vehicles."""

    def __init__(self, engine: Engine, ground: Ground, materials: Mapping[str, Material]) -> None:
        self._engine = engine
        self.ground = ground
        self._windows: list[tuple[TerrainWindow, CarriedBody]] = []
        self._frictions = [materials[name].friction for name in ground.materials]
        # A view of the bytes: for a single place a third of an array's time.
        self._surface = ground.surface.data
        rows, columns = ground.surface.shape
        self._last_row, self._last_column = rows - 1, columns - 1

    def carry(self, carried: CarriedBody, name: str, reach_m: float) -> int:
        """Put ground under a body, now and wherever it goes; return its number in the engine.

        Parameters
        ----------
        reach_m
            how far from its origin it touches things, however it is turned.

        Raises
        ------
        UserError
            when the map is too fine for so large a body.
        """
        window = TerrainWindow(self._engine, self, carried, name, reach_m)
        self._windows.append((window, carried))
        return window.body

    def drop(self, carried: CarriedBody) -> None:
        """Take away the ground under a body that is taken away, if it had some."""
        for window, its_body in self._windows:
            if its_body is carried:
                self._engine.removeBody(window.body)
        self._windows = [(w, its_body) for w, its_body in self._windows if its_body is not carried]

    def follow(self) -> None:
        """Go along with the bodies; to be called before every step."""
        for window, carried in self._windows:
            window.follow(*carried.position_m[:2])

    def friction_at(self, x_m: float, y_m: float) -> float:
        """Return the coefficient of what lies at a place; beside the map that of its edge."""
        ground = self.ground
        row = int((y_m - ground.y0_m) / ground.cell_m)
        column = int((x_m - ground.x0_m) / ground.cell_m)
        row, column = min(max(row, 0), self._last_row), min(max(column, 0), self._last_column)
        return self._frictions[self._surface[row, column]]

    def lowest_m(self, low: Floats, high: Floats) -> float:
        """Return how low the ground is, at the vertices of all cells that a box stands on.

        Parameters
        ----------
        low, high
            corners of the box, of which x and y count.
        """
        ground = self.ground
        origin = ground.x0_m, ground.y0_m
        last = np.array(ground.heights.shape)[::-1] - 1
        first, end = (
            np.clip(rounded((corner[:2] - origin) / ground.cell_m), 0, last).astype(int)
            for rounded, corner in ((np.floor, low), (np.ceil, high))
        )
        return float(ground.heights[first[1] : end[1] + 1, first[0] : end[0] + 1].min())


class TerrainWindow:
    """The part of a map that one body can touch.

    Raises
    ------
    UserError
        when the map is too fine for so large a body.
    """

    def __init__(
        self,
        engine: Engine,
        landscape: TerrainWindows,
        carried: CarriedBody,
        name: str,
        reach_m: float,
    ) -> None:
        self._engine, self._landscape = engine, landscape
        ground = landscape.ground
        # Laid anew when the body leaves the inner half, from which it does not reach the border.
        reach_m += MARGIN_M
        self._half = max(LEAST_CELLS // 2, ceil(2 * reach_m / ground.cell_m))
        if self._half > MOST_CELLS // 2:
            raise UserError(
                f"`{name}` is too large for terrain with cells of {ground.cell_m:g} m: "
                f"physics would look at {2 * self._half} x {2 * self._half} of them at once; "
                f"expected cells of {4 * reach_m / MOST_CELLS:.2g} m or more"
            )
        self._free_m = self._half * ground.cell_m / 2
        # The engine keeps for good what it is first given: its z = 0 is amid lowest and highest.
        extremes = np.full((2 * self._half + 1) ** 2, ground.heights.min() - 1, np.float32)
        extremes[0] = ground.heights.max() + 1
        self._middle_z_m = (float(extremes[0]) + float(extremes[-1])) / 2
        self._shape = self._shaped(extremes)
        self.body: int = engine.createMultiBody(0, self._shape, engine.unseen)
        at_m = carried.position_m[:2]
        self._friction = landscape.friction_at(*at_m)
        engine.changeDynamics(
            self.body,
            -1,
            lateralFriction=self._friction,
            restitution=1.0,
            collisionMargin=SKIN_M,
        )
        engine.setCollisionFilterGroupMask(self.body, -1, TERRAIN, RAY)
        for link in range(-1, engine.getNumJoints(carried.body)):
            engine.setCollisionFilterPair(carried.body, self.body, link, -1, 1)
        self._lay(*at_m)

    def follow(self, x_m: float, y_m: float) -> None:
        """Take note of where the body is."""
        if max(abs(x_m - self._x_m), abs(y_m - self._y_m)) > self._free_m:
            self._lay(x_m, y_m)
        # Wheels look up what is under each of them; to the chassis it is all the same material.
        friction = self._landscape.friction_at(x_m, y_m)
        if friction != self._friction:
            self._friction = friction
            self._engine.changeDynamics(self.body, -1, lateralFriction=friction)

    def _lay(self, x_m: float, y_m: float) -> None:
        """Put it around a place, as near as the cells allow."""
        ground, half = self._landscape.ground, self._half
        row = round((y_m - ground.y0_m) / ground.cell_m)
        column = round((x_m - ground.x0_m) / ground.cell_m)
        self._x_m = ground.x0_m + column * ground.cell_m
        self._y_m = ground.y0_m + row * ground.cell_m
        around = np.arange(-half, half + 1)
        rows, columns = ground.heights.shape
        block = np.ix_(np.clip(around + row, 0, rows - 1), np.clip(around + column, 0, columns - 1))
        self._shaped(ground.heights[block].ravel(), replaceHeightfieldIndex=self._shape)
        self._engine.resetBasePositionAndOrientation(
            self.body, (self._x_m, self._y_m, self._middle_z_m), IDENTITY_QUATERNION
        )

    def _shaped(self, heights: NDArray[np.float32], **which: int) -> int:
        cell_m, side = self._landscape.ground.cell_m, 2 * self._half + 1
        shape: int = self._engine.createCollisionShape(
            self._engine.GEOM_HEIGHTFIELD,
            meshScale=(cell_m, cell_m, 1.0),
            heightfieldData=heights,
            numHeightfieldRows=side,
            numHeightfieldColumns=side,
            # Or a wheel that rolls over a level edge is pushed by it: 0.3 m/s2, not 0.005.
            flags=self._engine.GEOM_CONCAVE_INTERNAL_EDGE,
            **which,
        )
        return shape


def reach_of(model: VehicleModel) -> float:
    """Return how far from its base's origin a vehicle touches things, however it is turned."""
    wheels = [
        Solid(wheel.name, Sphere(radius_m=wheel.radius_m), "", wheel.center_m)
        for wheel in model.wheels
    ]
    boxes = [bounds(part) for part in (*wheels, *touching(model))]
    return max(float(np.linalg.norm(np.maximum(-low, high))) for low, high in boxes)
