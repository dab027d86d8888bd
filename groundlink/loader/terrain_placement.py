# SPDX-License-Identifier: Apache-2.0
"""Placement on terrain: heights of outdoor objects and of solids with `on_ground`.

Heights become numbers here, once: no reader of a resolved scenario needs the terrain to place an
object. `groundlink.scene.spawn_pose` places vehicles.
"""

import math

import msgspec

from groundlink.core.fields import Vector3
from groundlink.world.objects.outdoor_specs import Fence, OutdoorObject
from groundlink.world.terrain import Terrain, load_ground

from .asset_import import SOLIDS, TERRAIN
from .document import DataPath, Document, ScenarioError
from .validation_errors import convert

OUTDOORS: DataPath = ("world", "outdoors")

ON_GROUND = "on_ground"
"""Field of a solid: its height counts from the terrain below it."""


def place_solids(document: Document) -> None:
    """Add the height of the resolved terrain to solids with `on_ground`.

    Raises
    ------
    ScenarioError
        when there is no terrain below a solid.
    """
    terrain, solids = document.at(("world", "terrain")), document.at(SOLIDS)
    for index, solid in enumerate(solids if isinstance(solids, list) else ()):
        if not isinstance(solid, dict) or not solid.pop(ON_GROUND, False):
            continue
        try:
            here = load_ground(msgspec.convert(terrain, Terrain))
            x, y, z = msgspec.convert(solid.get("position_m"), Vector3)
        except msgspec.ValidationError:
            mark = document.mark((*SOLIDS, index, ON_GROUND))
            raise ScenarioError(
                f"{mark}: `{ON_GROUND}`: expected terrain in this world, and `position_m`"
            ) from None
        height_m = float(here.height_at(x, y))
        if math.isnan(height_m):
            mark = document.mark((*SOLIDS, index, "position_m"))
            raise ScenarioError(f"{mark}: `position_m` is outside the terrain. Fix: move it")
        solid["position_m"] = [x, y, z + round(height_m, 3)]


class _Outdoors(msgspec.Struct):
    """Wrapper, so that errors name `outdoors`."""

    outdoors: tuple[OutdoorObject, ...]


def place_outdoors(document: Document) -> None:
    """Fill in the height of the resolved terrain below outdoor objects.

    Raises
    ------
    ScenarioError
        when an object is off the terrain, or described wrongly.
    """
    described, terrain = document.at(OUTDOORS), document.at(TERRAIN)
    if not described or terrain is None:
        return
    here = load_ground(msgspec.convert(terrain, Terrain))
    things = convert(document.alone(OUTDOORS), _Outdoors).outdoors
    for index, (thing, fields) in enumerate(zip(things, described, strict=True)):
        if (thing.ground_m if isinstance(thing, Fence) else thing.z_m) is not None:
            continue
        heights = here.height_at(*zip(*thing.feet(), strict=True)).tolist()
        if any(map(math.isnan, heights)):
            mark = document.mark((*OUTDOORS, index))
            raise ScenarioError(
                f"{mark}: `outdoors`: an object stands outside the terrain. Fix: move it"
            )
        fields.update(thing.ground_fields(heights))
