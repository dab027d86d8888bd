# SPDX-License-Identifier: Apache-2.0
"""Standing water and tall grass under the rays of a LiDAR. `cover.c` computes them.

Rays are cast into the world without grass, in which a sheet is the water's surface. A pass over the
hits then changes those in grass and on water. All cover belongs to the terrain as a body.

Water: light of 903 nm goes in and does not come back: 7 1/m of it are absorbed (Hale and Querry,
Applied Optics 12, 1973), and the bottom is not seen. What comes back is the glint of facets that
face the device. Their slopes are normally distributed with the mean square s2 = 0.003 + 0.00512 W
at a wind of W m/s (Cox and Munk, JOSA 44, 1954). With the Fresnel reflectance of 2 %, the light at
the incidence t, in units of a white diffuse surface that faces the device, is

    0.02 / (4 s2 cos^5 t) exp(-tan^2 t / s2), at most 1.

A glint below 0.1 % is none. Rays that water mirrors are not followed.

Grass: leaves of all directions alike in a layer on the ground (spherical leaf angles, Ross, "The
Radiation Regime and Architecture of Plant Stands", 1981): a ray over the distance x through a
density D of leaf area meets a leaf with the probability 1 - exp(-D x / 2), so each ray gets the
distance of its first leaf by a random number of its own. Leaves are met in proportion to their area
across the ray, so the square of the cosine of the incidence is uniform. With several rays a beam, a
part of it may meet leaves and another one what is behind: both are echoes. The layer is as high as
its tufts, which stand in squares of 0.25 m; the random height of a tuft depends on its place alone,
so all sensors see the same. Under a vehicle grass is bent down to the clearance of the chassis.
Behind it grass stands up again, but for that in ruts of soft ground, which lies. Wind moves no
leaf: random numbers of each revolution are new as if all moved.
"""

import ctypes
from collections.abc import Sequence
from ctypes import c_double, c_float, c_int32, c_size_t, c_void_p

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.scenario.schema import Scenario
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.cover import GrassArea, WaterArea, grass_of_cells
from groundlink.world.terrain import Ground, load_ground
from services.sensors.rays.kernels import kernels
from services.sensors.rays.replica import Replica
from services.sensors.rays.scene import Hits, Reals

BLOCK = 16
"""Cells of a block's side, as in `cover.c`."""

PROJECTED = 0.5
"""Area that leaves of all directions have across a ray, as a share of their area."""


class _Grass(ctypes.Structure):
    """The structure `grass` of `cover.h`."""

    _fields_ = (
        *((name, c_float) for name in ("lowest", "span", "extinction")),
        ("label", c_int32),
    )


class _Cover(ctypes.Structure):
    """The structure `cover` of `cover.h`."""

    _fields_ = (
        *((name, c_void_p) for name in ("heights", "kinds", "blocks")),
        *((name, c_double) for name in ("x0", "y0", "cell")),
        *((name, c_int32) for name in ("rows", "columns", "block_columns")),
        *(("grass", c_void_p), ("pressed", c_void_p), ("pressed_count", c_size_t)),
        *((name, c_int32) for name in ("first_water", "waters")),
        *((name, c_void_p) for name in ("ruts", "slopes")),
    )


class _CoveredRays(ctypes.Structure):
    """The structure `covered_rays` of `cover.h`."""

    _fields_ = (
        *((name, c_size_t) for name in ("count", "steps")),
        *((name, c_void_p) for name in ("origins", "directions", "times", "places", "draws")),
        ("max_range", c_float),
        *((name, c_void_p) for name in ("range", "normals", "labels", "bodies")),
    )


