# SPDX-License-Identifier: Apache-2.0
"""Schema of terrain in a world file: a heightmap file or generated hills.

Heights are in meters above `at_m`; positions are in the world.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from groundlink.core.fields import NonNegative, Positive, Spec, Vector3

Place2 = tuple[float, float]
"""x and y in the world."""


class MaterialRule(Spec, frozen=True, kw_only=True):
    """A material that lies wherever the ground is so steep and so high."""

    material: str
    slope_deg: tuple[float, float] = (0.0, 90.0)
    height_m: tuple[float, float] = (-1e9, 1e9)


class SurfaceMap(Spec, frozen=True):
    """Materials from a picture of 8-bit gray numbers, its first row in the north."""

    file: str
    materials: Annotated[tuple[str, ...], Meta(min_length=1, max_length=200)]
    """Of the numbers 0, 1, 2 and so on."""


class LevelArea(Spec, frozen=True, kw_only=True):
    """A level disc: a pond, or a place to build on."""

    at_m: Place2
    radius_m: Positive
    material: str | None = None
    """None: what lies there anyway."""

    height_m: float | None = None
    """None: that of the lowest ground along its rim."""

    shore_m: NonNegative = 5.0
    """Width of the ring around it that leads to the ground beyond."""


class Road(Spec, frozen=True, kw_only=True):
    """A way along a line, level across, on the ground's own heights smoothed along it.

    One that ends where it begins is a ring, without a step there.
    """

    points_m: Annotated[tuple[Place2, ...], Meta(min_length=2)]
    width_m: Positive
    material: str
    shoulder_m: NonNegative = 4.0
    """Width of the strip on each side that leads to the ground beyond."""

    smooth_m: Positive = 30.0
    """Bumps shorter than this are leveled along it."""


class GroundSpec(Spec, frozen=True, kw_only=True):
    """What terrain of every origin has."""

    at_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the middle of the map in the world; z is added to the heights."""

    material: str
    """What the ground is of where nothing else is said."""

    surface: SurfaceMap | None = None
    where: tuple[MaterialRule, ...] = ()
    """The last one that fits a cell counts."""

    levels: tuple[LevelArea, ...] = ()
    roads: tuple[Road, ...] = ()
    """Made after the levels."""


class HeightmapFile(GroundSpec, frozen=True, kw_only=True, tag_field="kind", tag="heightmap"):
    """A heightmap in a file: PNG, GeoTIFF, ESRI ASCII grid or .npy."""

    file: str
    cell_m: Positive | None = None
    """Length of a cell's side; None: as the file says."""

    size_m: tuple[Positive, Positive] | None = None
    """Instead: lengths of the whole map along x and y, from the first height to the last."""

    heights_m: tuple[float, float] | None = None
    """What the darkest and the brightest gray of a PNG stand for."""


class HillsTerrain(GroundSpec, frozen=True, kw_only=True, tag_field="kind", tag="hills"):
    """Rolling ground by a seed: the same wherever it is made."""

    seed: Annotated[int, Meta(ge=0)] = 0
    size_m: tuple[Positive, Positive]
    """Along x and y; rounded to whole cells."""

    cell_m: Positive
    height_m: Positive
    """From the lowest place, at 0, to the highest."""

    longest_m: Positive
    """Wavelength of the largest hills, about."""

    shortest_m: Positive | None = None
    """Wavelength of the smallest bumps, about; None: four cells."""

    roughness: Annotated[float, Meta(ge=0, le=1)] = 0.4
    """Height of bumps of half a wavelength, as a share; 0: the largest hills alone."""


TerrainSpec = HeightmapFile | HillsTerrain
