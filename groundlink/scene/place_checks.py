# SPDX-License-Identifier: Apache-2.0
"""Checks that a body has room at a pose where it is put while a run goes on."""

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.scenario.schema import Scenario
from groundlink.world.bounds import bounds, half_extents, middle
from groundlink.world.solids import Box, Mesh, Solid

from .build import solids
from .change import RESTS_M
from .entities import Pose, in_world
from .spawn_checks import first_overlap, floor_problem, ground_of

LEAST_M = 1e-3
"""Least size of a body in checks, m."""


class PlaceChecks:
    """Room in a world: its terrain and its static solids.

    Bodies touch what they stand on and lean on, so less than `RESTS_M` is no overlap.

    Attributes
    ----------
    solids
        static solids of the world.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.ground = ground_of(scenario)
        self.solids = solids(scenario)
        boxes = [bounds(solid) for solid in self.solids]
        self._low = np.array([low for low, _ in boxes]).reshape(-1, 3)
        self._high = np.array([high for _, high in boxes]).reshape(-1, 3)

    def height_at(self, x_m: float, y_m: float) -> float:
        """Return the height of the ground: of the terrain, or 0.

        Raises
        ------
        UserError
            when the point is outside the terrain.
        """
        if self.ground is None:
            return 0.0
        if not self.ground.inside(x_m, y_m):
            raise UserError(
                f"{x_m:g}, {y_m:g} is outside the terrain. Fix: choose a place on the map"
            )
        return float(self.ground.height_at(x_m, y_m))

    def on_ground(self, parts: Sequence[Solid], pose: Pose) -> Pose:
        """Return a pose, raised so far that solids in its frame are not in the ground.

        Raises
        ------
        UserError
            when it is outside the terrain.
        """
        (x, y, z), orientation = pose
        height_m = self.height_at(x, y)
        depth_m = height_m - float(min(bounds(in_world(part, pose))[0][2] for part in parts))
        return ((x, y, z + depth_m), orientation) if depth_m > RESTS_M else pose

    def check(
        self, name: str, bodies: Sequence[Solid], pose: Pose, moving: Sequence[Solid]
    ) -> None:
        """Refuse a pose inside another object, or beside all that could carry the body.

        Parameters
        ----------
        bodies
            collision solids of what is put there, in its frame.
        moving
            those of vehicles and actors in the world.

        Raises
        ------
        UserError
            with the name of the other object.
        """
        inner = [
            _inner(in_world(body, pose)) for body in bodies if not isinstance(body.shape, Mesh)
        ]
        near = set()
        for body in inner:
            low, high = bounds(body)
            near |= set(np.flatnonzero(np.all((self._low < high) & (self._high > low), axis=1)))
        others = [self.solids[i] for i in sorted(near)]
        others += [solid for solid in moving if solid.name != name]
        if (other := first_overlap(inner, others)) is not None:
            raise UserError(f"`{name}` would be inside `{other}`. Fix: choose another place")
        x, y, z = pose[0]
        if self.ground is None and floor_problem(x, y, z, self.solids):
            raise UserError(
                f"`{name}` would be at {x:g}, {y:g}, outside this world. Fix: choose another place"
            )


def _inner(solid: Solid) -> Solid:
    """Return the box around a solid along its axes, smaller by `RESTS_M` on each side."""
    x, y, z = np.maximum(2 * (half_extents(solid.shape) - RESTS_M), LEAST_M).tolist()
    return replace(solid, shape=Box(size_m=(x, y, z)), position_m=tuple(middle(solid).tolist()))
