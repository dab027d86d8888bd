# SPDX-License-Identifier: Apache-2.0
"""Scatter: trees, bushes and rocks placed at random over an area of the terrain.

Scattered objects become entries of `outdoors` before objects are placed on the ground, so a
resolved scenario holds their places. A random place on a road, in a pond, on a house, near a spawn
place or too close to another object is drawn again.
"""

from typing import Annotated, Any
from zlib import crc32

import msgspec
import numpy as np
from msgspec import Meta

from groundlink.core.fields import NonNegative, Positive, Spec
from groundlink.core.frames import Floats
from groundlink.scenario.schema import Placement
from groundlink.world.bounds import bounds
from groundlink.world.objects.outdoor_objects import build_outdoor_object
from groundlink.world.objects.outdoor_specs import OutdoorObject, Place2
from groundlink.world.solids import Solid
from groundlink.world.terrain import Ground, Terrain, load_ground

from .asset_import import TERRAIN
from .document import DataPath, Document, ScenarioError
from .terrain_placement import OUTDOORS
from .validation_errors import convert

SCATTER: DataPath = ("world", "scatter")

TRIES = 200
"""Tries for one object before the area counts as full."""

SPAWN_CLEARANCE_M = 8.0
"""Clearance around spawn places: twice the length of a tank."""

CIRCLE = np.stack([f(np.arange(8) * np.pi / 4) for f in (np.cos, np.sin)], axis=-1)


class Scatter(Spec, frozen=True, kw_only=True):
    """Objects of one kind, scattered over a rectangle."""

    like: dict[str, Any]
    """Kind and common fields of the objects, as in `outdoors`."""

    count: Annotated[int, Meta(ge=0, le=2000)]
    """Number of objects."""

    height_m: tuple[Positive, Positive]
    """Smallest and largest height of an object, drawn uniformly."""

    low_m: Place2
    """South-west corner of the area."""

    high_m: Place2
    """North-east corner of the area."""

    ground: tuple[str, ...]
    """Materials of the ground below the objects."""

    clear_m: NonNegative = 2.0
    """Minimum distance to other ground materials, walls and other objects."""


class _Scatter(msgspec.Struct):
    """Wrapper, so that errors name `scatter`."""

    scatter: tuple[Scatter, ...]


class _Things(msgspec.Struct):
    outdoors: tuple[OutdoorObject, ...]


class _Start(msgspec.Struct):
    placement: Placement = Placement()


class _Known(msgspec.Struct):
    """Fields of a scenario needed before the full check."""

    seed: Annotated[int, Meta(ge=0)] = 0
    vehicles: tuple[_Start, ...] = ()


def place_scatter(document: Document) -> None:
    """Replace `scatter` by objects in `outdoors`; the terrain must be resolved.

    Raises
    ------
    ScenarioError
        when the description is wrong, or there is no free place left.
    """
    world = document.at(SCATTER[:-1])
    if not isinstance(world, dict) or "scatter" not in world:
        return
    if document.at(TERRAIN) is None:
        raise ScenarioError(f"{document.mark(SCATTER)}: `scatter`: expected terrain in this world")
    described = convert(document.alone(SCATTER), _Scatter).scatter
    known = convert(document, _Known)
    here = load_ground(msgspec.convert(document.at(TERRAIN), Terrain))
    listed = world.setdefault("outdoors", [])
    things = convert(document.alone(OUTDOORS), _Things).outdoors
    taken = [
        _footprint(solid)
        for i, thing in enumerate(things)
        for solid in build_outdoor_object(i, thing)
    ]
    for vehicle in known.vehicles:
        x, y = vehicle.placement.x_m, vehicle.placement.y_m
        taken.append(
            (
                x - SPAWN_CLEARANCE_M,
                y - SPAWN_CLEARANCE_M,
                x + SPAWN_CLEARANCE_M,
                y + SPAWN_CLEARANCE_M,
            )
        )
    for index, scatter in enumerate(described):
        mark = document.mark((*SCATTER, index))
        # A random stream for each entry, so that entries do not affect each other.
        generator = np.random.default_rng([known.seed, crc32(b"scatter"), index])
        for number in range(scatter.count):
            fields = _throw(scatter, generator, here, np.array(taken).reshape(-1, 4))
            if fields is None:
                raise ScenarioError(
                    f"{mark}: `scatter`: free space for {number} of {scatter.count} objects only. "
                    "Fix: lower `count`"
                )
            taken.append((*fields["at_m"], *fields["at_m"]))
            document.marks[(*OUTDOORS, len(listed))] = mark
            listed.append(fields)
    del world["scatter"]


def _throw(
    scatter: Scatter, generator: np.random.Generator, here: Ground, taken: Floats
) -> dict[str, Any] | None:
    """Return the fields of an object at a random place, or None if no place was free."""
    for _ in range(TRIES):
        place = np.round(generator.uniform(scatter.low_m, scatter.high_m), 2)
        yaw_deg = round(float(generator.uniform(-180, 180)), 1)
        height_m = round(float(generator.uniform(*scatter.height_m)), 2)
        around = np.vstack([place, place + scatter.clear_m * CIRCLE])
        if not here.inside(*around.T).all():
            continue
        grounds = {here.materials[number] for number in here.material_at(*around.T)}
        beyond = np.maximum(taken[:, :2] - place, place - taken[:, 2:]).clip(0)
        if grounds <= set(scatter.ground) and (np.hypot(*beyond.T) >= scatter.clear_m).all():
            where = {"at_m": place.tolist(), "yaw_deg": yaw_deg, "height_m": height_m}
            return scatter.like | where
    return None


def _footprint(solid: Solid) -> tuple[float, ...]:
    """Return the rectangle that a solid covers: lowest x and y, highest x and y."""
    low, high = bounds(solid)
    return (*low[:2].tolist(), *high[:2].tolist())
