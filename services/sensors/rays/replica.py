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
from groundlink.world.bodies import NO_BODY
from groundlink.world.build import solids
from groundlink.world.links import links as links_of
from groundlink.world.solids import Box, Cylinder, Solid, Sphere, Vector3
from groundlink.world.triangles import merged

from .scene import Numbers, Scene

POSE_BYTES = 7 * 8
"""In a state: position and quaternion, float64."""

_NOTHING = memoryview(b"")


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
        `Material.reflectance` by the labels of `scene`: up to 1 where diffuse.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, eye_in_base: Vector3) -> None:
        static = solids(scenario)
        links: list[list[Solid]] = []
        self._bytes_of: dict[str, int] = {}
        for other in scenario.vehicles:
            base, *wheels = links_of(other.model)
            if other.name == vehicle.name:
                self.base = len(links)
                base = [solid for solid in base if not _encloses(solid, eye_in_base)]
            links += [base, *wheels]
            self._bytes_of[other.name] = POSE_BYTES * (1 + len(wheels))
        everything = [*static, *(solid for link in links for solid in link)]
        materials = scenario.world.materials
        self.reflectivity: NDArray[np.float32] = np.array(
            [materials[solid.material].reflectance for solid in everything], np.float32
        )
        first_label = np.cumsum([len(static), *map(len, links)])
        bodies = [
            merged(link, first_label=int(first))
            for link, first in zip(links, first_label, strict=False)
        ]
        self._sizes = list(self._bytes_of.values())
        self._bodies = len(bodies)
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
        vehicles = map(state.vehicles.get, self._bytes_of)
        rows = [vehicle.link_poses if vehicle else _NOTHING for vehicle in vehicles]
        if [row.nbytes for row in rows] != self._sizes:
            for row, (name, size) in zip(rows, self._bytes_of.items(), strict=True):
                if row.nbytes != size:
                    raise BadMessage(
                        f"state of tick {state.tick}: expected {size // POSE_BYTES} link poses "
                        f"of `{name}`"
                    )
        if not self._poses:
            self._first_tick = state.tick
        self._poses.append(np.frombuffer(b"".join(rows), np.float64).reshape(-1, 7))

    def motion(self, first_tick: int, last_tick: int) -> Floats:
        """Return world_from_body from one tick to another, shape (ticks, bodies, 7).

        For ticks that are not known, not yet or no longer, it is that of the nearest known one.
        """
        first, newest = first_tick - self._first_tick, len(self._poses) - 1
        ticks = range(first, first + last_tick - first_tick + 1)
        return np.stack([self._poses[min(max(tick, 0), newest)] for tick in ticks])

    def body_numbers(self, label: Numbers, body: Numbers) -> NDArray[np.uint32]:
        """Return what hits are on, as `groundlink.world.bodies` counts; `NO_BODY` for nothing.

        Parameters
        ----------
        label, body : int32 arrays
            Of the same hits (`scene.Hits`).
        """
        solid = np.where(label >= 0, label + self._bodies, NO_BODY)
        return np.where(body >= 0, body, solid).astype(np.uint32)

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
