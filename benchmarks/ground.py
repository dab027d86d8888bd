# SPDX-License-Identifier: Apache-2.0
"""Cost of ground in physics: `python -m benchmarks.ground`.

Measures processor time. A vehicle drives in curves on a box, on hills and on the same hills as a
mesh; then windows and meshes are built alone, each in a fresh process.
"""

import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from groundlink.importing.file_errors import ignore_warning
from groundlink.importing.hills import heights
from groundlink.importing.terrain import build
from groundlink.importing.terrain_specs import HillsTerrain
from groundlink.loader import load
from groundlink.loader.document import read
from groundlink.loader.scenario_files import SHIPPED
from groundlink.loader.validation_errors import convert
from groundlink.messages.base import Command
from groundlink.scenario.schema import Placement, Scenario, World
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world import assets
from groundlink.world.assets import VARIABLE
from groundlink.world.mesh_asset import encode_mesh
from groundlink.world.solids import Box, Material, Mesh, Solid, Sphere
from groundlink.world.terrain import load_ground
from services.physics.dynamics.backend import FREE, Surface
from services.physics.dynamics.bullet import BulletBackend
from services.physics.dynamics.statics import add_statics
from services.physics.dynamics.terrain import TerrainWindows
from services.physics.simulation.simulation import Simulation

HILLS = HillsTerrain(
    size_m=(250.0, 250.0), cell_m=1.0, height_m=10.0, longest_m=80.0, material="ground", seed=1
)
TICKS = 2000
ROUNDS = 3


def world(**parts: object) -> World:
    """Return a world of one material."""
    return World(name="bench", materials={"ground": Material()}, **parts)  # type: ignore[arg-type]


def sheet(made: np.ndarray, cell_m: float) -> Solid:
    """Return heights as a mesh around the origin."""
    rows, columns = made.shape
    x = (np.arange(columns) - (columns - 1) / 2) * cell_m
    y = (np.arange(rows) - (rows - 1) / 2) * cell_m
    vertices = np.stack([*np.meshgrid(x, y), made], axis=-1).reshape(-1, 3).astype(np.float32)
    number = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([d, c, b], -1)], axis=2).reshape(-1, 3)
    low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
    mesh = Mesh(
        asset=assets.put(encode_mesh(vertices, faces)), low_m=tuple(low), high_m=tuple(high)
    )
    return Solid("yard", mesh, "ground", drivable=True)


def microseconds(scenario: Scenario, solids: tuple[Solid, ...]) -> float:
    """Return processor time per tick of a vehicle that drives in curves, least of some rounds."""
    speed = min(scenario.vehicles[0].model.top_speed_mps / 2, 4.0)
    with Simulation(scenario, solids) as simulation:
        rounds = []
        for _ in range(ROUNDS):
            started = time.process_time()
            for _ in range(TICKS):
                if simulation.tick % 20 == 0:
                    turn = 0.3 * np.sin(simulation.tick / 400)
                    command = Command(simulation.sim_nanos, (speed, 0, 0), (0, 0, float(turn)))
                    simulation.command("it", command)
                simulation.step()
            rounds.append(time.process_time() - started)
    return min(rounds) / TICKS * 1e6


def drives() -> None:
    """Print the time of a tick of each shipped vehicle on each ground."""
    described = build(HILLS, Path(), ignore_warning)
    here = load_ground(described)
    start_m = float(here.height_at(0.0, 0.0))
    box = Solid("floor", Box(size_m=(250.0, 250.0, 1.0)), "ground", (0.0, 0.0, -0.5))
    mesh = sheet(here.heights, here.cell_m)
    empty = load(SHIPPED / "indoor_lab.yaml")
    print(f"{'us a tick':22} {'box':>7} {'hills':>7} {'mesh':>7}")
    for file in sorted((SHIPPED / "vehicles").glob("*.yaml")):
        model = convert(read(file), VehicleModel)
        at = {"box": 0.0, "hills": 0.0, "mesh": start_m + 0.5}
        worlds = {"box": world(), "hills": world(terrain=described), "mesh": world()}
        solids = {"box": (box,), "hills": (), "mesh": (mesh,)}
        costs = []
        for kind in worlds:
            vehicle = replace(
                empty.vehicles[0], name="it", model=model, placement=Placement(z_m=at[kind])
            )
            scenario = replace(empty, world=worlds[kind], vehicles=(vehicle,))
            costs.append(f"{microseconds(scenario, solids[kind]):7.1f}")
        print(f"{model.name:22} {' '.join(costs)}", flush=True)


def resident_mb() -> float:
    """Return the resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def windows(cells: int) -> None:
    """Print memory and time of a window."""
    from services.physics.dynamics import terrain

    terrain.MIN_CELLS = cells
    backend = BulletBackend()
    ball = Solid("ball", Sphere(radius_m=1.0), "ground")

    class Pin:
        body = backend.add_body([ball], Surface(0.5, 0.0, FREE), mass_kg=1.0)
        position_m = (0.0, 0.0, 0.0)

    windows_of_hills = TerrainWindows(
        backend, load_ground(build(HILLS, Path(), ignore_warning)), world().materials
    )
    before = resident_mb()
    windows_of_hills.carry(Pin(), "pin", 1.0)
    grown = resident_mb() - before
    started = time.process_time()
    for i in range(10):
        Pin.position_m = (100.0 * (-1) ** i, 0.0, 0.0)
        windows_of_hills.follow()
    spent = (time.process_time() - started) / 10
    print(f"a window of {cells} x {cells} cells: {grown:.0f} MB, laid anew in {spent * 1e3:.1f} ms")


def mesh(side: int) -> None:
    """Print memory and time of a mesh."""
    made = heights(replace(HILLS, size_m=(side, side)))
    solid = sheet(made, 1.0)
    backend = BulletBackend()
    before, started = resident_mb(), time.process_time()
    add_statics(backend, [solid], world().materials, clearance_m=0.0)
    spent = time.process_time() - started
    grown = resident_mb() - before
    print(f"a mesh of {2 * side * side:,} triangles: {grown:.0f} MB, {spent:.2f} s")


def main() -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ[VARIABLE] = folder
        drives()
        fresh = multiprocessing.get_context("spawn")
        calls: list[tuple[Callable[[int], None], int]] = [
            *((windows, cells) for cells in (32, 64, 128, 256)),
            *((mesh, side) for side in (128, 400, 707)),
        ]
        for call, size in calls:
            process = fresh.Process(target=call, args=(size,))
            process.start()
            process.join()


if __name__ == "__main__":
    main()
