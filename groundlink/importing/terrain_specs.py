# SPDX-License-Identifier: Apache-2.0
"""Schema of terrain in a world file: a heightmap file or generated hills.

Heights are in meters above `at_m`; positions are in the world.
"""

from typing import Annotated

from msgspec import Meta

from groundlink.core.fields import NonNegative, Positive, Spec, Vector3

Place2 = tuple[float, float]
"""x and y in the world."""


class MaterialRule(Spec, frozen=True, kw_only=True):
    """A material for ground within a range of slopes and heights."""

    material: str
    """Material of the ground in both ranges."""

    slope_deg: tuple[float, float] = (0.0, 90.0)
    """Smallest and largest slope of the ground."""

    height_m: tuple[float, float] = (-1e9, 1e9)
    """Lowest and highest ground, above `at_m`."""


class SurfaceMap(Spec, frozen=True):
    """Materials from an 8-bit grayscale picture with its first row in the north."""

    file: str
    """Path of the picture, relative to the file that names it."""

    materials: Annotated[tuple[str, ...], Meta(min_length=1, max_length=200)]
    """Materials of the values 0, 1, 2 and so on."""


class LevelArea(Spec, frozen=True, kw_only=True):
    """A level disc: a pond, or a place to build on."""

    at_m: Place2
    """Center of the disc: x and y in the world."""

    radius_m: Positive
    """Radius of the disc."""

    material: str | None = None
    """Material of the area; None: unchanged."""

    height_m: float | None = None
    """Height of the area; None: that of the lowest ground along the rim."""

    shore_m: NonNegative = 5.0
    """Width of the transition to the surrounding ground."""


class Road(Spec, frozen=True, kw_only=True):
    """A road along a line, level across, at the smoothed height of the ground.

    A road that ends at its first point is a closed loop.
    """

    points_m: Annotated[tuple[Place2, ...], Meta(min_length=2)]
    """Points of the center line: x and y in the world."""

    width_m: Positive
    """Width of the road without shoulders."""

    material: str
    """Material of the road."""

    shoulder_m: NonNegative = 4.0
    """Width of the transition to the ground on each side."""

    smooth_m: Positive = 30.0
    """Length of the smoothing filter along the road."""


class GroundSpec(Spec, frozen=True, kw_only=True):
    """Common fields of terrain descriptions."""

    at_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the middle of the map in the world; z is added to the heights."""

    material: str
    """Material of the ground where nothing else sets one."""

    surface: SurfaceMap | None = None
    """Materials from a picture; None: `material` everywhere."""

    where: tuple[MaterialRule, ...] = ()
    """Materials by slope and height. The last matching rule applies."""

    levels: tuple[LevelArea, ...] = ()
    """Level areas, applied before the roads."""

    roads: tuple[Road, ...] = ()
    """Roads, applied after the levels."""


class HeightmapFile(GroundSpec, frozen=True, kw_only=True, tag_field="kind", tag="heightmap"):
    """A heightmap in a file: PNG, GeoTIFF, ESRI ASCII grid or .npy."""

    file: str
    """Path of the heightmap, relative to the file that names it."""

    cell_m: Positive | None = None
    """Length of a cell's side; None: from the file."""

    size_m: tuple[Positive, Positive] | None = None
    """Alternative: size of the map along x and y, from the first height to the last."""

    heights_m: tuple[float, float] | None = None
    """Heights of black and white in a PNG."""


class HillsTerrain(GroundSpec, frozen=True, kw_only=True, tag_field="kind", tag="hills"):
    """Generated hills, the same for the same seed on every machine."""

    seed: Annotated[int, Meta(ge=0)] = 0
    """Seed of the hills."""

    size_m: tuple[Positive, Positive]
    """Size of the map along x and y; rounded to whole cells."""

    cell_m: Positive
    """Length of a cell's side."""

    height_m: Positive
    """Height of the highest point above the lowest, which is at 0."""

    longest_m: Positive
    """Approximate wavelength of the largest hills."""

    shortest_m: Positive | None = None
    """Approximate wavelength of the smallest bumps; None: four cells."""

    roughness: Annotated[float, Meta(ge=0, le=1)] = 0.4
    """Relative height of each octave to the one before; 0: the largest hills alone."""


TerrainSpec = HeightmapFile | HillsTerrain