class GroundCover:
    """Water and grass of a world, for the rays of one sensor.

    Parameters
    ----------
    scenario : Scenario
        Has terrain and water or grass.
    replica : Replica

    Attributes
    ----------
    has_grass : bool
        Whether `meet` needs random numbers.
    reflectance : float32 array
        `Replica.reflectivity` with that of glints.
    """

    def __init__(self, scenario: Scenario, replica: Replica) -> None:
        world = scenario.world
        assert world.terrain is not None
        ground = load_ground(world.terrain)
        first = len(replica.static) + len(ground.materials)
        self.has_grass = bool(world.grass)
        self.reflectance: Reals = replica.reflectivity.copy()
        self.reflectance[first : first + len(world.water)] = 1.0
        kinds = grass_of_cells(world.grass, ground)
        blocks = _blocks(world.grass, ground, kinds)
        labels = range(first + len(world.water), first + len(world.water) + len(world.grass))
        grass = (_Grass * len(world.grass))(
            *(_grass(area, label) for area, label in zip(world.grass, labels, strict=True))
        )
        self._pressing = [replica.movers.index(vehicle.name) for vehicle in scenario.vehicles]
        pressed = np.array([_footprint(v.model) for v in scenario.vehicles], np.float32)
        slopes = np.array([mean_square_slope(area) for area in world.water], np.float32)
        self._kept = replica.ruts, ground, kinds, blocks, grass, pressed, slopes
        self._structure = _Cover(
            *(array.ctypes.data for array in (ground.heights, kinds, blocks)),
            *(ground.x0_m, ground.y0_m, ground.cell_m),
            *(*kinds.shape, blocks.shape[1]),
            ctypes.addressof(grass) if world.grass else None,
            *(pressed.ctypes.data, len(pressed)),
            *(first, len(world.water)),
            *(replica.ruts and ctypes.addressof(replica.ruts), slopes.ctypes.data),
        )

    def meet(
        self,
        hits: Hits,
        rays: tuple[Reals, Reals, Reals],
        draws: Reals | None,
        poses: Floats,
        max_range_m: float,
    ) -> None:
        """Change the hits of rays where water or grass is before what they met.

        Parameters
        ----------
        hits : Hits
            Of the rays, in the scene without grass.
        rays
            Origins, directions and times, as for `Scene.cast`.
        draws : float32 array, shape (2, ...), or None
            Random numbers of each ray, 0..1; None without grass.
        poses : float64 array, shape (steps, bodies, 7)
            As for `Scene.move`.
        """
        origins, directions, times = (np.ascontiguousarray(array, np.float32) for array in rays)
        places = _places(poses[:, self._pressing])
        draws = None if draws is None else np.ascontiguousarray(draws)
        kernels().groundlink_cover(
            ctypes.byref(self._structure),
            ctypes.byref(
                _CoveredRays(
                    *(times.size, len(poses)),
                    *(array.ctypes.data for array in (origins, directions, times, places)),
                    *(None if draws is None else draws.ctypes.data, max_range_m),
                    *(hits.range_m.ctypes.data, hits.normal_in_world.ctypes.data),
                    *(hits.label.ctypes.data, hits.body.ctypes.data),
                )
            ),
        )


def ground_cover(scenario: Scenario, replica: Replica) -> GroundCover | None:
    """Return the cover of a world; None if its terrain is bare."""
    has_cover = scenario.world.water or scenario.world.grass
    return GroundCover(scenario, replica) if has_cover else None


def mean_square_slope(area: WaterArea) -> float:
    """Return that of the waves of an area of water (Cox and Munk)."""
    return 0.003 + 0.00512 * area.wind_mps


def _grass(area: GrassArea, label: int) -> _Grass:
    low, high = area.height_m
    return _Grass(low, high - low, PROJECTED * area.leaf_area_density_per_m, label)


def _blocks(areas: Sequence[GrassArea], ground: Ground, kinds: NDArray[np.uint8]) -> Reals:
    """Return the structures `block` of `cover.h`, shape (block rows, block columns, 2)."""
    highest = np.array([-np.inf, *(area.height_m[1] for area in areas)], np.float32)
    (a, b), (c, d) = (
        (row[:, :-1], row[:, 1:]) for row in (ground.heights[:-1], ground.heights[1:])
    )
    tops = np.maximum(np.maximum(a, b), np.maximum(c, d)) + highest[kinds]
    # The two triangles of a cell have two sides each along the axes.
    across, along = (np.maximum(np.abs(x), np.abs(y)) for x, y in ((b - a, d - c), (c - a, d - b)))
    rises = np.hypot(across, along) / np.float32(ground.cell_m)
    rows, columns = (-(-length // BLOCK) for length in kinds.shape)
    whole = np.full((rows * BLOCK, columns * BLOCK, 2), (-np.inf, 0.0), np.float32)
    whole[: kinds.shape[0], : kinds.shape[1]] = np.stack([tops, rises], axis=-1)
    blocks: Reals = whole.reshape(rows, BLOCK, columns, BLOCK, 2).max(axis=(1, 3))
    return blocks


def _footprint(model: VehicleModel) -> tuple[float, ...]:
    """Return the rectangle under a vehicle in its base frame, and the clearance of its chassis."""
    chassis = model.chassis
    ends = [
        (chassis.center_m[axis] - half, chassis.center_m[axis] + half)
        for axis, half in enumerate((chassis.size_m[0] / 2, chassis.size_m[1] / 2))
    ]
    for wheel in model.wheels:
        for axis, half in enumerate((wheel.radius_m, wheel.width_m / 2)):
            low, high = ends[axis]
            at = wheel.center_m[axis]
            ends[axis] = min(low, at - half), max(high, at + half)
    clearance = model.base_height_m + chassis.center_m[2] - chassis.size_m[2] / 2
    return (*(low for low, _ in ends), *(high for _, high in ends), max(0.0, clearance))


def _places(poses: Floats) -> Reals:
    """Return x, y and the heading's unit vector of bases at each step, shape (steps, bases, 4)."""
    x, y, z, w = np.moveaxis(poses[..., 3:], -1, 0)
    ahead = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + z * w)], axis=-1)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-9)
    return np.concatenate([poses[..., :2], ahead], axis=-1).astype(np.float32)
