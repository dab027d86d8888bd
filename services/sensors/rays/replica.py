# SPDX-License-Identifier: Apache-2.0
"""A ray sensor's own copy of the world: what stands in it, and how its vehicles moved.

Rule: built from the scenario alone and moved by states alone; the same for every sensor that casts
rays.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from groundlink.frames import Floats, matrix_from_quaternion
from groundlink.messages import BadMessage, State
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.world.build import solids
from groundlink.world.links import links as links_of
from groundlink.world.solids import Box, Cylinder, Solid, Sphere, Vector3
from groundlink.world.triangles import merged

from .scene import Scene


class Replica:
    """The world around one sensor.

    Parameters
    ----------
    scenario : Scenario
    vehicle : Vehicle
        The sensor's own; it is as solid as the others.
    eye_in_base : Vector3
        Where the sensor is. Visuals of its base that enclose this point are the sensor's housing
        and are left out: it looks out of it.

    Attributes
    ----------
    scene : Scene
        Its bodies are the links of all vehicles, in the scenario's order.
    base : int
        Number of the body that the sensor is mounted on.
    reflectivity : float32 array
        Diffuse reflectance, 0..1, by the labels of `scene`.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, eye_in_base: Vector3) -> None:
        static = solids(scenario)
        links: list[list[Solid]] = []
        self._links_of: dict[str, int] = {}
        for other in scenario.vehicles:
            base, *wheels = links_of(other.model)
            if other.name == vehicle.name:
                self.base = len(links)
                base = [solid for solid in base if not _encloses(solid, eye_in_base)]
            links += [base, *wheels]
            self._links_of[other.name] = 1 + len(wheels)
        everything = [*static, *(solid for link in links for solid in link)]
        materials = scenario.world.materials
        self.reflectivity: NDArray[np.float32] = np.array(
            [materials[solid.material].reflectivity for solid in everything], np.float32
        )
        first_label = np.cumsum([len(static), *map(len, links)])
        bodies = [
            merged(link, first_label=int(first))
            for link, first in zip(links, first_label, strict=False)
        ]
        self.scene = Scene(merged(static), bodies)
        self.restart()

    def restart(self) -> None:
        """Forget all states."""
        self._first_tick = 0
        self._poses: list[Floats] = []

    def take(self, state: State) -> None:
        """Remember where every link is at the next tick.

        Raises
        ------
        BadMessage
            when a vehicle or a link is missing.
        """
        row = []
        for name, links in self._links_of.items():
            poses = state.vehicles[name].poses() if name in state.vehicles else None
            if poses is None or len(poses) != links:
                raise BadMessage(
                    f"state of tick {state.tick}: expected {links} link poses of `{name}`"
                )
            row.append(poses)
        if not self._poses:
            self._first_tick = state.tick
        self._poses.append(np.concatenate(row))

    def motion(self, first_tick: int, last_tick: int) -> Floats:
        """Return world_from_body from one tick to another, shape (ticks, bodies, 7).

        For ticks that are not known, not yet or no longer, it is that of the nearest known one.
        """
        first, newest = first_tick - self._first_tick, len(self._poses) - 1
        ticks = range(first, first + last_tick - first_tick + 1)
        return np.stack([self._poses[min(max(tick, 0), newest)] for tick in ticks])

    def forget(self, before_tick: int) -> None:
        """Drop the states of earlier ticks."""
        dropped = min(max(0, before_tick - self._first_tick), len(self._poses))
        del self._poses[:dropped]
        self._first_tick += dropped


def _encloses(solid: Solid, point: Vector3) -> bool:
    """Tell whether a point is inside a solid, both in the same frame."""
    offset = np.subtract(point, solid.position_m)
    x, y, z = (float(v) for v in matrix_from_quaternion(solid.orientation).T @ offset)
    match solid.shape:
        case Box(size_m=(length, width, height)):
            return abs(x) <= length / 2 and abs(y) <= width / 2 and abs(z) <= height / 2
        case Cylinder(radius_m=radius, length_m=length):
            return math.hypot(x, y) <= radius and abs(z) <= length / 2
        case Sphere(radius_m=radius):
            return math.hypot(x, y, z) <= radius
