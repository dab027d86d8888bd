# SPDX-License-Identifier: Apache-2.0
"""Friction and roughness of the ground: of static bodies by number, of terrain by place."""

from ctypes import Structure, c_double, c_int64, c_size_t, c_void_p
from math import nan

import numpy as np

from .terrain import NoTerrain, TerrainWindows


class GroundTable(Structure):
    """What wheels find under them; C reads it.

    Parameters
    ----------
    terrain
        the ground of all bodies that are not added.
    """

    _fields_ = (
        ("_friction", c_void_p),
        ("_roughness", c_void_p),
        ("_count", c_size_t),
        ("_surface", c_void_p),
        ("_rows", c_int64),
        ("_columns", c_int64),
        ("_x0_m", c_double),
        ("_y0_m", c_double),
        ("_cell_m", c_double),
        ("_material_friction", c_void_p),
        ("_material_roughness", c_void_p),
    )

    def __init__(self, terrain: TerrainWindows | NoTerrain) -> None:
        super().__init__()
        self._table = np.full((2, 0), nan)
        if isinstance(terrain, TerrainWindows):
            ground = terrain.ground
            self._ground = ground
            self._surface = ground.surface.ctypes.data
            self._rows, self._columns = ground.surface.shape
            self._x0_m, self._y0_m, self._cell_m = ground.x0_m, ground.y0_m, ground.cell_m
            self._materials = np.array([terrain.frictions, terrain.roughness])
            self._material_friction, self._material_roughness = (
                row.ctypes.data for row in self._materials
            )

    def add(self, body: int, friction: float, roughness: float) -> None:
        """Add a static body."""
        if (lacking := body + 1 - self._table.shape[1]) > 0:
            self._table = np.pad(self._table, ((0, 0), (0, lacking + body)), constant_values=nan)
            self._friction, self._roughness = (row.ctypes.data for row in self._table)
            self._count = self._table.shape[1]
        self._table[:, body] = friction, roughness

    def remove(self, body: int) -> None:
        """Remove a static body."""
        self._table[:, body] = nan
