# SPDX-License-Identifier: Apache-2.0
"""A ray sensor's own copy of the world, ready to cast rays into.

Rule: every solid of the surroundings is a label of the scene and has a reflectivity; every link is
a body of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.world.bodies import NO_BODY
from groundlink.world.solids import Vector3
from groundlink.world.triangles import merged
from services.sensors.surroundings import Surroundings

from .scene import Numbers, Scene


class Replica(Surroundings):
    """The world around one sensor that casts rays; parameters as for `Surroundings`.

    Attributes
    ----------
    scene : Scene
        Its bodies are the links of all vehicles, in the scenario's order.
    reflectivity : float32 array
        `Material.reflectance` by the labels of `scene`: up to 1 where diffuse.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, eye_in_base: Vector3) -> None:
        super().__init__(scenario, vehicle, eye_in_base)
        everything = [*self.static, *(solid for link in self.links for solid in link)]
        materials = scenario.world.materials
        self.reflectivity: NDArray[np.float32] = np.array(
            [materials[solid.material].reflectance for solid in everything], np.float32
        )
        first_label = np.cumsum([len(self.static), *map(len, self.links)])
        bodies = [
            merged(link, first_label=int(first))
            for link, first in zip(self.links, first_label, strict=False)
        ]
        self._bodies = len(bodies)
        self.scene = Scene(merged(self.static), bodies)

    def body_numbers(self, label: Numbers, body: Numbers) -> NDArray[np.uint32]:
        """Return what hits are on, as `groundlink.world.bodies` counts; `NO_BODY` for nothing.

        Parameters
        ----------
        label, body : int32 arrays
            Of the same hits (`scene.Hits`).
        """
        solid = np.where(label >= 0, label + self._bodies, NO_BODY)
        return np.where(body >= 0, body, solid).astype(np.uint32)
