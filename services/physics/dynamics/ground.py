# SPDX-License-Identifier: Apache-2.0
"""Friction, roughness and soil of the ground: of static bodies by number, of terrain by place."""

from collections.abc import Mapping, Sequence
from ctypes import Structure, c_double, c_int64, c_size_t, c_void_p
from math import nan

import numpy as np
from msgspec import UnsetType

from groundlink.world.solids import Material, Soil

from .statics import StaticBody
from .terrain import NoTerrain, TerrainWindows

FIRM = -1.0
"""Number of ground that is no soil."""


def soils_of(materials: Mapping[str, Material]) -> list[Soil]:
    """Return the soils of materials, each once; the index of a soil is its number."""
    soils = (m.soil for m in materials.values() if not isinstance(m.soil, UnsetType))
    return list(dict.fromkeys(soils))


class GroundTable(Structure):
    """What wheels find under them; C reads it.

    Parameters
    ----------
    terrain
        the ground of all bodies that are not added.
    soils
        of the ground, in the order of their numbers.
    """

    _fields_ = (
        ("_friction", c_void_p),
        ("_roughness", c_void_p),
        ("_soil", c_void_p),
        ("_count", c_size_t),
        ("_surface", c_void_p),
        ("_rows", c_int64),
        ("_columns", c_int64),
        ("_x0_m", c_double),
        ("_y0_m", c_double),
        ("_cell_m", c_double),
        ("_material_friction", c_void_p),
        ("_material_roughness", c_void_p),
        ("_material_soil", c_void_p),
    )

    def __init__(self, terrain: TerrainWindows | NoTerrain, soils: Sequence[Soil]) -> None:
        super().__init__()
        self._numbers = {soil: float(number) for number, soil in enumerate(soils)}
        self._table = np.full((3, 0), nan)
        if isinstance(terrain, TerrainWindows):
            ground = terrain.ground
            self._ground = ground
            self._surface = ground.surface.ctypes.data
            self._rows, self._columns = ground.surface.shape
            self._x0_m, self._y0_m, self._cell_m = ground.x0_m, ground.y0_m, ground.cell_m
            numbers = [self._number(soil) for soil in terrain.soils]
            self._materials = np.array([terrain.frictions, terrain.roughness, numbers])
            self._material_friction, self._material_roughness, self._material_soil = (
                row.ctypes.data for row in self._materials
            )

    def _number(self, soil: Soil | UnsetType) -> float:
        return FIRM if isinstance(soil, UnsetType) else self._numbers[soil]

    def add(self, body: int, static: StaticBody) -> None:
        """Add a static body."""
        if (lacking := body + 1 - self._table.shape[1]) > 0:
            self._table = np.pad(self._table, ((0, 0), (0, lacking + body)), constant_values=nan)
            self._friction, self._roughness, self._soil = (row.ctypes.data for row in self._table)
            self._count = self._table.shape[1]
        soil = self._number(static.soil)
        self._table[:, body] = static.friction, static.roughness, soil

    def remove(self, body: int) -> None:
        """Remove a static body."""
        self._table[:, body] = nan
