# SPDX-License-Identifier: Apache-2.0
"""World replica of a ray sensor, as a scene to cast rays into.

Every solid and every material of the terrain has a label in the scene and a reflectivity: first
static solids, then the terrain with its water and grass, then the links, each of which is a body of
the scene. Grass is no part of the scene: `services.sensors.cover` has it.
"""

import numpy as np
from numpy.typing import NDArray

from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scene.bodies import NO_BODY
from groundlink.world.terrain import load_ground
from groundlink.world.triangles import joined, merged, of_ground, of_water
from services.sensors.runtime.world_replica import WorldReplica

from .scene import Numbers, Scene
from .terrain import Relief

FEW_HEIGHTS = 600_000
"""Most heights of a terrain that becomes triangles; a larger one is hit as heights, and so is one
with ruts. In a million triangles a revolution takes three quarters of the time, but building
them takes 1 s and 100 MB."""


class Replica(WorldReplica):
    """The world around one sensor that casts rays; parameters as for `WorldReplica`.

    Attributes
    ----------
    scene : Scene
        Its bodies are the links of all vehicles, in the scenario's order.
    materials : list of str
        Name of the material by the labels of `scene`.
    reflectivity : float32 array
        `Material.reflectance` by the labels of `scene`: up to 1 where diffuse.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, mount: Mount) -> None:
        super().__init__(scenario, vehicle, mount)
        terrain, materials = scenario.world.terrain, scenario.world.materials
        soils = scenario.world.ground_materials
        of_links = [solid.material for link in self.links for solid in link]
        self.materials = [*(solid.material for solid in self.static), *soils, *of_links]
        self.reflectivity: NDArray[np.float32] = np.array(
            [materials[material].reflectance for material in self.materials], np.float32
        )
        first_label = np.cumsum([len(self.static) + len(soils), *map(len, self.links)])
        bodies = [
            merged(link, first_label=int(first))
            for link, first in zip(self.links, first_label, strict=False)
        ]
        self._bodies = len(bodies)
        still, relief = merged(self.static), None
        if terrain:
            land, first = load_ground(terrain), len(self.static)
            if land.heights.size <= FEW_HEIGHTS and self.ruts is None:
                still = joined(still, of_ground(land, first_label=first))
            else:
                relief = Relief(land, first_label=first, ruts=self.ruts)
            first += len(land.materials)
            waters = enumerate(scenario.world.water, first)
            still = joined(still, *(of_water(area, land, label=label) for label, area in waters))
        self._relief = relief
        self.scene = Scene(still, bodies, terrain=relief)

    def press(self, tick: int) -> bool:
        """Let the terrain have the ruts of a tick; return if they differ from the last call's."""
        changed = super().press(tick)
        if changed and self._relief is not None:
            self._relief.deepen()
        return changed

    def body_numbers(self, label: Numbers, body: Numbers) -> NDArray[np.uint32]:
        """Return the bodies of hits, numbered as in `groundlink.scene.bodies`; `NO_BODY` for none.

        Parameters
        ----------
        label, body : int32 arrays
            Of the same hits (`scene.Hits`).
        """
        # The terrain is one body after the solids, whatever its materials.
        still = np.minimum(label, len(self.static)) + self._bodies
        standing = np.where(label >= 0, still, np.uint32(NO_BODY))
        return np.where(body >= 0, body, standing).astype(np.uint32)
