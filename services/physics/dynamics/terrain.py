# SPDX-License-Identifier: Apache-2.0
"""Terrain in the backend: a window of the map under each vehicle and each free actor.

A window consists of cells of the map, so wheels roll on the triangles that sensors see. Where it
lies follows from where it lay before and where its body is: the same calls give the same bytes. A
body touches its own window alone, so overlapping windows do not carry it twice. Beyond the map the
ground continues level, as high as at the map's edge.

A map of 15 km as one heightfield would take gigabytes: Bullet needs 1 to 2 kB for each height, and
reports nothing when it runs out of room.
"""

from collections.abc import Mapping
from math import ceil
from typing import Protocol

import numpy as np

from groundlink.core.errors import UserError
from groundlink.core.fields import Vector3
from groundlink.core.frames import Floats
from groundlink.scenario.vehicle import VehicleModel
from groundlink.scene.spawn_pose import collision_solids
from groundlink.world.bounds import bounds
from groundlink.world.roughness import Roughness, smooth
from groundlink.world.solids import Material, Solid, Sphere
from groundlink.world.terrain import Ground

from .backend import Backend

MIN_CELLS = 32
"""Cells along a side of a window: 2 MB, and 2 ms to lay it."""

MAX_CELLS = 256
"""A window of this many takes 0.1 GB, and 0.1 s to lay it."""

MARGIN_M = 1.0
"""How far a body may move beyond its reach in a tick."""


class CarriedBody(Protocol):
    """A body that lies or stands on the ground."""

    @property
    def body(self) -> int:
        """Its body in the backend."""

    @property
    def position_m(self) -> Vector3:
        """Its origin in the world."""


class NoTerrain:
    """Stands for terrain in a world that has none: solids carry all bodies."""

    ground = None

    def carry(self, carried: CarriedBody, name: str, reach_m: float) -> None:
        """Do nothing."""

    def drop(self, carried: CarriedBody) -> None:
        """Do nothing."""

    def follow(self) -> None:
        """Do nothing."""

    def lowest_m(self, low: Floats, high: Floats) -> float:
        """Return the z above which heights count."""
        return 0.0


class TerrainWindows:
    """A map and its windows.

    Attributes
    ----------
    frictions, roughness
        of the map's materials.
    """

    def __init__(
        self,
        backend: Backend,
        ground: Ground,
        materials: Mapping[str, Material],
        roughness: Roughness = smooth,
    ) -> None:
        self._backend = backend
        self.ground = ground
        self._windows: list[tuple[TerrainWindow, CarriedBody]] = []
        self.frictions = [materials[name].friction for name in ground.materials]
        self.soils = [materials[name].soil for name in ground.materials]
        self.roughness = [roughness(name) for name in ground.materials]
        # A view of the bytes: for one cell it takes a third of an array's time.
        self._surface = ground.surface.data
        rows, columns = ground.surface.shape
        self._last_row, self._last_column = rows - 1, columns - 1

    def carry(self, carried: CarriedBody, name: str, reach_m: float) -> int:
        """Keep ground under a body from now on; return the window's body in the backend.

        Parameters
        ----------
        reach_m
            how far from its origin the body touches things, however it is turned.

        Raises
        ------
        UserError
            when the map is too fine for a body of this size.
        """
        window = TerrainWindow(self._backend, self, carried, name, reach_m)
        self._windows.append((window, carried))
        return window.body

    def drop(self, carried: CarriedBody) -> None:
        """Remove the window of a body, if it has one."""
        for window, its_body in self._windows:
            if its_body is carried:
                self._backend.remove(window.body)
        self._windows = [(w, its_body) for w, its_body in self._windows if its_body is not carried]

    def follow(self) -> None:
        """Move windows after their bodies; to be called before every step."""
        for window, carried in self._windows:
            window.follow(*carried.position_m[:2])

    def friction_at(self, x_m: float, y_m: float) -> float:
        """Return the coefficient of friction at a point; beyond the map that of its edge."""
        return self.frictions[self._material_at(x_m, y_m)]

    def _material_at(self, x_m: float, y_m: float) -> int:
        ground = self.ground
        row = int((y_m - ground.y0_m) / ground.cell_m)
        column = int((x_m - ground.x0_m) / ground.cell_m)
        row, column = min(max(row, 0), self._last_row), min(max(column, 0), self._last_column)
        return self._surface[row, column]

    def lowest_m(self, low: Floats, high: Floats) -> float:
        """Return the lowest height among the vertices of all cells that a box stands on.

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
        when the map is too fine for a body of this size.
    """

    def __init__(
        self,
        backend: Backend,
        terrain: TerrainWindows,
        carried: CarriedBody,
        name: str,
        reach_m: float,
    ) -> None:
        self._backend, self._terrain = backend, terrain
        ground = terrain.ground
        # Laid anew when the body leaves the inner half, from which it does not reach the border.
        reach_m += MARGIN_M
        self._half = max(MIN_CELLS // 2, ceil(2 * reach_m / ground.cell_m))
        if self._half > MAX_CELLS // 2:
            raise UserError(
                f"`{name}` is too large for terrain with cells of {ground.cell_m:g} m: physics "
                f"would need {2 * self._half} x {2 * self._half} cells at once; expected cells of "
                f"{4 * reach_m / MAX_CELLS:.2g} m or more"
            )
        self._free_m = self._half * ground.cell_m / 2
        # The backend keeps z = 0 halfway between the extremes of the first heights.
        side = 2 * self._half + 1
        extremes = np.full((side, side), ground.heights.min() - 1, np.float32)
        extremes[0, 0] = ground.heights.max() + 1
        self._middle_z_m = (float(extremes[0, 0]) + float(extremes[-1, -1])) / 2
        at_m = carried.position_m[:2]
        self._friction = terrain.friction_at(*at_m)
        self.body = backend.add_heightfield(carried.body, extremes, ground.cell_m, self._friction)
        self._lay(*at_m)

    def follow(self, x_m: float, y_m: float) -> None:
        """Follow the body to a point."""
        if max(abs(x_m - self._x_m), abs(y_m - self._y_m)) > self._free_m:
            self._lay(x_m, y_m)
        # Each wheel finds the material under it; the chassis takes all of the window for one.
        friction = self._terrain.friction_at(x_m, y_m)
        if friction != self._friction:
            self._friction = friction
            self._backend.set_friction(self.body, friction)

    def _lay(self, x_m: float, y_m: float) -> None:
        """Lay the window around a point, to the nearest cell."""
        ground, half = self._terrain.ground, self._half
        row = round((y_m - ground.y0_m) / ground.cell_m)
        column = round((x_m - ground.x0_m) / ground.cell_m)
        self._x_m = ground.x0_m + column * ground.cell_m
        self._y_m = ground.y0_m + row * ground.cell_m
        around = np.arange(-half, half + 1)
        rows, columns = ground.heights.shape
        block = np.ix_(np.clip(around + row, 0, rows - 1), np.clip(around + column, 0, columns - 1))
        self._backend.set_heights(
            self.body, ground.heights[block], (self._x_m, self._y_m, self._middle_z_m)
        )


def reach_of(model: VehicleModel) -> float:
    """Return how far from its base's origin a vehicle touches things, however it is turned."""
    wheels = [
        Solid(wheel.name, Sphere(radius_m=wheel.radius_m), "", wheel.center_m)
        for wheel in model.wheels
    ]
    boxes = [bounds(part) for part in (*wheels, *collision_solids(model))]
    return max(float(np.linalg.norm(np.maximum(-low, high))) for low, high in boxes)
