# SPDX-License-Identifier: Apache-2.0
"""Rendering time of a terrain compared with the laboratory: `python -m benchmarks.camera_terrain`.

Pictures have 640 x 480 pixels, color and depth, and no lens. Both worlds take turns in one process.
The terrain is 15 x 15 km of hills in cells of 10 m, with four materials. Figures are medians over
positions of processor time over all threads. `start` is the time from the world's data to the first
picture, and `memory` the memory that this adds. Both worlds differ only in their content.
"""

import sys
import time
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from groundlink.core.frames import Floats, multiply, quaternion_from_rpy, transform
from groundlink.importing import terrain
from groundlink.importing.file_errors import ignore_warning
from groundlink.importing.terrain_specs import HillsTerrain, MaterialRule
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario import Scenario
from groundlink.scenario.every_sensor import MOUNT_FROM_OPTICAL, Mount
from groundlink.world.solids import Material
from groundlink.world.terrain import load_ground
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.runtime.world_replica import WorldReplica

PINHOLE = Pinhole(640, 480, 415.0, 415.0, 319.5, 239.5)
HILLS = HillsTerrain(
    seed=4,
    size_m=(15_000.0, 15_000.0),
    cell_m=10.0,
    height_m=900.0,
    longest_m=6000.0,
    material="meadow",
    where=(
        MaterialRule(material="soil", slope_deg=(14.0, 90.0)),
        MaterialRule(material="rock", slope_deg=(22.0, 90.0)),
        MaterialRule(material="snow", slope_deg=(0.0, 25.0), height_m=(700.0, 2000.0)),
    ),
)
MATERIALS = {
    "meadow": Material(color=(0.11, 0.15, 0.045), texture="grass", texture_size_m=3.0),
    "soil": Material(color=(0.20, 0.14, 0.09), texture="soil", texture_size_m=3.0),
    "rock": Material(color=(0.28, 0.27, 0.26), texture="rock", texture_size_m=4.0),
    "snow": Material(color=(0.80, 0.82, 0.86), texture="snow", texture_size_m=4.0),
}
ROUNDS = 8


def looking(x: float, y: float, z: float, yaw_deg: float) -> Floats:
    """Return world_from_optical of a camera that is tilted down slightly."""
    turn = quaternion_from_rpy(0.0, np.radians(5.0), np.radians(yaw_deg))
    return transform(np.array([x, y, z]), multiply(turn, MOUNT_FROM_OPTICAL))


def hilly(scenario: Scenario) -> Scenario:
    """Return the scenario on the terrain."""
    built = terrain.build(HILLS, Path(), ignore_warning)
    materials = {**scenario.world.materials, **MATERIALS}
    world = replace(
        scenario.world,
        **{"terrain": built, "materials": materials, "light": None},
        **{"room": None, "furniture": (), "clutter": None, "solids": ()},
    )
    return replace(scenario, world=world)


def resident_mb() -> float:
    """Return the resident memory of this process in MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


class Viewpoint:
    """World with a list of camera poses."""

    def __init__(self, scenario: Scenario, poses: list[Floats]) -> None:
        before, since = resident_mb(), time.process_time()
        around = WorldReplica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 50.0)))
        self._poses, self._renderer = poses, Renderer(scenario.world, around, PINHOLE)
        parked = np.tile([0.0, 0.0, -400.0, 0.0, 0.0, 0.0, 1.0], (len(around.links), 1))
        self._renderer.place(parked)
        self.milliseconds(0)
        self.start_seconds = time.process_time() - since
        self.memory_mb = resident_mb() - before

    def milliseconds(self, number: int) -> float:
        """Return the processor time of a picture in milliseconds."""
        since = time.process_time()
        self._renderer.draw(self._poses[number % len(self._poses)])
        return 1e3 * (time.process_time() - since)


def main() -> int:
    """Measure and print."""
    lab = load(SHIPPED / "indoor_lab.yaml")
    hills = hilly(lab)
    assert hills.world.terrain
    relief = load_ground(hills.world.terrain)
    spots = [(0.0, 0.0, 1.2), (-1800.0, 2600.0, 1.2), (4000.0, -3000.0, 3.0), (500.0, 5000.0, 60.0)]
    outside = [
        looking(x, y, float(relief.height_at(x, y)) + up, yaw)
        for x, y, up in spots
        for yaw in (0.0, 100.0, 230.0)
    ]
    inside = [looking(x, 0.0, 0.5, yaw) for x in (-4.0, 0.0) for yaw in (0.0, 100.0, 230.0)]
    places = {"laboratory": Viewpoint(lab, inside), "terrain": Viewpoint(hills, outside)}
    spent = {name: np.empty(0) for name in places}
    for number in range(ROUNDS * len(outside)):
        for name, place in places.items():
            spent[name] = np.append(spent[name], place.milliseconds(number))
    medians = {name: float(np.median(times)) for name, times in spent.items()}
    for name, place in places.items():
        print(
            f"{name:10} cpu_ms={medians[name]:.1f} worst_ms={spent[name].max():.1f} "
            f"start_cpu_s={place.start_seconds:.2f} memory_mb={place.memory_mb:.0f}"
        )
    print(f"ratio={medians['terrain'] / medians['laboratory']:.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
